"""Shared by `run` and `demo`: run a recording, write the results, show the figures, report every failure."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from asyneio.cli import console
from asyneio.cli.progress import share_progress
from asyneio.config import Config
from asyneio.errors import EstimationError
from asyneio.evaluation import Evaluation
from asyneio.io.parsing.atomic import make_folder, remove_empty
from asyneio.pipeline import CheckpointSettings, RunInterrupted, RunResult, run_recording, write_outputs
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
    from a simulation; `png`: also write each figure as a file; `as_json`: print JSON instead of a table;
    `checkpoints`: of the run, None: none.
    """

    recording: Recording | EventRecording
    config: Config
    folder: Path
    description: str = RECORDED
    known: KnownStates | None = None
    png: bool = False
    as_json: bool = False
    checkpoints: CheckpointSettings | None = None


def execute(job: Job) -> RunResult:
    """Run a recording and write its results, with a report if matplotlib is installed.

    Raises:
        EstimationError: the trajectory is missing or incomplete (everything estimated has been written).
        RecordingError: the recording is too short, or a file cannot be written.
    """
    result = _run(job)
    written = write_outputs(result, job.folder)
    report = RunReport(result, job.recording, description=job.description, known=job.known)
    for note in report.notes:
        console.say(f"note: {note}")
    if not job.as_json:
        console.table(job.recording.name, report.table)
    written += _write_report(job, report)
    if job.as_json:
        print(_json(result, report.scores, written))
    for path in written:
        console.say(f"wrote {path}")
    if result.summary.failure:
        raise EstimationError(f"{result.summary.failure}. {_advice(result)}")
    return result


def _run(job: Job) -> RunResult:
    """Run with a progress bar; on Ctrl-C, write what was estimated until then and raise again."""
    make_folder(job.folder)
    try:
        with console.run_progress() as progress:
            return run_recording(job.recording, job.config, progress, checkpoints=job.checkpoints)
    except RunInterrupted as interrupted:
        _write_interrupted(job, interrupted.result)
        raise
    except KeyboardInterrupt:
        console.say("interrupted before the estimator ran: nothing is written")
        raise
    finally:
        remove_empty(job.folder)


def _write_interrupted(job: Job, result: RunResult) -> None:
    """Write the results until Ctrl-C, without a report; nothing if there are no estimates."""
    if not result.run.estimates:
        console.say(f"{result.summary.failure}: no estimates yet, nothing is written")
        return
    written = write_outputs(result, job.folder)
    console.say(f"{result.summary.failure}: {len(result.run.estimates)} knots are kept")
    for path in written:
        console.say(f"wrote {path}")


def _write_report(job: Job, report: RunReport) -> list[Path]:
    page, overview = job.folder / REPORT_FILE, job.folder / OVERVIEW_FILE
    figures = job.folder / FIGURES_FOLDER
    for stale in (page, overview, *figures.glob("*.png")):
        stale.unlink(missing_ok=True)
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
        return f"The {len(result.run.estimates)} estimated knots are written, but the output is incomplete"
    return "Check calibration and units first, then whether the sensor moves enough at the beginning"
