# SPDX-License-Identifier: Apache-2.0
"""Run independent tasks in separate processes: results as they finish, immediate stop on Ctrl-C."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numba
from threadpoolctl import threadpool_limits

from asyneio.errors import StudyError
from asyneio.studies.study import Task, code_fingerprint

#: The processes use all cores, so libraries must not start additional threads.
_THREADS = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "OMP_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


@dataclass(frozen=True)
class Outcome:
    """Results of a task, or the reason of its failure; `restarts`: number of workers that died running it."""

    measured: dict[str, float] = field(default_factory=dict)
    failure: str = ""
    restarts: int = 0


def run_tasks(
    measure: Callable[[Any], dict[str, float]], tasks: Sequence[Task], jobs: int
) -> Iterator[tuple[Task, Outcome]]:
    """Run tasks; yields each with its outcome in the order in which they finish.

    Args:
        measure: function at the top level of a module, so that another process can import it.
        tasks: tasks to measure.
        jobs: number of processes; with 1, the tasks run sequentially in this process.

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
                "a measuring process was killed, possibly for lack of memory; finished results are kept: "
                "run the command again with fewer --jobs"
            ) from error


@contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of new processes: a fork would inherit the threads of a progress bar and of compiled code."""
    before = set(multiprocessing.active_children())
    with _one_thread_each():
        pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"))
        try:
            yield pool
        except BaseException:
            # Running tasks are repeated next time; waiting for them would delay Ctrl-C.
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - before:
                child.terminate()
            raise
        pool.shutdown()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Environment variables for processes with one thread per library."""
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
    """Measure a task; an exception is its result, because one bad condition must not end a study of hours."""
    try:
        return Outcome(measure(task))
    except Exception as error:
        return Outcome(failure=f"{type(error).__name__}: {error}")


def attempt_on_worker(measure: Callable[[Any], dict[str, float]], task: Task, code: str) -> Outcome:
    """Measure a task in a process that others started, with one thread for each numerical library.

    `code`: fingerprint of the program that counts the results; another one on the worker is a failure.
    """
    found = code_fingerprint()
    if found != code:
        return Outcome(
            failure=f"StudyError: the worker runs another version of asyneio (code {found}, here "
            f"{code}); install "
            "the same version on all machines"
        )
    numba.set_num_threads(1)
    with threadpool_limits(1):
        return _attempt(measure, task)
