# SPDX-License-Identifier: Apache-2.0
"""`asyneio bench speed`: the speed of every stage against a baseline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.options import (
    CalibrationOption,
    ConfigOption,
    ImuOption,
    PresetOption,
    SchemeOption,
    TablesJsonOption,
    TrackerOption,
    settings_of,
    with_scheme,
    with_tracker,
)

if TYPE_CHECKING:
    from asyneio.config import Config
    from asyneio.io import ReadOptions
    from asyneio.studies.speed_report import Comparison
    from asyneio.studies.speed_run import Figures
    from asyneio.studies.speed_workload import Workload

#: Default length of the simulated stream [s].
_SIMULATED_S = 10.0

_Recording = Annotated[
    Path | None,
    typer.Option(help="Recording of events with an IMU.", show_default="a simulated stream, 1 Mev/s"),
]
_Seconds = Annotated[
    float | None,
    typer.Option(help="Seconds to use.", min=1.0, show_default="10, or all of a recording"),
]
_Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="Write the figures as JSON; usable as a baseline.")
]
_Repeats = Annotated[int, typer.Option(help="Number of repetitions; medians count.", min=1, max=100)]
_Beside = Annotated[
    int, typer.Option(help="Measure again with this many processes that keep cores busy.", min=0, max=64)
]
_Paced = Annotated[bool, typer.Option("--paced", help="Also measure the latency at the recorded pace.")]
_Cold = Annotated[
    bool, typer.Option("--cold", help="Also measure a start without compiled kernels; takes minutes.")
]
_Baseline = Annotated[
    Path | None, typer.Option(help="Earlier figures to compare with.", show_default="the package's own")
]
_Gate = Annotated[
    float | None,
    typer.Option(help="Fail if a stage takes more than this many times the baseline.", min=0.0),
]


def speed(
    recording: _Recording = None,
    seconds: _Seconds = None,
    output: _Output = None,
    repeats: _Repeats = 3,
    beside: _Beside = 0,
    paced: _Paced = False,
    cold: _Cold = False,
    baseline: _Baseline = None,
    gate: _Gate = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    preset: PresetOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    as_json: TablesJsonOption = False,
) -> None:
    """Measure the speed of front end, estimator and pipeline by stage, and compare with a baseline.

    The simulated stream is generated once and cached. Times are compared
    relative to a reference workload that is measured in the same run, so the
    baseline may come from another machine. The exit status is 1 if the gate is
    exceeded or there is nothing to compare with.
    """
    from asyneio.cli.progress import task_progress
    from asyneio.io import ReadOptions
    from asyneio.studies.speed import SpeedOptions, measure_speed
    from asyneio.studies.speed_report import compare

    settings = with_scheme(with_tracker(settings_of(config, preset), tracker), scheme)
    # Read first, so that a wrong file is reported at once.
    earlier = _baseline(baseline, gate)
    workload = _workload(recording, seconds, settings, ReadOptions(calibration, imu, preset=preset))
    with task_progress("speed") as progress:
        found = measure_speed(workload, SpeedOptions(repeats, beside, paced, cold), progress)
    comparison = compare(found, earlier)
    _write_speed(found, comparison, output, as_json)
    _check_gate(comparison, gate)


def _workload(
    recording: Path | None, seconds: float | None, settings: Config, options: ReadOptions
) -> Workload:
    """The recording, or the simulated stream; converted into the cache, so that measuring only opens it."""
    from asyneio.cli.progress import reading_progress, share_progress
    from asyneio.studies.speed_workload import Workload, simulated_workload

    if recording is None:
        with share_progress("simulating") as advance:
            workload = simulated_workload(seconds or _SIMULATED_S, settings, progress=advance)
    else:
        workload = Workload(recording.name, recording, seconds or 0.0, settings, options)
    with reading_progress(workload.path) as advance:
        workload.open(advance)
    return workload


def _baseline(path: Path | None, gate: float | None) -> Figures | None:
    """Earlier figures, by default those of the package. Raises StudyError: none, although there is a gate."""
    from asyneio.errors import StudyError
    from asyneio.studies.speed_report import NO_BASELINE, package_baseline, read_baseline

    earlier = package_baseline() if path is None else read_baseline(path)
    if gate is not None and earlier is None:
        raise StudyError(f"the gate needs a baseline: {NO_BASELINE}")
    return earlier


def _write_speed(found: Figures, comparison: Comparison, output: Path | None, as_json: bool) -> None:
    from asyneio.cli import console
    from asyneio.io.parsing.atomic import write_text
    from asyneio.studies.speed_report import speed_json, speed_markdown

    plain = speed_json(found, comparison)
    if output is not None:
        write_text(output, plain)
    typer.echo((plain if as_json else speed_markdown(found, comparison)).rstrip())
    if found["pipeline"]["failure"]:
        console.say(f"note: the measured run is incomplete: {found['pipeline']['failure']}")
    if comparison.why_not:
        console.say(f"note: not compared with the baseline: {comparison.why_not}")


def _check_gate(comparison: Comparison, gate: float | None) -> None:
    """Check the speed against the baseline. Raises StudyError: too slow, or nothing to compare with."""
    from asyneio.errors import StudyError

    if gate is None:
        return
    if comparison.why_not:
        raise StudyError(
            f"the gate needs a baseline of the same workload: {comparison.why_not}; make one with "
            "-o FILE and pass it with --baseline FILE"
        )
    slower = comparison.slower_than(gate)
    if slower:
        stages = ", ".join(f"{name} {ratio:.2f}" for name, ratio in slower.items())
        raise StudyError(
            f"slower than {gate:g} times the baseline: {stages}; measure again on an idle machine, then look "
            "for the change that caused it"
        )
