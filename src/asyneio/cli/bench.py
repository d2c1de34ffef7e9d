"""`asyneio bench`: accuracy on whole data sets next to published figures, and speed against a baseline."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.options import (
    CalibrationOption,
    CameraOption,
    ConfigOption,
    ImuOption,
    PresetOption,
    SchemeOption,
    TrackerOption,
    settings_of,
    with_scheme,
    with_tracker,
)

if TYPE_CHECKING:
    from asyneio.config import Config
    from asyneio.io import ReadOptions
    from asyneio.studies.measuring import Measured
    from asyneio.studies.speed_report import Comparison
    from asyneio.studies.speed_run import Figures
    from asyneio.studies.speed_workload import Workload
    from asyneio.studies.uzh import BenchSettings, SequenceTask

bench = typer.Typer(
    help="Measure accuracy on whole data sets, next to published figures, and speed.", no_args_is_help=True
)

RESULTS_FILE, TABLES_FILE, JSON_FILE = "results.jsonl", "README.md", "results.json"

#: Default length of the simulated stream [s].
_SIMULATED_S = 10.0

_Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
_UzhData = Annotated[Path, typer.Option(help="Folder with the sequences: folders, .bag or .zip files.")]
_UzhOutput = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")]
_Sequences = Annotated[
    str | None,
    typer.Option(help="Names, separated by commas.", show_default="all available with translation"),
]
_FirstSeconds = Annotated[
    float | None, typer.Option(help="Use the first seconds only [s].", min=1.0, show_default="all")
]
_Workers = Annotated[int, typer.Option(help="Sequences processed in parallel.", min=1, max=16)]
_UzhPreset = Annotated[
    str, typer.Option(help="Camera model whose published values fill gaps in the calibration; '' for none.")
]
_UzhCalibration = Annotated[
    Path | None,
    typer.Option(help="Camera calibration file (any supported format).", show_default="preset"),
]
_UzhImu = Annotated[
    Path | None, typer.Option(help="IMU noise file (any supported format).", show_default="preset")
]
_Recording = Annotated[
    Path | None,
    typer.Option(help="Recording of events with an IMU.", show_default="a simulated stream, 1 Mev/s"),
]
_Seconds = Annotated[
    float | None,
    typer.Option(help="Length to use [s].", min=1.0, show_default="10, or all of a recording"),
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


@bench.callback()
def _benchmarks() -> None:
    """Measure accuracy on whole data sets, next to published figures, and speed."""


@bench.command(epilog="Example: asyneio bench uzh --data recordings/uzh --sequences boxes_6dof,poster_6dof")
def uzh(
    data: _UzhData,
    output: _UzhOutput = Path("results/bench-uzh"),
    sequences: _Sequences = None,
    seconds: _FirstSeconds = None,
    workers: _Workers = 1,
    preset: _UzhPreset = "DAVIS240C",
    calibration: _UzhCalibration = None,
    imu: _UzhImu = None,
    camera: CameraOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    as_json: _Json = False,
) -> None:
    """Run the sequences of the UZH event camera data set (DAVIS240C) and compare with published figures.

    Writes README.md (tables), results.json and results.jsonl. Each result is
    saved at once: the same command continues an interrupted run. The exit
    status is not 0 if a sequence failed.
    """
    from asyneio.cli import console
    from asyneio.io.parsing.atomic import make_folder
    from asyneio.studies.uzh import BenchSettings, find_sequences

    names = tuple(name.strip() for name in (sequences or "").split(",") if name.strip())
    tasks = find_sequences(data, names, seconds or 0.0)
    settings = BenchSettings(
        with_scheme(with_tracker(settings_of(config, preset or None), tracker), scheme),
        preset or None,
        str(calibration.resolve()) if calibration else None,
        str(imu.resolve()) if imu else None,
        camera,
    )
    make_folder(output)
    console.say(f"{len(tasks)} sequence(s): {', '.join(task.sequence for task in tasks)}")
    measured = _measure(tasks, settings, workers, output / RESULTS_FILE)
    _write_tables(measured, output, as_json)
    _check_sequences(measured, len(tasks))


def _measure(tasks: tuple[SequenceTask, ...], settings: BenchSettings, workers: int, path: Path) -> Measured:
    from functools import partial

    from asyneio.cli.progress import task_progress
    from asyneio.studies.measuring import measure_missing
    from asyneio.studies.uzh import measure_sequence

    measure = partial(measure_sequence, settings=settings)
    with task_progress("uzh") as progress:
        return measure_missing(path, measure, tasks, settings.fingerprint, workers, progress)


def _write_tables(measured: Measured, folder: Path, as_json: bool) -> None:
    """Write and print tables or JSON, with notes on earlier results."""
    import json

    from asyneio.cli import console
    from asyneio.io.parsing.atomic import write_text
    from asyneio.studies.uzh_report import report_json, report_markdown

    command = shlex.join(["asyneio", *sys.argv[1:]])
    plain = json.dumps(report_json(measured.records, command), indent=2)
    tables = report_markdown(measured.records, command)
    write_text(folder / TABLES_FILE, tables)
    write_text(folder / JSON_FILE, plain + "\n")
    typer.echo(plain if as_json else tables.rstrip())
    if measured.reused:
        console.say(f"note: {measured.reused} result(s) of an earlier run were reused")
    if measured.other_code:
        console.say(
            f"note: some of them are from other versions of the code ({', '.join(measured.other_code)}); "
            f"remove {folder / RESULTS_FILE} to measure them again"
        )
    for name in (TABLES_FILE, JSON_FILE, RESULTS_FILE):
        console.say(f"wrote {folder / name}")


def _check_sequences(measured: Measured, total: int) -> None:
    """Check that no sequence failed. Raises StudyError."""
    from asyneio.errors import StudyError

    failed = [record for record in measured.records if record.failure]
    if failed:
        reasons = "; ".join(f"{record.task['sequence']}: {record.failure}" for record in failed)
        raise StudyError(
            f"{len(failed)} of {total} sequences failed: {reasons}. The same command tries them again"
        )


@bench.command(epilog="Example: asyneio bench speed --beside 2 --paced -o speed.json")
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
    as_json: _Json = False,
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
