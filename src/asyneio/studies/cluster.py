# SPDX-License-Identifier: Apache-2.0
"""Run independent tasks on a Dask cluster (extra `cluster`); those of a dead worker run on another one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from asyneio.errors import StudyError
from asyneio.studies.execution import Outcome, attempt_in_one_thread
from asyneio.studies.study import Task

#: A scheduler that does not answer within this time is not there [s].
_CONNECT_S = 10


def run_on_cluster(
    measure: Callable[[Any], dict[str, float]], tasks: Sequence[Task], address: str
) -> Iterator[tuple[Task, Outcome]]:
    """Run tasks; yields each exactly once, with its outcome, in the order in which they finish.

    `restarts` of an outcome is the number of workers that died while they ran the task. A task that kills as
    many workers as the scheduler allows (`distributed.scheduler.allowed-failures`) is a failure.

    Args:
        measure: function at the top level of a module that workers can import.
        tasks: tasks to measure.
        address: of the scheduler, such as `tcp://host:8786`.

    Raises:
        StudyError: the package `distributed` is not installed, or there is no scheduler.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise StudyError("a cluster needs the extra `cluster`: pip install 'asyneio[cluster]'") from error
    try:
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise StudyError(
            f"no Dask scheduler at {address} ({error}); start one with `dask scheduler`, and workers with "
            f"`dask worker {address} --nthreads 1`"
        ) from error
    with client:
        futures = {
            client.submit(attempt_in_one_thread, measure, task, pure=False, key=f"asyneio-{k}"): task
            for k, task in enumerate(tasks)
        }
        for future in as_completed(list(futures), loop=client.loop):
            restarts = int(client.run_on_scheduler(_deaths, key=future.key))
            failed = future.exception()
            outcome = Outcome(failure=f"{type(failed).__name__}: {failed}") if failed else future.result()
            yield futures[future], Outcome(outcome.measured, outcome.failure, restarts)


def _deaths(dask_scheduler: Any, key: str) -> int:
    """Number of workers that died while they ran a task."""
    return int(dask_scheduler.tasks[key].suspicious)
