# SPDX-License-Identifier: Apache-2.0
"""Measure the tasks without a result in a file, and append every result to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyneio.errors import StudyError
from asyneio.progress import TaskCallback
from asyneio.studies.cluster import run_on_cluster
from asyneio.studies.execution import run_tasks
from asyneio.studies.records import Record, append, appending, latest, read_records
from asyneio.studies.study import Task, code_fingerprint, task_key, task_values

#: Called with the number of finished tasks, of all tasks, and of failed ones.
Progress = Callable[[int, int, int], None]


@dataclass(frozen=True)
class Measured:
    """Records of the tasks in their order, and how many of them were reused.

    `code` is the fingerprint of this program, `other_code` those of others that reused results come from.
    `missing` are the tasks without a record, because the measurement stopped for the reason `stopped`.
    """

    records: tuple[Record, ...]
    reused: int
    code: str
    other_code: tuple[str, ...]
    missing: tuple[Task, ...] = ()
    stopped: str = ""


def measure_missing(
    path: Path,
    measure: Callable[[Any], dict[str, float]],
    tasks: Sequence[Task],
    settings: str,
    jobs: int,
    progress: TaskCallback = lambda *_: None,
    cluster: str | None = None,
) -> Measured:
    """Measure the missing tasks. Every result is written to disk at once, so that an interrupted run can
    resume. Failed tasks are repeated. If the measurement stops, because a process was killed or a cluster
    cannot be reached, what has been measured is returned, with the reason.

    Args:
        path: file of results; created if missing.
        measure: as in `run_tasks`.
        tasks: tasks to measure.
        settings: fingerprint of everything except the task that results depend on.
        jobs: number of processes.
        progress: called after each task.
        cluster: address of a Dask scheduler whose workers run the tasks instead of processes here.

    Raises:
        StudyError: the file contains damaged results.
    """
    code = code_fingerprint()
    found = latest(read_records(path), settings)
    known = {key: record for key, record in found.items() if not record.failure}
    keys = [task_key(task_values(task)) for task in tasks]
    missing = [task for task, key in zip(tasks, keys, strict=True) if key not in known]
    reused = len(keys) - len(missing)
    other_code = tuple(sorted({known[key].code for key in keys if key in known} - {code}))
    done = failed = 0
    stopped = ""
    progress(reused, len(keys), failed)
    outcomes = run_on_cluster(measure, missing, cluster) if cluster else run_tasks(measure, missing, jobs)
    with appending(path) as stream:
        try:
            for task, outcome in outcomes:
                values, restarts = task_values(task), outcome.restarts
                record = Record(values, settings, code, outcome.measured, outcome.failure, restarts)
                append(stream, record)
                known[task_key(record.task)] = record
                done, failed = done + 1, failed + bool(outcome.failure)
                progress(reused + done, len(keys), failed)
        except StudyError as error:
            stopped = str(error)
    records = tuple(known[key] for key in keys if key in known)
    absent = tuple(task for task, key in zip(tasks, keys, strict=True) if key not in known)
    return Measured(records, reused, code, other_code, absent, stopped)
