"""`asyneio simulate`: a recording of feature tracks, or of events, with exact ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from asyneio.simulation import EventScenario, EventSimulation, Scenario
    from asyneio.types import EventRecording, RecordArray, Recording

#: File of a simulated recording of events in HDF5; by its content `asyneio` finds it in the folder.
HDF5_FILE = "recording.h5"
_REAL = "Along a recorded motion"


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
    imu_model: Annotated[
        str | None,
        typer.Option(
            help="Model of IMU to simulate, such as MPU-6150, or ideal; a wrong one lists all.",
            show_default="the scenario's own",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
    poses: Annotated[
        Path | None,
        typer.Option(help="Recorded poses of an IMU to go along (EuRoC, TUM ...).", rich_help_panel=_REAL),
    ] = None,
    samples: Annotated[
        Path | None,
        typer.Option(help="Real samples of that IMU: kept as they are.", rich_help_panel=_REAL),
    ] = None,
    begin: Annotated[
        float, typer.Option("--from", help="Seconds after both begin.", min=0.0, rich_help_panel=_REAL)
    ] = 0.0,
    imu: Annotated[
        Path | None, typer.Option(help="Noise of that IMU, any usual kind.", rich_help_panel=_REAL)
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Camera to simulate, any usual kind.", show_default="the scenario's", rich_help_panel=_REAL
        ),
    ] = None,
) -> None:
    """Simulate feature tracks or events, inertial samples and ground truth.

    Tracks are written as a tracks folder, events as a folder of the UZH layout or as one file of HDF5.

    A hybrid of real motion, real inertial samples and simulated events:

        asyneio simulate event_slow --poses state_groundtruth_estimate0/data.csv --samples imu0/data.csv
        --imu imu0/sensor.yaml -o recordings/hybrid
    """
    import json

    from asyneio.cli.recorded_motion import RecordedFiles, recorded_scenario
    from asyneio.io.parsing.atomic import make_folder
    from asyneio.simulation import EVENT_SCENARIOS, imu_named, with_imu

    sensor = None if imu_model is None else imu_named(imu_model)
    _check_recorded(scenario, poses, [samples, imu, calibration], begin)
    if scenario in EVENT_SCENARIOS:
        chosen = named_event_scenario(scenario, seed, duration)
        chosen = chosen if sensor is None else with_imu(chosen, sensor)
        fitted: dict[str, Any] = {}
        if poses is not None:
            files = RecordedFiles(poses, samples, imu, calibration, begin, duration)
            chosen, figures = recorded_scenario(chosen, files)
            fitted = {"path": figures}
        make_folder(output)
        written = _simulate_events(chosen, output, event_format) | fitted
    else:
        chosen_tracks = named_scenario(scenario, seed, duration)
        chosen_tracks = chosen_tracks if sensor is None else with_imu(chosen_tracks, sensor)
        make_folder(output)
        written = _simulate_tracks(chosen_tracks, output)
    if as_json:
        typer.echo(json.dumps({"folder": str(output), **written}, indent=2))


def _check_recorded(scenario: str, poses: Path | None, others: list[Path | None], begin_s: float) -> None:
    """Options of recorded motions belong together. Raises SimulationError."""
    from asyneio.errors import SimulationError
    from asyneio.simulation import SCENARIOS

    if poses is None and (any(others) or begin_s):
        raise SimulationError(
            "--samples, --from, --imu and --calibration go with --poses FILE; it is missing"
        )
    if poses is not None and scenario in SCENARIOS:
        raise SimulationError(
            f"scenario {scenario!r} is one of feature tracks; expected one of events (event_slow ...) to go "
            "along recorded poses"
        )


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


def write_simulated_events(
    scenario: EventScenario, folder: Path, event_format: EventFormat
) -> tuple[EventSimulation, int]:
    """Simulate events piece by piece into a folder, whatever their number; the rest of the simulation
    (without events), and how many there were.

    Raises:
        SimulationError: the scenario is impossible.
        RecordingError: a file cannot be written.
    """
    import numpy as np

    from asyneio.cli.progress import share_progress
    from asyneio.io import write_events_hdf5, write_uzh_folder
    from asyneio.simulation import simulate_events, stream_events
    from asyneio.types import EVENT_DTYPE, NS_PER_S

    simulation = simulate_events(scenario, np.empty(0, dtype=EVENT_DTYPE))
    count = 0
    with share_progress("simulating", scenario.duration_s, "x real time") as advance:

        def pieces() -> Iterator[RecordArray]:
            nonlocal count
            for piece in stream_events(scenario):
                count += int(piece.size)
                if piece.size:
                    since_ns = int(piece["t_ns"][-1]) + scenario.timeshift_ns - scenario.start_ns
                    advance(since_ns / NS_PER_S / scenario.duration_s)
                yield piece

        if event_format is EventFormat.UZH:
            write_uzh_folder(simulation.recording, folder, pieces())
        else:
            write_events_hdf5(simulation.recording, folder / HDF5_FILE, pieces())
    return simulation, count


def _simulate_tracks(scenario: Scenario, folder: Path) -> dict[str, Any]:
    from asyneio.cli import console
    from asyneio.io import write_tracks_folder
    from asyneio.simulation import simulate as run_simulation

    recording = run_simulation(scenario).recording
    write_tracks_folder(recording, folder)
    console.say(
        f"wrote {folder}: {scenario.duration_s:g} s, {recording.observations.size} observations, "
        f"{recording.gyroscope.size} gyroscope and {recording.accelerometer.size} accelerometer samples"
    )
    return _figures(scenario, recording, observations=int(recording.observations.size))


def _simulate_events(scenario: EventScenario, folder: Path, event_format: EventFormat) -> dict[str, Any]:
    import time

    from asyneio.cli import console

    console.say(f"simulating {scenario.name}, seed {scenario.seed}, {scenario.duration_s:g} s ...")
    started = time.perf_counter()
    simulation, count = write_simulated_events(scenario, folder, event_format)
    seconds, recording = time.perf_counter() - started, simulation.recording
    mega = count / 1e6
    console.say(
        f"wrote {folder}: {scenario.duration_s:g} s, {mega:.2f} Mev "
        f"({mega / scenario.duration_s:.2f} Mev/s of the camera, made at {mega / seconds:.2f} Mev/s), "
        f"{recording.gyroscope.size} gyroscope and "
        f"{recording.accelerometer.size} accelerometer samples"
    )
    return _figures(scenario, recording, events=count)


def _figures(
    scenario: Scenario | EventScenario, recording: Recording | EventRecording, **counts: int
) -> dict[str, Any]:
    return {
        "recording": recording.name,
        "seed": scenario.seed,
        "duration_s": scenario.duration_s,
        **counts,
        "gyroscope": int(recording.gyroscope.size),
        "accelerometer": int(recording.accelerometer.size),
    }
