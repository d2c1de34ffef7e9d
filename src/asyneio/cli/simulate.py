"""`asyneio simulate`: a tracks folder with exact ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from asyneio.simulation import Scenario


def simulate(
    scenario: Annotated[str, typer.Argument(help="Name of a scenario; a wrong one lists them all.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the recording.")],
    seed: Annotated[int, typer.Option(help="Everything random follows from it.", min=0)] = 0,
    duration: Annotated[
        float | None, typer.Option(help="Seconds.", show_default="the scenario's own")
    ] = None,
) -> None:
    """Simulate feature tracks, inertial samples and ground truth; write them as a tracks folder."""
    from asyneio.cli import console
    from asyneio.io import write_tracks_folder
    from asyneio.io.atomic import make_folder
    from asyneio.simulation import simulate as run_simulation

    chosen = named_scenario(scenario, seed, duration)
    make_folder(output)
    recording = run_simulation(chosen).recording
    write_tracks_folder(recording, output)
    console.say(
        f"wrote {output}: {chosen.duration_s:g} s, {recording.observations.size} observations, "
        f"{recording.gyroscope.size} gyroscope and {recording.accelerometer.size} accelerometer samples"
    )


def named_scenario(name: str, seed: int, duration_s: float | None) -> Scenario:
    """A ready-made scenario with another seed and, if given, another length.

    Raises:
        SimulationError: there is no such scenario, or the length is impossible.
    """
    from dataclasses import replace

    from asyneio.errors import SimulationError
    from asyneio.simulation import SCENARIOS

    if name not in SCENARIOS:
        raise SimulationError(f"scenario {name!r} is unknown; expected one of {', '.join(SCENARIOS)}")
    scenario = replace(SCENARIOS[name], seed=seed)
    return scenario if duration_s is None else replace(scenario, duration_s=duration_s)
