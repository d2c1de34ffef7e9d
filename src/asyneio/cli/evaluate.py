"""`asyneio evaluate`: an estimate against ground truth, under a protocol of the literature."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def evaluate(
    estimate: Annotated[
        Path, typer.Argument(help="trajectory.tum or estimates.npz: the latter holds all segments.")
    ],
    truth: Annotated[Path, typer.Argument(help="Ground truth in TUM layout: t px py pz qx qy qz qw.")],
    protocol: Annotated[
        str,
        typer.Option(
            "--protocol",
            "-p",
            help="posyaw, se3, sim3, hku, uslam, origin or none: what is aligned, and where.",
        ),
    ] = "posyaw",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Compare an estimated trajectory with ground truth; each segment is aligned on its own."""
    import json

    from asyneio.cli import console
    from asyneio.cli.figures import segment_figures
    from asyneio.evaluation import evaluate as score
    from asyneio.evaluation import protocol_named
    from asyneio.io import read_estimates, read_trajectory, to_trajectory
    from asyneio.types import split_segments

    chosen = protocol_named(protocol)
    notes: tuple[str, ...] = ()
    if estimate.suffix == ".npz":
        segments = split_segments(read_estimates(estimate))
        estimated = {segment[0].segment: to_trajectory(segment) for segment in segments}
    else:
        trajectory, notes = read_trajectory(estimate)
        estimated = {0: trajectory}
        if others := sorted(path.name for path in estimate.parent.glob("trajectory_*.tum")):
            notes += (f"beside it lie other segments ({', '.join(others)}); estimates.npz holds all",)
    if len(estimated) > 1:
        notes += (f"{len(estimated)} segments, each in a world of its own: each is aligned on its own",)
    true, truth_notes = read_trajectory(truth)
    for note in notes + truth_notes:
        console.say(f"note: {note}")
    results = {number: score(trajectory, true, chosen) for number, trajectory in estimated.items()}
    if as_json:
        plain = [{"segment": number, **result.to_dict()} for number, result in results.items()]
        typer.echo(json.dumps(plain[0] if len(plain) == 1 else {"segments": plain}, indent=2))
    else:
        console.table(f"{estimate} against {truth}", segment_figures(results))
