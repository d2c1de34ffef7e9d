# SPDX-License-Identifier: Apache-2.0
"""Run the missing tasks of a study, keep every result, and write the report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from asyneio.errors import StudyError
from asyneio.progress import TaskCallback
from asyneio.studies.measuring import measure_missing
from asyneio.studies.records import Record
from asyneio.studies.report import Provenance, write_report
from asyneio.studies.study import Study

RESULTS_FILE = "results.jsonl"


@dataclass(frozen=True)
class StudyResult:
    """Records of all tasks of the study in their order, number of reused records, and written files.

    `other_code`: fingerprints of other programs that measured reused records.
    """

    records: tuple[Record, ...]
    reused: int
    other_code: tuple[str, ...]
    written: tuple[Path, ...]

    @property
    def failures(self) -> tuple[Record, ...]:
        """Records of failed measurements."""
        return tuple(record for record in self.records if record.failure)


def run_study(
    study: Study, folder: Path, jobs: int, command: str, progress: TaskCallback = lambda *_: None
) -> StudyResult:
    """Measure the tasks without a result in the folder for these settings; write tables and figures.

    Every result is written to disk at once, so that an interrupted run can resume. Failed tasks are repeated.

    Args:
        study: study to run.
        folder: folder of results; created if missing.
        jobs: number of processes.
        command: command line, for the index.
        progress: called after each task.

    Raises:
        StudyError: the folder contains damaged results, or a process was killed.
        RecordingError: a file cannot be written.
    """
    path = folder / RESULTS_FILE
    measured = measure_missing(path, study.measure, study.tasks, study.fingerprint, jobs, progress)
    if measured.stopped:
        raise StudyError(measured.stopped)
    provenance = Provenance(command, measured.code, measured.other_code)
    written = write_report(study, measured.records, provenance, folder)
    return StudyResult(measured.records, measured.reused, measured.other_code, (path, *written))
