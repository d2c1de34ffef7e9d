# SPDX-License-Identifier: Apache-2.0
"""Shared by `run` and `demo`: run a recording, write the results, show the figures, report every failure."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from asyneio.cli import console
from asyneio.cli.progress import share_progress
from asyneio.cli.recording_view import recording_view
from asyneio.cli.results_folder import CHECKPOINT_FOLDER, results_folder
from asyneio.config import Config
from asyneio.errors import EstimationError, RecordingError
from asyneio.evaluation import Evaluation
from asyneio.io.parsing.atomic import remove_temporary
from asyneio.pipeline import CheckpointSettings, RunInterrupted, RunResult, run_recording, write_outputs
from asyneio.pipeline.checkpoint import has_checkpoint, remove_checkpoints
from asyneio.pipeline.report import RECORDED, RunReport
from asyneio.pipeline.report_data import KnownStates
from asyneio.types import EventRecording, Recording
from asyneio.viz import available

REPORT_FILE = "report.html"
OVERVIEW_FILE = "overview.png"
FIGURES_FOLDER = "figures"


@dataclass(frozen=True)
class Job:
    """What to run, and where to write the results.

    `description`: where the data come from, for the report; `known`: true velocity and biases at given times,
    from a simulation; `png`: also write each figure as a file; `as_json`: print JSON, not a table; `view`:
    show the run in the viewer; `checkpoint_s`: time between two checkpoints [s], 0: none, None: automatic;
    `resume`: continue from the newest checkpoint in the folder.
    """

    recording: Recording | EventRecording
    config: Config
    folder: Path
    description: str = RECORDED
    known: KnownStates | None = None
    png: bool = False
    as_json: bool = False
    view: bool = False
    checkpoint_s: float | None = None
    resume: bool = False

    def checkpoints(self) -> CheckpointSettings:
        """Where and when checkpoints are written."""
        return CheckpointSettings(self.folder / CHECKPOINT_FOLDER, self.checkpoint_s, self.resume)


def execute(job: Job) -> RunResult:
    """Run a recording and write its results, with a report if matplotlib is installed.

    The checkpoints are removed when everything is written. They remain after an interruption, and where a
    file could not be written.

    Raises:
        EstimationError: the trajectory is missing or incomplete (everything estimated has been written).
        RecordingError: the recording is too short, a file cannot be written, another run uses the folder, or
            the run to resume had other options.
    """
    with results_folder(job.folder):
        result = _run(job)
        with _advising(job):
            written = write_outputs(result, job.folder)
            report = RunReport(result, job.recording, description=job.description, known=job.known)
            _show(job, report)
            written += _write_report(job, report)
        remove_checkpoints(job.checkpoints().folder)
    if job.as_json:
        print(_json(result, report.scores, written))
    # Those of the recording were printed when it was opened.
    for note in result.summary.notes[len(job.recording.notes) :]:
        console.say(f"note: {note}")
    for path in written:
        console.say(f"wrote {path}")
    if result.summary.failure:
        raise EstimationError(f"{result.summary.failure}. {_advice(result)}")
    return result


def _run(job: Job) -> RunResult:
    """Run with a progress bar; on Ctrl-C, write what was estimated until then and raise again."""
    try:
        with console.run_progress() as progress, recording_view(job.recording, job.view) as watch:
            checkpoints = job.checkpoints()
            return run_recording(job.recording, job.config, progress, watch=watch, checkpoints=checkpoints)
    except RunInterrupted as interrupted:
        _write_interrupted(job, interrupted.result)
        raise
    except KeyboardInterrupt:
        console.say("interrupted before the estimator ran: nothing is written")
        raise


def _write_interrupted(job: Job, result: RunResult) -> None:
    """Write the results until Ctrl-C, without a report; nothing if there are no estimates."""
    if not result.run.estimates:
        console.say(f"{result.summary.failure}: no estimates yet, nothing is written")
        return
    with _advising(job):
        _remove_report(job)
        written = write_outputs(result, job.folder)
    advice = "; --resume continues the run" if has_checkpoint(job.checkpoints().folder) else ""
    console.say(f"{result.summary.failure}: {len(result.run.estimates)} knots are kept{advice}")
    for path in written:
        console.say(f"wrote {path}")


@contextmanager
def _advising(job: Job) -> Iterator[None]:
    """Add what is left, and how to continue, to the error of a file that cannot be written."""
    try:
        yield
    except (RecordingError, OSError) as error:
        advice = f"Every file in {job.folder} is complete"
        if has_checkpoint(job.checkpoints().folder):
            advice += "; --resume continues from the last checkpoint"
        raise RecordingError(f"{error}. {advice}") from error


def _show(job: Job, report: RunReport) -> None:
    for note in report.notes:
        console.say(f"note: {note}")
    if not job.as_json:
        console.table(job.recording.name, report.table)


def _remove_report(job: Job) -> None:
    """Remove the report of an earlier run."""
    figures = job.folder / FIGURES_FOLDER
    for stale in (job.folder / REPORT_FILE, job.folder / OVERVIEW_FILE, *figures.glob("*.png")):
        stale.unlink(missing_ok=True)
    remove_temporary(figures)


def _write_report(job: Job, report: RunReport) -> list[Path]:
    page, overview = job.folder / REPORT_FILE, job.folder / OVERVIEW_FILE
    figures = job.folder / FIGURES_FOLDER
    _remove_report(job)
    if not available():
        console.say("note: no report without matplotlib: pip install 'asyneio[report]'")
        return []
    with share_progress("drawing") as advance:
        written = [report.write(page, advance)]
    written += report.write_overview(overview)
    if job.png:
        with share_progress("drawing") as advance:
            written += report.write_figures(figures, advance)
    return written


def _json(result: RunResult, scores: dict[int, Evaluation], written: list[Path]) -> str:
    """Summary, evaluation of the segments, and files."""
    more = {
        "evaluation": [{"segment": number, **score.to_dict()} for number, score in scores.items()],
        "files": [str(path) for path in written],
    }
    return json.dumps(json.loads(result.summary.to_json()) | more, indent=2)


def _advice(result: RunResult) -> str:
    if result.run.estimates:
        knots = len(result.run.estimates)
        return f"The {knots} estimated knots are written, but the output is incomplete or not reliable"
    return (
        "Check calibration, units and axes first (when stationary, the accelerometer axis that points up "
        "reads +9.81 m/s^2), then whether the sensor moves enough at the beginning"
    )
