"""`asyneio simulate`: a recording of feature tracks, or of events, with exact ground truth."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from asyneio.simulation import EventScenario, Scenario

#: File of a simulated recording of events in HDF5; by its content `asyneio` finds it in the folder.
HDF5_FILE = "recording.h5"


class EventFormat(StrEnum):
    """How events are written."""

    UZH = "uzh"
    HDF5 = "hdf5"


def simulate(
    scenario: Annotated[
        str,
        typer.Argument(help="Name of a scenario (of events: event_..., suite_...); a wrong one lists all."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the recording.")],
    seed: Annotated[
        int | None,
        typer.Option(
            help="Everything random follows from it.", min=0, show_default="the scenario's own, mostly 0"
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Seconds.", show_default="the scenario's own")
    ] = None,
    event_format: Annotated[
        EventFormat, typer.Option("--format", help="Of a recording of events: text as of UZH, or HDF5.")
    ] = EventFormat.UZH,
) -> None:
    """Simulate feature tracks or events, inertial samples and ground truth.

    Tracks are written as a tracks folder, events as a folder of the UZH layout or as one file of HDF5.
    """
    from asyneio.io.atomic import make_folder
    from asyneio.simulation import EVENT_SCENARIOS

    if scenario in EVENT_SCENARIOS:
        chosen = named_event_scenario(scenario, seed, duration)
        make_folder(output)
        _simulate_events(chosen, output, event_format)
    else:
        chosen_tracks = named_scenario(scenario, seed, duration)
        make_folder(output)
        _simulate_tracks(chosen_tracks, output)


def named_scenario(name: str, seed: int | None, duration_s: float | None) -> Scenario:
    """A ready-made scenario, if given with another seed and another length.

    Raises:
        SimulationError: there is no such scenario, or the length is impossible.
    """
    from dataclasses import replace

    from asyneio.errors import SimulationError
    from asyneio.simulation import EVENT_SCENARIOS, SCENARIOS

    if name not in SCENARIOS:
        raise SimulationError(
            f"scenario {name!r} is unknown; expected one of {', '.join([*SCENARIOS, *EVENT_SCENARIOS])}"
        )
    scenario = SCENARIOS[name]
    scenario = scenario if seed is None else replace(scenario, seed=seed)
    return scenario if duration_s is None else replace(scenario, duration_s=duration_s)


def named_event_scenario(name: str, seed: int | None, duration_s: float | None) -> EventScenario:
    """As `named_scenario`, of events; there must be one of that name."""
    from dataclasses import replace

    from asyneio.simulation import EVENT_SCENARIOS

    scenario = EVENT_SCENARIOS[name]
    scenario = scenario if seed is None else replace(scenario, seed=seed)
    return scenario if duration_s is None else replace(scenario, duration_s=duration_s)


def _simulate_tracks(scenario: Scenario, folder: Path) -> None:
    from asyneio.cli import console
    from asyneio.io import write_tracks_folder
    from asyneio.simulation import simulate as run_simulation

    recording = run_simulation(scenario).recording
    write_tracks_folder(recording, folder)
    console.say(
        f"wrote {folder}: {scenario.duration_s:g} s, {recording.observations.size} observations, "
        f"{recording.gyroscope.size} gyroscope and {recording.accelerometer.size} accelerometer samples"
    )


def _simulate_events(scenario: EventScenario, folder: Path, event_format: EventFormat) -> None:
    import time

    from asyneio.cli import console
    from asyneio.io import write_events_hdf5, write_uzh_folder
    from asyneio.simulation import simulate_events

    console.say(f"simulating {scenario.name}, seed {scenario.seed}, {scenario.duration_s:g} s ...")
    started = time.perf_counter()
    recording = simulate_events(scenario).recording
    seconds = time.perf_counter() - started
    if event_format is EventFormat.UZH:
        write_uzh_folder(recording, folder)
    else:
        write_events_hdf5(recording, folder / HDF5_FILE)
    mega = recording.events.size / 1e6
    console.say(
        f"wrote {folder}: {scenario.duration_s:g} s, {mega:.2f} Mev "
        f"({mega / scenario.duration_s:.2f} Mev/s of the camera, made at {mega / seconds:.2f} Mev/s), "
        f"{recording.gyroscope.size} gyroscope and "
        f"{recording.accelerometer.size} accelerometer samples"
    )
