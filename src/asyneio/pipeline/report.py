# SPDX-License-Identifier: Apache-2.0
"""The report of a run: a page and pictures, with an evaluation where there is ground truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from pathlib import Path

from asyneio.errors import EvaluationError
from asyneio.evaluation import Evaluation, evaluate, protocol_named
from asyneio.io import to_trajectory
from asyneio.io.parsing.atomic import atomic_file, write_text
from asyneio.pipeline.report_data import KnownStates, report_data
from asyneio.pipeline.result_table import run_rows
from asyneio.pipeline.run import RunResult
from asyneio.progress import ProgressCallback
from asyneio.types import EventRecording, PoseTrajectory, Recording
from asyneio.version import __version__
from asyneio.viz import ReportData, render_overview, render_pictures, render_report
from asyneio.viz.data import Rows

#: Default first sentence of a report.
RECORDED = (
    "A recording, processed causally: each estimate uses only earlier measurements; feature observations are "
    "available up to frontend.max_delay_s after their timestamp."
)


class RunReport:
    """Evaluation, table, page and pictures of one run. Drawing requires matplotlib (`asyneio[report]`).

    Attributes:
        scores: evaluation of each segment by its number, each aligned separately; empty without ground truth.
        notes: why segments could not be evaluated.
    """

    def __init__(
        self,
        result: RunResult,
        recording: Recording | EventRecording,
        ground_truth: PoseTrajectory | None = None,
        description: str = RECORDED,
        known: KnownStates | None = None,
    ) -> None:
        """Evaluate the run.

        Args:
            result: the run.
            recording: the recording of the run.
            ground_truth: replaces that of the recording.
            description: where the data come from, shown below the title.
            known: true velocity and biases at given times; from a simulation.
        """
        self._result = result
        self._recording = recording if ground_truth is None else replace(recording, ground_truth=ground_truth)
        self._description = description
        self._known = known
        self.scores, self.notes = evaluate_segments(result, self._recording.ground_truth)

    @cached_property
    def table(self) -> Rows:
        """Labels and values with units: summary and evaluation."""
        return run_rows(self._result.summary, self.scores)

    @cached_property
    def data(self) -> ReportData:
        """The data of all plots."""
        return report_data(self._result, self._recording, self.scores, self._known)

    def write(self, path: Path, progress: ProgressCallback | None = None) -> Path:
        """Write the report, one HTML file without external references; return its path.

        Raises:
            VisualizationError: matplotlib is not installed.
            RecordingError: the file cannot be written.
        """
        name, text = self._recording.name, self._description
        write_text(path, render_report(name, text, self.table, self.data, __version__, progress))
        return path

    def write_overview(self, path: Path) -> list[Path]:
        """Write one picture of the run (PNG); no file without estimates. Raises as `write`."""
        picture = render_overview(self.data)
        return [] if picture is None else _write_pictures([(path, picture)])

    def write_figures(self, folder: Path, progress: ProgressCallback | None = None) -> list[Path]:
        """Write each figure of the report as a PNG file into `folder`. Raises as `write`."""
        named = render_pictures(self.data, progress)
        return _write_pictures((folder / f"{name}.png", picture) for name, picture in named)


def write_report(
    result: RunResult,
    recording: Recording | EventRecording,
    path: Path | str,
    ground_truth: PoseTrajectory | None = None,
) -> Path:
    """Write the report of a run: one HTML file without external references.

    Args:
        result: the run.
        recording: the recording of the run.
        path: the file to write.
        ground_truth: replaces that of the recording.

    Raises:
        VisualizationError: matplotlib is not installed (`pip install 'asyneio[report]'`).
        RecordingError: the file cannot be written.
    """
    return RunReport(result, recording, ground_truth).write(Path(path))


def evaluate_segments(
    result: RunResult, ground_truth: PoseTrajectory | None, protocol: str = "posyaw"
) -> tuple[dict[int, Evaluation], tuple[str, ...]]:
    """Evaluate each segment of a run, aligned separately.

    Returns:
        Evaluations by segment number, empty without ground truth; notes on segments without an evaluation.

    Raises:
        EvaluationError: the protocol is unknown.
    """
    scores: dict[int, Evaluation] = {}
    notes: list[str] = []
    rules = protocol_named(protocol)
    if ground_truth is None:
        return scores, ()
    for segment in result.run.segments():
        number = segment[0].segment
        try:
            scores[number] = evaluate(to_trajectory(segment), ground_truth, rules)
        except EvaluationError as error:
            notes.append(f"segment {number} is not compared with the ground truth: {error}")
    return scores, tuple(notes)


def _write_pictures(pictures: Iterable[tuple[Path, bytes]]) -> list[Path]:
    written = []
    for path, picture in pictures:
        with atomic_file(path) as stream:
            stream.write(picture)
        written.append(path)
    return written
