# SPDX-License-Identifier: Apache-2.0
"""`asyneio demo`: simulate, run, evaluate, report; no data needed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asyneio.cli.options import JsonOption

_SCENARIO = "event_room"
_DESCRIPTION = (
    "A simulation: hand-held motion in a textured room, events of a 240 x 180 camera with unequal "
    "thresholds, noise and hot pixels, an inexpensive IMU. Each estimate uses only earlier measurements; "
    "feature observations are available up to frontend.max_delay_s after their timestamp."
)


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "results/demo"
    ),
    seed: Annotated[int, typer.Option(help="Random seed of the simulation.", min=0)] = 0,
    duration: Annotated[float, typer.Option(help="Length of the simulation in seconds.")] = 15.0,
    as_json: JsonOption = False,
) -> None:
    """Simulate a recording, run it, compare with ground truth and write a report."""
    from asyneio.cli import console
    from asyneio.cli.execute import REPORT_FILE, Job, execute
    from asyneio.cli.progress import reading_progress, share_progress
    from asyneio.config import Config
    from asyneio.io import open_recording
    from asyneio.io.parsing.atomic import make_folder
    from asyneio.pipeline.simulated import write_simulated_events
    from asyneio.simulation import EVENT_SCENARIOS
    from asyneio.simulation.scenarios import with_seed_and_duration

    folder = output / "recording"
    make_folder(folder)
    console.say(f"Simulating {duration:g} s of events ({_SCENARIO}, seed {seed}), roughly in real time ...")
    scenario = with_seed_and_duration(EVENT_SCENARIOS[_SCENARIO], seed, duration)
    with share_progress("simulating", scenario.duration_s, "x real time") as advance:
        simulation, _ = write_simulated_events(scenario, folder, True, advance)
    # Read from the file, so that the demonstration runs the same code as any other recording.
    with reading_progress(folder) as advance:
        recording = open_recording(folder, progress=advance)
    job = Job(recording, Config(), output, _DESCRIPTION, simulation.truth.at, as_json=as_json)
    execute(job)
    if (output / REPORT_FILE).exists():
        console.say(f"Open {(output / REPORT_FILE).resolve().as_uri()}")
