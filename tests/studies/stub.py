"""A study that takes no time, in a module that other processes can import."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asyneio.studies.study import Contest, Metric, Study, View

ERROR = Metric("error", "error", "m")


@dataclass(frozen=True)
class StubTask:
    method: str
    size: int
    seed: int
    kind: str = "only"


def measure(task: StubTask) -> dict[str, float]:
    """Grows with the size, half for `good`; `bad` has no result from size 3 on."""
    noise = np.random.default_rng([task.seed, task.size]).uniform(0.9, 1.1)
    if task.method == "bad" and task.size >= 3:
        return {"error": math.nan}
    return {"error": float(task.size * noise * (0.5 if task.method == "good" else 1.0))}


def measure_or_raise(task: StubTask) -> dict[str, float]:
    """As `measure`, but one task breaks while the file that STUB_BROKEN names is there."""
    if task.method == "bad" and task.size == 2 and Path(os.environ.get("STUB_BROKEN", "-")).exists():
        raise ArithmeticError(f"size {task.size} of seed {task.seed}")
    return measure(task)


def measure_slowly(task: StubTask) -> dict[str, float]:
    """As `measure`, in a while."""
    time.sleep(0.2)
    return measure(task)


def measure_and_die(task: StubTask) -> dict[str, float]:
    """As if the system had killed the process."""
    os._exit(9)


def measure_threads(task: StubTask) -> dict[str, float]:
    """The most threads that any library may start."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    return {"error": float(max(int(os.environ.get(name, 99)) for name in names))}


def stub_study(
    seeds: int = 3,
    measure: Callable[[StubTask], dict[str, float]] = measure,
    settings: dict[str, int] | None = None,
) -> Study:
    tasks = tuple(
        StubTask(method, size, seed)
        for seed in range(seeds)
        for size in (1, 2, 3)
        for method in ("good", "bad")
    )
    return Study(
        name="stub",
        question="Which method is good?",
        settings=settings or {"version": 1},
        tasks=tasks,
        measure=measure,
        views=(View("sizes", "error against size", (ERROR,), "size", ("method",), log_x=True),),
        contests=(Contest("best", "best method", ERROR, ("method",), "size", "kind"),),
    )
