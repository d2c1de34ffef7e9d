"""`asyneio evaluate`: an estimate against ground truth, under a protocol of the literature."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from asyneio.evaluation import Evaluation
    from asyneio.io.trajectory_source import TrajectorySource

_COLUMNS_HELP = "Columns of the {}, where the file has no header: t_ns,px,py,pz,qw,qx,qy,qz (- to skip one)."


def evaluate(
    estimate: Annotated[
        Path,
        typer.Argument(help="Trajectory (TUM, EuRoC, KITTI, VINS, ORB-SLAM3 ...) or a folder of results."),
    ],
    truth: Annotated[
        Path, typer.Argument(help="Ground truth of these kinds, a recording with it, or a folder of results.")
    ],
    protocol: Annotated[
        str, typer.Option("--protocol", "-p", help="What is aligned, and where: see above.")
    ] = "posyaw",
    columns: Annotated[
        str, typer.Option("--columns", help=_COLUMNS_HELP.format("estimate"), show_default=False)
    ] = "",
    truth_columns: Annotated[
        str, typer.Option("--truth-columns", help=_COLUMNS_HELP.format("truth"), show_default=False)
    ] = "",
    max_gap: Annotated[
        float,
        typer.Option("--max-gap", help="Truth is not interpolated across gaps of more seconds.", min=0.0),
    ] = 0.05,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Compare an estimated trajectory with ground truth; each segment is aligned on its own.

    \b
    Protocols:
      posyaw  position and yaw over the whole run, as for any VIO
      se3     position and rotation over the whole run, as evo_ape -a
      sim3    position, rotation and scale over the whole run, as evo_ape -as
      hku     position and rotation over the first 5 s (PL-EVIO)
      uslam   position and rotation over 3 to 8 s (Ultimate SLAM)
      origin  position and yaw of the first pose
      none    none: both are in the same world
    """
    import json

    from asyneio.cli import console
    from asyneio.cli.figures import segment_figures
    from asyneio.evaluation import evaluate as score
    from asyneio.evaluation import protocol_named
    from asyneio.io.trajectory_source import read_estimated, read_reference

    chosen = protocol_named(protocol)
    found = _or_columns(lambda: read_estimated(estimate, columns), "--columns", columns)
    reference = _or_columns(lambda: read_reference(truth, truth_columns), "--truth-columns", truth_columns)
    found, reference = _with_times(found, reference, estimate, truth)
    notes = found.notes
    if len(found.segments) > 1:
        notes += (f"{len(found.segments)} segments, each in a world of its own: each is aligned on its own",)
    notes += reference.notes
    if len(reference.segments) > 1:
        notes += (f"{truth} holds {len(reference.segments)} segments: compared with the longest",)
    results = {
        number: score(segment, reference.longest, chosen, max_gap)
        for number, segment in found.segments.items()
    }
    for note in (*notes, *_hints(found, reference, results, max_gap)):
        console.say(f"note: {note}")
    if as_json:
        plain = [{"segment": number, **result.to_dict()} for number, result in results.items()]
        typer.echo(json.dumps(plain[0] if len(plain) == 1 else {"segments": plain}, indent=2))
    else:
        console.table(f"{estimate} against {truth}", segment_figures(results))


def _or_columns(read: Callable[[], TrajectorySource], option: str, given: str) -> TrajectorySource:
    """What `read` gives; its refusal also says how to name columns."""
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
    """Both with the stamps of the one that has them, where the other has as many poses and none.

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
            f"{path} has poses without times, {counts[0]} of the estimate and {counts[1]} of the truth; "
            "expected as "
            "many of both, row by row, or times.txt (seconds, one a line) beside it"
        )
    if estimate.timed:
        poses = replace(truth.longest, t_ns=estimate.longest.t_ns)
        return estimate, replace(truth, segments={0: poses})
    poses = replace(estimate.longest, t_ns=truth.longest.t_ns)
    return replace(estimate, segments={0: poses}), truth


def _hints(
    estimate: TrajectorySource, truth: TrajectorySource, results: dict[int, Evaluation], max_gap: float
) -> tuple[str, ...]:
    """What would explain large errors, said once."""
    from asyneio.evaluation import associate
    from asyneio.evaluation.hints import explain

    told = estimate.order_told and truth.order_told
    found = (
        explain(associate(segment, truth.longest, max_gap), results[number].alignment, told)
        for number, segment in estimate.segments.items()
    )
    return tuple(dict.fromkeys(note for notes in found for note in notes))
