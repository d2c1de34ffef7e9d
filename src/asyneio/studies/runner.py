"""Run what is missing of a study, keep every result, write the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from asyneio.studies.execution import run_tasks
from asyneio.studies.records import Record, append, appending, latest, read_records
from asyneio.studies.report import Provenance, write_report
from asyneio.studies.study import Study, code_fingerprint, task_key, task_values

RESULTS_FILE = "results.jsonl"

#: Told how many tasks are done of how many, and how many of those failed.
Progress = Callable[[int, int, int], None]


@dataclass(frozen=True)
class StudyResult:
    """Records of the study's tasks in their order, how many of them were reused, files written.

    `other_code`: fingerprints of programs other than this one that reused results were measured with.
    """

    records: tuple[Record, ...]
    reused: int
    other_code: tuple[str, ...]
    written: tuple[Path, ...]

    @property
    def failures(self) -> tuple[Record, ...]:
        """Records of measurements that failed."""
        return tuple(record for record in self.records if record.failure)


def run_study(
    study: Study, folder: Path, jobs: int, command: str, progress: Progress = lambda *_: None
) -> StudyResult:
    """Measure the tasks that the folder has no result of, under these settings; write tables and figures.

    Every result is on disk as soon as it is there: a run that is stopped resumes where it was. Tasks that
    failed are tried again.

    Args:
        study: what to measure.
        folder: for results; made where there is none.
        jobs: processes at a time.
        command: what the user typed, for the index.
        progress: is told of each task that ends.

    Raises:
        StudyError: the folder holds damaged results, or a process was killed.
        RecordingError: a file cannot be written.
    """
    path, code = folder / RESULTS_FILE, code_fingerprint()
    known = {
        key: record
        for key, record in latest(read_records(path), study.fingerprint).items()
        if not record.failure
    }
    keys = [task_key(task_values(task)) for task in study.tasks]
    missing = [task for task, key in zip(study.tasks, keys, strict=True) if key not in known]
    reused = len(keys) - len(missing)
    other_code = tuple(sorted({known[key].code for key in keys if key in known} - {code}))
    done = failed = 0
    progress(reused, len(keys), failed)
    with appending(path) as stream:
        for task, outcome in run_tasks(study.measure, missing, jobs):
            record = Record(task_values(task), study.fingerprint, code, outcome.measured, outcome.failure)
            append(stream, record)
            known[task_key(record.task)] = record
            done, failed = done + 1, failed + bool(outcome.failure)
            progress(reused + done, len(keys), failed)
    records = tuple(known[key] for key in keys)
    written = write_report(study, records, Provenance(command, code, other_code), folder)
    return StudyResult(records, reused, other_code, (path, *written))
