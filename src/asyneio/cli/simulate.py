# SPDX-License-Identifier: Apache-2.0
"""`asyneio simulate`: a recording of feature tracks, or of events, with exact ground truth."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from asyneio.pipeline.recorded_motion import RecordedFiles
    from asyneio.simulation import EventScenario, Scenario
    from asyneio.simulation.path_fit import PathFit
    from asyneio.types import EventRecording, Recording


class EventFormat(StrEnum):
    """File formats of simulated events."""

    UZH = "uzh"
    HDF5 = "hdf5"


_REAL = "Along a recorded motion"
_Scenario = Annotated[
    str,
    typer.Argument(help="Scenario (of events: event_..., suite_...); an unknown name lists all."),
]
_Output = Annotated[Path, typer.Option("--output", "-o", help="Folder for the recording.")]
_Seed = Annotated[
    int | None, typer.Option(help="Random seed.", min=0, show_default="that of the scenario, mostly 0")
]
_Duration = Annotated[
    float | None, typer.Option(help="Length in seconds.", show_default="that of the scenario")
]
_Format = Annotated[
    EventFormat, typer.Option("--format", help="File format of events: UZH text folder, or HDF5.")
]
_ImuModel = Annotated[
    str | None,
    typer.Option(
        help="IMU model to simulate, such as MPU-6150, or ideal; an unknown name lists all.",
        show_default="that of the scenario",
    ),
]
_Json = Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")]
_Poses = Annotated[
    Path | None,
    typer.Option(help="Recorded trajectory of an IMU to follow (EuRoC, TUM, ...).", rich_help_panel=_REAL),
]
_Samples = Annotated[
    Path | None, typer.Option(help="Recorded samples of that IMU, kept unchanged.", rich_help_panel=_REAL)
]
_From = Annotated[
    float,
    typer.Option("--from", help="Seconds after the first common time.", min=0.0, rich_help_panel=_REAL),
]
_Imu = Annotated[
    Path | None,
    typer.Option(help="Noise file of that IMU (any supported format).", rich_help_panel=_REAL),
]
_Calibration = Annotated[
    Path | None,
    typer.Option(
        help="Calibration of the camera to simulate (any supported format).",
        show_default="that of the scenario",
        rich_help_panel=_REAL,
    ),
]


def simulate(
    scenario: _Scenario,
    output: _Output,
    seed: _Seed = None,
    duration: _Duration = None,
    event_format: _Format = EventFormat.UZH,
    imu_model: _ImuModel = None,
    as_json: _Json = False,
    poses: _Poses = None,
    samples: _Samples = None,
    begin: _From = 0.0,
    imu: _Imu = None,
    calibration: _Calibration = None,
) -> None:
    """Simulate feature tracks or events, inertial samples and ground truth.

    Feature tracks are written as a tracks folder, events as a UZH text folder
    or as one HDF5 file.

    Hybrid recording of real motion, real inertial samples, simulated events:

        asyneio simulate event_slow -o recordings/hybrid --imu imu0/sensor.yaml
        --poses state_groundtruth_estimate0/data.csv --samples imu0/data.csv
    """
    import json

    from asyneio.io.parsing.atomic import make_folder
    from asyneio.pipeline.recorded_motion import RecordedFiles
    from asyneio.simulation import EventScenario

    _check_recorded(scenario, poses, [samples, imu, calibration], begin)
    chosen = _scenario(scenario, seed, duration, imu_model)
    if isinstance(chosen, EventScenario):
        fitted: dict[str, Any] = {}
        if poses is not None:
            files = RecordedFiles(poses, samples, imu, calibration, begin, duration)
            chosen, fitted = _along(chosen, files)
        make_folder(output)
        written = _simulate_events(chosen, output, event_format) | fitted
    else:
        make_folder(output)
        written = _simulate_tracks(chosen, output)
    if as_json:
        typer.echo(json.dumps({"folder": str(output), **written}, indent=2))


def _check_recorded(scenario: str, poses: Path | None, others: list[Path | None], begin_s: float) -> None:
    """Check the options of a recorded motion. Raises SimulationError."""
    from asyneio.errors import SimulationError
    from asyneio.simulation import SCENARIOS

    if poses is None and (any(others) or begin_s):
        raise SimulationError("--samples, --from, --imu and --calibration require --poses FILE")
    if poses is not None and scenario in SCENARIOS:
        raise SimulationError(
            f"scenario {scenario!r} simulates feature tracks; --poses requires a scenario of events "
            "(event_slow, ...)"
        )


def _scenario(
    name: str, seed: int | None, duration_s: float | None, imu_model: str | None
) -> Scenario | EventScenario:
    from asyneio.simulation import imu_named, with_imu
    from asyneio.simulation.scenarios import scenario_named, with_seed_and_duration

    sensor = None if imu_model is None else imu_named(imu_model)
    scenario = with_seed_and_duration(scenario_named(name), seed, duration_s)
    return scenario if sensor is None else with_imu(scenario, sensor)


def _along(scenario: EventScenario, files: RecordedFiles) -> tuple[EventScenario, dict[str, Any]]:
    """The scenario along a recorded motion, and the figures of the fit."""
    from asyneio.cli import console
    from asyneio.pipeline.recorded_motion import recorded_scenario

    console.say(f"fitting a path to {files.poses} ...")
    recorded = recorded_scenario(scenario, files)
    for note in recorded.notes:
        console.say(f"note: {note}")
    console.say(_fit_sentence(recorded.fit))
    return recorded.scenario, {"path": _fit_figures(recorded.fit)}


def _fit_figures(fit: PathFit) -> dict[str, Any]:
    from dataclasses import asdict

    import numpy as np

    known = {name: value for name, value in asdict(fit.residuals).items() if np.isfinite(value)}
    return {
        "left_over_rms": known,
        "gravity": float(np.linalg.norm(fit.gravity)),
        "clock_offset_s": fit.clock_offset_s,
    }


def _fit_sentence(fit: PathFit) -> str:
    import numpy as np

    r = fit.residuals
    text = f"path of {fit.duration_s:.1f} s; residuals (RMS): {1e3 * r.position:.2f} mm, "
    text += f"{np.degrees(r.orientation):.3f} deg"
    if np.isfinite(r.gyroscope):
        text += (
            f", gyroscope {r.gyroscope:.4f} rad/s ({r.gyroscope_sigmas:.1f} x the given noise), "
            f"accelerometer {r.accelerometer:.3f} m/s^2 ({r.accelerometer_sigmas:.1f} x); gravity "
            f"{np.linalg.norm(fit.gravity):.3f} m/s^2, t_imu - t_pose {1e3 * fit.clock_offset_s:+.2f} ms"
        )
    return text


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
    from asyneio.cli.progress import share_progress
    from asyneio.pipeline.simulated import write_simulated_events

    console.say(f"simulating {scenario.name}, seed {scenario.seed}, {scenario.duration_s:g} s ...")
    started = time.perf_counter()
    with share_progress("simulating", scenario.duration_s, "x real time") as advance:
        simulation, count = write_simulated_events(
            scenario, folder, event_format is EventFormat.HDF5, advance
        )
    seconds, recording = time.perf_counter() - started, simulation.recording
    mega = count / 1e6
    console.say(
        f"wrote {folder}: {scenario.duration_s:g} s, {mega:.2f} Mev "
        f"(camera: {mega / scenario.duration_s:.2f} Mev/s, simulation: {mega / seconds:.2f} Mev/s), "
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
