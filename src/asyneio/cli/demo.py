"""`asyneio demo`: simulate, run, evaluate, report; no data needed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

_SCENARIO = "event_room"
_EVIDENCE = (
    "A simulation: hand-held motion in a textured room, events of a 240 x 180 camera with unequal "
    "thresholds, noise and hot pixels, an inexpensive IMU. Each estimate uses only what was measured before "
    "it; observations of features become known up to frontend.max_delay_s after their stamp."
)


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "results/demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the simulation.", min=0)] = 0,
    duration: Annotated[float, typer.Option(help="Seconds to simulate.")] = 15.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Simulate a recording, run it, compare with the truth and write a report page."""
    from asyneio.cli import console
    from asyneio.cli.execute import REPORT_FILE, Job, execute
    from asyneio.cli.progress import reading_progress
    from asyneio.cli.simulate import EventFormat, named_event_scenario, write_simulated_events
    from asyneio.config import Config
    from asyneio.io import open_recording
    from asyneio.io.parsing.atomic import make_folder

    folder = output / "recording"
    make_folder(folder)
    console.say(
        f"Simulating {duration:g} s of events ({_SCENARIO}, seed {seed}), about as long as that takes ..."
    )
    scenario = named_event_scenario(_SCENARIO, seed, duration)
    simulation, _ = write_simulated_events(scenario, folder, EventFormat.HDF5)
    # Read back, so that the demonstration takes the same way as a recording of one's own.
    with reading_progress(folder) as progress:
        recording = open_recording(folder, progress=progress)
    job = Job(recording, Config(), output, _EVIDENCE, simulation.truth.at, as_json=as_json)
    execute(job)
    if (output / REPORT_FILE).exists():
        console.say(f"Open {(output / REPORT_FILE).resolve().as_uri()}")
