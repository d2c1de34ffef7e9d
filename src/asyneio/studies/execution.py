"""Independent tasks in processes of their own: results as they end, prompt on Ctrl-C."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from asyneio.errors import StudyError
from asyneio.studies.study import Task

#: Processes share the cores among them; libraries must not start threads of their own.
_THREADS = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "OMP_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


@dataclass(frozen=True)
class Outcome:
    """Figures of a task, or why there are none."""

    measured: dict[str, float] = field(default_factory=dict)
    failure: str = ""


def run_tasks(
    measure: Callable[[Any], dict[str, float]], tasks: Sequence[Task], jobs: int
) -> Iterator[tuple[Task, Outcome]]:
    """Tasks with their outcomes, in the order in which they end.

    Args:
        measure: of a module's top level, so that another process can import it.
        tasks: what to measure.
        jobs: processes at a time; with 1 the tasks run in this process, one after the other.

    Raises:
        StudyError: a process was killed.
    """
    if jobs == 1:
        for task in tasks:
            yield task, _attempt(measure, task)
        return
    with _pool(jobs) as pool:
        futures: dict[Future[Outcome], Task] = {pool.submit(_attempt, measure, task): task for task in tasks}
        try:
            for future in as_completed(futures):
                yield futures.pop(future), future.result()
        except BrokenProcessPool as error:
            raise StudyError(
                "a process that measured was killed, perhaps for want of memory; what was measured is kept: "
                "start the command again, with fewer --jobs"
            ) from error


@contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes: a fork would inherit the threads of a progress bar and of compiled code."""
    before = set(multiprocessing.active_children())
    with _one_thread_each():
        pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"))
        try:
            yield pool
        except BaseException:
            # What runs now is measured anew next time; waiting for it would make Ctrl-C slow.
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - before:
                child.terminate()
            raise
        pool.shutdown()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Environment in which processes are started with one thread for each library."""
    kept = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _attempt(measure: Callable[[Any], dict[str, float]], task: Task) -> Outcome:
    """Whatever a measurement raises is its result: one bad condition must not end a study of hours."""
    try:
        return Outcome(measure(task))
    except Exception as error:
        return Outcome(failure=f"{type(error).__name__}: {error}")
