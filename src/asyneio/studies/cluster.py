# SPDX-License-Identifier: Apache-2.0
"""Run independent tasks on a Dask cluster (extra `cluster`); those of a dead worker run on another one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any
from uuid import uuid4

from asyneio.errors import StudyError
from asyneio.studies.execution import Outcome, attempt_on_worker
from asyneio.studies.study import Task, code_fingerprint

#: A scheduler that does not answer within this time is not there [s].
_CONNECT_S = 10


def run_on_cluster(
    measure: Callable[[Any], dict[str, float]], tasks: Sequence[Task], address: str
) -> Iterator[tuple[Task, Outcome]]:
    """Run tasks; yields each exactly once, with its outcome, in the order in which they finish.

    `restarts` of an outcome is the number of workers that died while they ran the task. A task that kills as
    many workers as the scheduler allows (`distributed.scheduler.allowed-failures`) is a failure. A worker
    with another version of the code fails its tasks.

    Args:
        measure: function at the top level of a module that workers can import.
        tasks: tasks to measure.
        address: of the scheduler, such as `tcp://host:8786`.

    Raises:
        StudyError: the package `distributed` is not installed, there is no scheduler, or it is gone.
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
    code = code_fingerprint()
    with client:
        futures = {
            client.submit(
                attempt_on_worker, measure, task, code, pure=False, key=f"asyneio-{k}-{uuid4()}"
            ): task
            for k, task in enumerate(tasks)
        }
        try:
            for future in as_completed(list(futures), loop=client.loop):
                if future.cancelled():
                    raise CancelledError
                restarts = int(client.run_on_scheduler(_deaths, key=future.key))
                failed = future.exception()
                outcome = Outcome(failure=f"{type(failed).__name__}: {failed}") if failed else future.result()
                yield futures[future], Outcome(outcome.measured, outcome.failure, restarts)
        except (OSError, CancelledError) as error:
            raise StudyError(
                f"the scheduler at {address} is gone ({type(error).__name__}); finished results are "
                "kept: start the "
                "cluster and run the command again"
            ) from error


def _deaths(dask_scheduler: Any, key: str) -> int:
    """Number of workers that died while they ran a task."""
    return int(dask_scheduler.tasks[key].suspicious)
