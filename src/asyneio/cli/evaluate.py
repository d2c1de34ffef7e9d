"""`asyneio evaluate`: an estimate against ground truth, under a protocol of the literature."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def evaluate(
    estimate: Annotated[Path, typer.Argument(help="trajectory.tum or estimates.npz.")],
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
    """Compare an estimated trajectory with ground truth."""
    import json

    from asyneio.cli import console
    from asyneio.cli.figures import score_figures
    from asyneio.evaluation import evaluate as score
    from asyneio.evaluation import protocol_named
    from asyneio.io import read_estimates, read_tum, to_trajectory

    chosen = protocol_named(protocol)
    notes: tuple[str, ...] = ()
    if estimate.suffix == ".npz":
        estimated = to_trajectory(read_estimates(estimate))
    else:
        estimated, notes = read_tum(estimate)
    true, truth_notes = read_tum(truth)
    for note in notes + truth_notes:
        console.say(f"note: {note}")
    result = score(estimated, true, chosen)
    if as_json:
        typer.echo(json.dumps(result.to_dict(), indent=2))
    else:
        console.table(f"{estimate} against {truth}", score_figures(result))
