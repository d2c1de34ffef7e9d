# SPDX-License-Identifier: Apache-2.0
"""Definition of a study: a grid of conditions and seeds, a measurement of each, and views of the results."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import Field, asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Protocol

from asyneio.version import __version__

#: The value of one factor of a condition.
Value = str | int | float

#: Default number of seeds of a study, and with `quick`.
SEEDS, QUICK_SEEDS = 10, 2


class Task(Protocol):
    """One measurement: a frozen dataclass of plain values, the factors of its condition and a seed."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def seed(self) -> int:
        """Seed of all random parts of the measurement."""


@dataclass(frozen=True)
class Metric:
    """A measured quantity, smaller is better; `name` is its key in the result of `measure`."""

    name: str
    label: str
    unit: str

    @property
    def title(self) -> str:
        """Label with unit, for axes and tables."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@dataclass(frozen=True)
class View:
    """Metrics against the factor `across`, with one line for each combination of `lines`, restricted to
    `where`.

    All other factors except the seed must be constant there.
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
    """The combination of `rivals` with the smallest `metric`, in a map of `rows` times `columns`."""

    name: str
    title: str
    metric: Metric
    rivals: tuple[str, ...]
    rows: str
    columns: str
    where: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """A study: `measure` maps a task to results, which are reproducible except for durations.

    `settings` contain, in JSON types, everything except the task that results depend on. A result that is not
    finite means that the method failed, which is a valid result; an exception is a failure of the
    measurement. `labels` are the names of factors in reports.
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
        """Hash of the settings and the version; only results with the same hash belong to this study."""
        return fingerprint(self.name, self.settings)


def fingerprint(name: str, settings: Mapping[str, Any]) -> str:
    """Hash of the settings (JSON types) and the version."""
    return _short_hash([name, __version__, settings])


def task_key(values: Mapping[str, Value]) -> str:
    """Key of a task: its values as text, in a fixed order."""
    return json.dumps(dict(values), sort_keys=True)


def task_values(task: Task) -> dict[str, Value]:
    """Factors and seed of a task by name."""
    return asdict(task)


@cache
def code_fingerprint() -> str:
    """Hash of the package's source files, to distinguish results of different versions of the code."""
    root = Path(__file__).resolve().parents[1]
    return _short_hash(
        [
            [str(path.relative_to(root)), path.read_text(encoding="utf-8")]
            for path in sorted(root.rglob("*.py"))
        ]
    )


def _short_hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
