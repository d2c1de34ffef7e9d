"""Run what is missing of a study, keep every result, write the report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from asyneio.progress import TaskCallback
from asyneio.studies.measuring import measure_missing
from asyneio.studies.records import Record
from asyneio.studies.report import Provenance, write_report
from asyneio.studies.study import Study

RESULTS_FILE = "results.jsonl"


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
    study: Study, folder: Path, jobs: int, command: str, progress: TaskCallback = lambda *_: None
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
    path = folder / RESULTS_FILE
    measured = measure_missing(path, study.measure, study.tasks, study.fingerprint, jobs, progress)
    provenance = Provenance(command, measured.code, measured.other_code)
    written = write_report(study, measured.records, provenance, folder)
    return StudyResult(measured.records, measured.reused, measured.other_code, (path, *written))
