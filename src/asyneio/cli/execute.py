"""What `run` and `demo` share: run a recording, write everything, show the figures, never hide a failure."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from asyneio import __version__
from asyneio.cli import console
from asyneio.cli.figures import run_figures
from asyneio.cli.progress import share_progress
from asyneio.cli.recording_view import recording_view
from asyneio.config import Config
from asyneio.errors import EstimationError, EvaluationError
from asyneio.evaluation import Evaluation, evaluate, protocol_named
from asyneio.io import to_trajectory
from asyneio.io.parsing.atomic import atomic_file, make_folder, remove_empty, write_text
from asyneio.pipeline import RunInterrupted, RunResult, run_recording, write_outputs
from asyneio.pipeline.report import KnownStates, report_data
from asyneio.types import EventRecording, Recording
from asyneio.viz import available, render_overview, render_pictures, render_report

REPORT_FILE = "report.html"
OVERVIEW_FILE = "overview.png"
FIGURES_FOLDER = "figures"


@dataclass(frozen=True)
class Job:
    """What to run and where the results go.

    `evidence` tells the reader of the report where the data come from; `known` gives true velocity and biases
    at chosen times, where a simulation knows them; `png`: also every figure as a file; `as_json`: figures on
    standard output as JSON instead of a table; `view`: show the run in rerun's viewer.
    """

    recording: Recording | EventRecording
    config: Config
    folder: Path
    evidence: str
    known: KnownStates | None = None
    png: bool = False
    as_json: bool = False
    view: bool = False


def execute(job: Job) -> RunResult:
    """Run a recording and write its results, with a report where matplotlib is installed.

    Raises:
        EstimationError: the trajectory is missing or incomplete (what there is has been written).
        RecordingError: the recording is too short, or a file cannot be written.
    """
    make_folder(job.folder)
    try:
        with console.run_progress() as progress, recording_view(job.recording, job.view) as watch:
            result = run_recording(job.recording, job.config, progress, watch=watch)
    except RunInterrupted as interrupted:
        _write_interrupted(job, interrupted.result)
        raise
    except KeyboardInterrupt:
        console.say("interrupted before the estimator ran: nothing is written")
        raise
    finally:
        remove_empty(job.folder)
    written = write_outputs(result, job.config, job.folder)
    scores = _scores(result, job.recording)
    figures = run_figures(result.summary, scores)
    if not job.as_json:
        console.table(job.recording.name, figures)
    written += _write_report(job, result, scores, figures)
    if job.as_json:
        print(_json(result, scores, written))
    for path in written:
        console.say(f"wrote {path}")
    if result.summary.failure:
        raise EstimationError(f"{result.summary.failure}. {_advice(result)}")
    return result


def _write_interrupted(job: Job, result: RunResult) -> None:
    """Write what was estimated until Ctrl-C, without a report, if anything was."""
    if not result.run.estimates:
        console.say(f"{result.summary.failure}: nothing was estimated yet, nothing is written")
        return
    written = write_outputs(result, job.config, job.folder)
    console.say(f"{result.summary.failure}: {len(result.run.estimates)} knots are kept")
    for path in written:
        console.say(f"wrote {path}")


def _scores(result: RunResult, recording: Recording | EventRecording) -> dict[int, Evaluation]:
    """Each segment, aligned on its own, against the recording's ground truth, where there is one."""
    scores: dict[int, Evaluation] = {}
    if recording.ground_truth is None:
        return scores
    protocol = protocol_named("posyaw")
    for segment in result.run.segments():
        number = segment[0].segment
        try:
            scores[number] = evaluate(to_trajectory(segment), recording.ground_truth, protocol)
        except EvaluationError as error:
            console.say(f"note: segment {number} is not compared with the ground truth: {error}")
    return scores


def _write_report(
    job: Job, result: RunResult, scores: dict[int, Evaluation], figures: tuple[tuple[str, str], ...]
) -> list[Path]:
    report, overview = job.folder / REPORT_FILE, job.folder / OVERVIEW_FILE
    figures_folder = job.folder / FIGURES_FOLDER
    for stale in (report, overview, *figures_folder.glob("*.png")):
        stale.unlink(missing_ok=True)
    if not available():
        console.say("note: no report without matplotlib: pip install 'asyneio[report]'")
        return []
    data = report_data(result, job.recording, job.config, scores, job.known)
    with share_progress("drawing") as advance:
        name = job.recording.name
        write_text(report, render_report(name, job.evidence, figures, data, __version__, advance))
    pictures = [(overview, render_overview(data))]
    if job.png:
        with share_progress("drawing") as advance:
            named = render_pictures(data, advance)
            pictures += [(figures_folder / f"{name}.png", picture) for name, picture in named]
    written = [report]
    for path, picture in pictures:
        if picture is not None:
            with atomic_file(path) as stream:
                stream.write(picture)
            written.append(path)
    return written


def _json(result: RunResult, scores: dict[int, Evaluation], written: list[Path]) -> str:
    """The summary, the evaluation of each segment that the truth covers, and the files."""
    more = {
        "evaluation": [{"segment": number, **score.to_dict()} for number, score in scores.items()],
        "files": [str(path) for path in written],
    }
    return json.dumps(json.loads(result.summary.to_json()) | more, indent=2)


def _advice(result: RunResult) -> str:
    if result.run.estimates:
        return f"What was estimated ({len(result.run.estimates)} knots) is written, but not whole"
    return "Check the calibration and the units first, then whether the sensor moves enough at the start"
