"""What a study is: a grid of conditions times seeds, one measurement of each, and how to look at them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import Field, asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol

from asyneio.version import __version__

#: The value of one factor of a condition.
Value = str | int | float

#: How many seeds a study has unless told otherwise, and with `quick`.
SEEDS, QUICK_SEEDS = 10, 2


class Task(Protocol):
    """One measurement: a frozen dataclass of plain values, the factors of its condition and a seed."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def seed(self) -> int:
        """Everything random in the measurement follows from it."""


@dataclass(frozen=True)
class Metric:
    """A figure that tasks measure, smaller is better; `name` as in what `measure` returns."""

    name: str
    label: str
    unit: str

    @property
    def title(self) -> str:
        """Label with unit, for axes and tables."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@dataclass(frozen=True)
class View:
    """Metrics against the factor `across`, one line for each combination of `lines`, at `where` only.

    Factors that are in none of the three must be constant there, but for the seed.
    """

    name: str
    title: str
    metrics: tuple[Metric, ...]
    across: str
    lines: tuple[str, ...]
    where: Mapping[str, Value] = field(default_factory=dict)
    log_x: bool = False


@dataclass(frozen=True)
class Contest:
    """Which combination of `rivals` has the smallest `metric`, over a map of `rows` times `columns`."""

    name: str
    title: str
    metric: Metric
    rivals: tuple[str, ...]
    rows: str
    columns: str
    where: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """A study: `measure` turns a task into figures, the same ones each time (durations apart).

    `settings` hold, in JSON's types, all that figures depend on beside the task. A figure that is not finite
    says that the method failed there, which is a result; an exception is a failure of the measurement.
    `labels` names factors for readers.
    """

    name: str
    question: str
    settings: Mapping[str, Any]
    tasks: tuple[Task, ...]
    measure: Callable[[Any], dict[str, float]]
    views: tuple[View, ...]
    contests: tuple[Contest, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)

    @property
    def fingerprint(self) -> str:
        """Hash of the settings and of the version: results of others are not this study's."""
        return fingerprint(self.name, self.settings)


def fingerprint(name: str, settings: Mapping[str, Any]) -> str:
    """Hash of what results depend on beside their task: settings in JSON's types, and the version."""
    return _short_hash([name, __version__, settings])


def task_key(values: Mapping[str, Value]) -> str:
    """A task's values, in an order of their own, as text that names it."""
    return json.dumps(dict(values), sort_keys=True)


def task_values(task: Task) -> dict[str, Value]:
    """Factors and seed of a task by name."""
    return asdict(task)


def code_fingerprint() -> str:
    """Hash of the package's source files: tells results of an edited program from those of this one."""
    root = Path(__file__).resolve().parents[1]
    return _short_hash(
        [
            [str(path.relative_to(root)), path.read_text(encoding="utf-8")]
            for path in sorted(root.rglob("*.py"))
        ]
    )


def _short_hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
