# SPDX-License-Identifier: Apache-2.0
"""Time of the estimator by stage, measured from outside by temporarily replacing public functions with timed
ones.

The time of a nested stage does not count for the outer stage. Stages marked `whole` include everything
inside: the optimisations of an initialization count as initialization.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from asyneio.estimation import window
from asyneio.estimation.linearization import linear_system
from asyneio.estimation.solver import chi_square as misfit
from asyneio.estimation.solver import elimination, optimizer
from asyneio.odometry import Odometry, outputs
from asyneio.odometry.initializer import initialize as initializer


@dataclass(frozen=True)
class Stage:
    """A stage: its name, its function or method (owner and attribute), whether it includes nested stages, and
    a description."""

    name: str
    owner: ModuleType | type
    attribute: str
    whole: bool
    what: str


REST = "rest"

STAGES: tuple[Stage, ...] = (
    Stage("start", initializer, "initialize", True, "initialization attempts, including their optimisations"),
    Stage("measurements", window.Window, "extend", True, "add samples and observations to the window"),
    Stage("births", window.Window, "add_landmarks", True, "new landmarks"),
    Stage("arrays", window.Window, "problem", True, "arrays of the window's problem"),
    Stage("linearise", linear_system, "linearize", True, "residuals and normal equations"),
    Stage("evaluate", linear_system, "evaluate", True, "cost of candidates alone"),
    Stage("eliminate", elimination, "eliminate_landmarks", True, "Schur complement of the landmarks"),
    Stage(
        "solve", optimizer, "optimize", False, "Cholesky factorisation, step, prior: the rest of optimising"
    ),
    Stage("outliers", misfit, "contradicted_landmarks", True, "chi-square test of the landmarks"),
    Stage("covariance", outputs, "newest_estimate", True, "the estimate with its covariance"),
    Stage("marginalise", window.Window, "marginalize_oldest", True, "marginalise the oldest knot"),
    Stage(REST, Odometry, "process", False, "the rest: buffering, noise, attitude, prediction, health"),
)


@dataclass
class StageTimes:
    """Wall-clock seconds, CPU seconds of the process, and number of calls of each stage. The sum of the
    seconds is that of `Odometry.process`."""

    seconds: dict[str, float] = field(default_factory=lambda: {stage.name: 0.0 for stage in STAGES})
    cpu_seconds: dict[str, float] = field(default_factory=lambda: {stage.name: 0.0 for stage in STAGES})
    calls: dict[str, int] = field(default_factory=lambda: {stage.name: 0 for stage in STAGES})


@contextmanager
def stage_times() -> Iterator[StageTimes]:
    """Time the stages inside the context in this thread only.

    Kernels must be compiled before, because a compiled caller cannot call a replaced function.
    """
    clock = _Clock()
    with ExitStack() as undo:
        for stage in STAGES:
            original = getattr(stage.owner, stage.attribute)
            replace_function(undo, stage.owner, stage.attribute, clock.timed(stage, original))
        yield clock.times


def replace_function(
    undo: ExitStack, owner: ModuleType | type, attribute: str, substitute: Callable[..., Any]
) -> None:
    """Replace a function or method by `substitute` in every module that has imported it, until `undo` is
    closed."""
    original = getattr(owner, attribute)
    holders: list[tuple[Any, str]] = [(owner, attribute)]
    if isinstance(owner, ModuleType):
        modules = [module for name, module in sys.modules.items() if name.startswith("asyneio")]
        holders += [
            (module, name)
            for module in modules
            for name, value in vars(module).items()
            if value is original and (module, name) != (owner, attribute)
        ]
    for holder, name in holders:
        undo.callback(setattr, holder, name, original)
        setattr(holder, name, substitute)


class _Clock:
    """Add the time since the last call to the innermost stage."""

    def __init__(self) -> None:
        self.times = StageTimes()
        self._thread = threading.get_ident()
        self._within: list[Stage] = []
        self._last = self._last_cpu = 0.0

    def timed(self, stage: Stage, function: Callable[..., Any]) -> Callable[..., Any]:
        """The timed function, which counts as a stage unless it is inside a whole one."""

        def counted(*args: Any, **kwargs: Any) -> Any:
            within = self._within
            if threading.get_ident() != self._thread or (within and within[-1].whole):
                return function(*args, **kwargs)
            self._look()
            within.append(stage)
            self.times.calls[stage.name] += 1
            try:
                return function(*args, **kwargs)
            finally:
                self._look()
                within.pop()

        return counted

    def _look(self) -> None:
        now, now_cpu = time.perf_counter(), time.process_time()
        if self._within:
            name = self._within[-1].name
            self.times.seconds[name] += now - self._last
            self.times.cpu_seconds[name] += now_cpu - self._last_cpu
        self._last, self._last_cpu = now, now_cpu
