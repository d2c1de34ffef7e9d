# SPDX-License-Identifier: Apache-2.0
"""`asyneio evaluate`: compare an estimate with ground truth under a protocol from the literature."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.options import JsonOption

if TYPE_CHECKING:
    from asyneio.evaluation import Evaluation
    from asyneio.io.trajectory_source import TrajectorySource

_COLUMNS_HELP = "Columns of the {}, if the file has no header: t_ns,px,py,pz,qw,qx,qy,qz (- to skip one)."

_Estimate = Annotated[
    Path,
    typer.Argument(help="Trajectory (TUM, EuRoC, KITTI, VINS, ORB-SLAM3, ...) or results folder."),
]
_Truth = Annotated[
    Path,
    typer.Argument(help="Ground truth: trajectory, recording with ground truth, or results folder."),
]
_Protocol = Annotated[
    str, typer.Option("--protocol", "-p", help="What is aligned, and on which part: see above.")
]
_Columns = Annotated[
    str, typer.Option("--columns", help=_COLUMNS_HELP.format("estimate"), show_default=False)
]
_TruthColumns = Annotated[
    str, typer.Option("--truth-columns", help=_COLUMNS_HELP.format("ground truth"), show_default=False)
]
_MaxGap = Annotated[
    float | None,
    typer.Option(
        "--max-gap",
        help="Do not interpolate ground truth across longer gaps (seconds).",
        min=0.0,
        show_default="0.05; evslam 0.15",
    ),
]
_Latency = Annotated[
    float | None,
    typer.Option(
        help="For streaming: constant latency of the poses (seconds).",
        min=0.0,
        show_default="that in poses.jsonl",
    ),
]
#: Default of --max-gap for two trajectories [s].
_MAX_GAP_S = 0.05


def evaluate(
    estimate: _Estimate,
    truth: _Truth,
    protocol: _Protocol = "posyaw",
    columns: _Columns = "",
    truth_columns: _TruthColumns = "",
    max_gap: _MaxGap = None,
    latency: _Latency = None,
    as_json: JsonOption = False,
) -> None:
    r"""Compare an estimated trajectory with ground truth; each segment is aligned separately.

    
    Protocols:
      posyaw  position and yaw over the whole run, as for any VIO
      se3     position and rotation over the whole run, as evo_ape -a
      sim3    position, rotation and scale over the whole run, as evo_ape -as
      hku     position and rotation over the first 5 s (PL-EVIO)
      uslam   position and rotation over 3 to 8 s (Ultimate SLAM)
      origin  position and yaw of the first pose
      none    none: both are in the same world

    
    Protocols that need more than poses:
      evslam     SE(3) at 10 Hz, and AUC of the velocity error (EvSLAM)
      streaming  posyaw; ground truth against the newest available pose

    evslam needs velocities: a results folder, estimates.npz, or text of eleven
    columns (t x y z qx qy qz qw vx vy vz, velocity in the frame of the body).
    streaming needs the time at which each pose was available: the folder
    DIR/live of asyneio live --record DIR, or --latency SECONDS.
    """
    from asyneio.cli import console
    from asyneio.cli.evaluate_extended import Extended, evaluate_extended
    from asyneio.errors import EvaluationError
    from asyneio.evaluation import EXTENDED_PROTOCOLS, protocol_named
    from asyneio.evaluation import evaluate as score
    from asyneio.io.trajectory_source import read_estimated, read_reference

    if latency is not None and protocol != "streaming":
        raise EvaluationError(f"--latency does not apply to the protocol {protocol!r}; omit it")
    if protocol in EXTENDED_PROTOCOLS:
        job = Extended(estimate, truth, max_gap, latency, columns, truth_columns)
        evaluate_extended(protocol, job, as_json)
        return
    rules = protocol_named(protocol)
    gap_s = _MAX_GAP_S if max_gap is None else max_gap
    found = _or_columns(lambda: read_estimated(estimate, columns), "--columns", columns)
    reference = _or_columns(lambda: read_reference(truth, truth_columns), "--truth-columns", truth_columns)
    found, reference = _with_times(found, reference, estimate, truth)
    results = {
        number: score(segment, reference.longest, rules, gap_s) for number, segment in found.segments.items()
    }
    for note in (*_notes(found, reference, truth), *_hints(found, reference, results, gap_s)):
        console.say(f"note: {note}")
    _show(f"{estimate} against {truth}", results, as_json)


def _notes(found: TrajectorySource, reference: TrajectorySource, truth: Path) -> tuple[str, ...]:
    notes = found.notes
    if len(found.segments) > 1:
        notes += (f"{len(found.segments)} segments, each with its own world frame and aligned separately",)
    notes += reference.notes
    if len(reference.segments) > 1:
        notes += (f"{truth} contains {len(reference.segments)} segments: the longest is used",)
    return notes


def _show(title: str, results: dict[int, Evaluation], as_json: bool) -> None:
    import json

    from asyneio.cli import console
    from asyneio.pipeline.result_table import evaluation_rows

    if as_json:
        plain = [{"segment": number, **result.to_dict()} for number, result in results.items()]
        typer.echo(json.dumps(plain[0] if len(plain) == 1 else {"segments": plain}, indent=2))
    else:
        console.table(title, evaluation_rows(results))


def _or_columns(read: Callable[[], TrajectorySource], option: str, given: str) -> TrajectorySource:
    """The result of `read`; an error about unknown columns also says how to name them."""
    from asyneio.errors import RecordingError

    try:
        return read()
    except RecordingError as error:
        if given or "expected a trajectory" not in str(error):
            raise
        raise RecordingError(f"{error}. Name other columns with {option} t,px,py,pz,qx,qy,qz,qw") from error


def _with_times(
    estimate: TrajectorySource, truth: TrajectorySource, estimate_path: Path, truth_path: Path
) -> tuple[TrajectorySource, TrajectorySource]:
    """Both with timestamps: if only one has them, the other takes them over, pose by pose.

    Raises:
        RecordingError: the numbers of poses differ.
    """
    from dataclasses import replace

    from asyneio.errors import RecordingError

    counts = [source.longest.t_ns.size for source in (estimate, truth)]
    if estimate.timed and truth.timed:
        return estimate, truth
    if counts[0] != counts[1] or len(estimate.segments) > 1:
        path = truth_path if estimate.timed else estimate_path
        raise RecordingError(
            f"{path} has poses without timestamps, {counts[0]} in the estimate and {counts[1]} in the ground "
            "truth; expected equal numbers, row by row, or times.txt (seconds, one per line) next to it"
        )
    if estimate.timed:
        poses = replace(truth.longest, t_ns=estimate.longest.t_ns)
        return estimate, replace(truth, segments={0: poses})
    poses = replace(estimate.longest, t_ns=truth.longest.t_ns)
    return replace(estimate, segments={0: poses}), truth


def _hints(
    estimate: TrajectorySource, truth: TrajectorySource, results: dict[int, Evaluation], max_gap: float
) -> tuple[str, ...]:
    """Likely causes of large errors, each once."""
    from asyneio.evaluation import associate
    from asyneio.evaluation.hints import explain

    order_known = estimate.order_known and truth.order_known
    found = (
        explain(associate(segment, truth.longest, max_gap), results[number].alignment, order_known)
        for number, segment in estimate.segments.items()
    )
    return tuple(dict.fromkeys(note for notes in found for note in notes))
