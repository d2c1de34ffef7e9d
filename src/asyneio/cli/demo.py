"""`asyneio demo`: simulate, run, evaluate, report; no data needed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

_SCENARIO = "moderate"
_EVIDENCE = (
    "A simulation: hand-held motion in a room, feature tracks of a 240 x 180 event camera with pixel noise, "
    "an inexpensive IMU. Each estimate uses only what was measured before it."
)


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "results/demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the simulation.", min=0)] = 0,
    duration: Annotated[float, typer.Option(help="Seconds to simulate.")] = 20.0,
) -> None:
    """Simulate a recording, run it, compare with the truth and write a report page."""
    from asyneio.cli import console
    from asyneio.cli.execute import REPORT_FILE, Job, execute
    from asyneio.cli.simulate import named_scenario
    from asyneio.config import Config
    from asyneio.io import read_tracks_folder, write_tracks_folder
    from asyneio.io.atomic import make_folder
    from asyneio.simulation import simulate

    folder = output / "recording"
    make_folder(folder)
    console.say(f"Simulating {duration:g} s ({_SCENARIO}, seed {seed}) ...")
    simulation = simulate(named_scenario(_SCENARIO, seed, duration))
    write_tracks_folder(simulation.recording, folder)
    # Read back, so that the demonstration takes the same way as a recording of one's own.
    recording = read_tracks_folder(folder)
    execute(Job(recording, Config(), output, _EVIDENCE, simulation.truth.at))
    if (output / REPORT_FILE).exists():
        console.say(f"Open {(output / REPORT_FILE).resolve().as_uri()}")
