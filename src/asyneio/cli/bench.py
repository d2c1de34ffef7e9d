"""`asyneio bench`: whole data sets beside what is published of them, and speed beside what it was."""

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
    from asyneio.studies.measuring import Measured
    from asyneio.studies.speed_report import Comparison
    from asyneio.studies.speed_run import Figures

bench = typer.Typer(
    help="Measure accuracy on whole data sets, beside published figures, and speed.", no_args_is_help=True
)

RESULTS_FILE, TABLES_FILE, JSON_FILE = "results.jsonl", "README.md", "results.json"

#: Length of the simulated stream [s] unless told otherwise.
_SIMULATED_S = 10.0


@bench.callback()
def _benchmarks() -> None:
    """Measure accuracy on whole data sets, beside published figures, and speed."""


@bench.command(epilog="Example: asyneio bench uzh --data recordings/uzh --sequences boxes_6dof,poster_6dof")
def uzh(
    data: Annotated[Path, typer.Option(help="Folder that holds the sequences: folders, .bag or .zip files.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "results/bench-uzh"
    ),
    sequences: Annotated[
        str | None,
        typer.Option(help="Names, separated by commas.", show_default="all that are there and translate"),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Only the first so many seconds.", min=1.0, show_default="all")
    ] = None,
    workers: Annotated[int, typer.Option(help="Sequences at a time.", min=1, max=16)] = 1,
    preset: Annotated[
        str, typer.Option(help="Figures for what neither the data nor --calibration tell; '' for none.")
    ] = "DAVIS240C",
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration of the camera, any usual kind.", show_default="preset")
    ] = None,
    imu: Annotated[
        Path | None, typer.Option(help="Noise of the IMU, any usual kind.", show_default="preset")
    ] = None,
    camera: CameraOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Run the sequences of the UZH event camera data set (DAVIS240C) and compare with published figures.

    Writes README.md (tables), results.json and results.jsonl, in which each result is kept as it comes: the
    same command goes on where it was stopped. The exit status is not 0 when a sequence failed.
    """
    import json
    from functools import partial

    from asyneio.cli import console
    from asyneio.cli.progress import task_progress
    from asyneio.errors import StudyError
    from asyneio.io.parsing.atomic import make_folder, write_text
    from asyneio.studies.measuring import measure_missing
    from asyneio.studies.uzh import BenchSettings, find_sequences, measure_sequence
    from asyneio.studies.uzh_report import report_json, report_markdown

    names = tuple(name.strip() for name in (sequences or "").split(",") if name.strip())
    tasks = find_sequences(data, names, seconds or 0.0)
    chosen = with_scheme(with_tracker(settings_of(config, preset or None), tracker), scheme)
    settings = BenchSettings(
        chosen,
        preset or None,
        str(calibration.resolve()) if calibration else None,
        str(imu.resolve()) if imu else None,
        camera,
    )
    make_folder(output)
    console.say(f"{len(tasks)} sequence(s): {', '.join(task.sequence for task in tasks)}")
    measure = partial(measure_sequence, settings=settings)
    path = output / RESULTS_FILE
    with task_progress("uzh") as progress:
        measured = measure_missing(path, measure, tasks, settings.fingerprint, workers, progress)
    command = shlex.join(["asyneio", *sys.argv[1:]])
    plain = json.dumps(report_json(measured.records, command), indent=2)
    tables = report_markdown(measured.records, command)
    write_text(output / TABLES_FILE, tables)
    write_text(output / JSON_FILE, plain + "\n")
    typer.echo(plain if as_json else tables.rstrip())
    _say(measured, path)
    for name in (TABLES_FILE, JSON_FILE, RESULTS_FILE):
        console.say(f"wrote {output / name}")
    failed = [record for record in measured.records if record.failure]
    if failed:
        reasons = "; ".join(f"{record.task['sequence']}: {record.failure}" for record in failed)
        raise StudyError(
            f"{len(failed)} of {len(tasks)} sequences failed: {reasons}. The same command tries them again"
        )


def _say(measured: Measured, path: Path) -> None:
    from asyneio.cli import console

    if measured.reused:
        console.say(f"note: {measured.reused} result(s) of an earlier run were kept")
    if measured.other_code:
        console.say(
            f"note: some of them are of other code ({', '.join(measured.other_code)}); "
            f"remove {path} to measure them anew"
        )


@bench.command(epilog="Example: asyneio bench speed --beside 2 --paced -o speed.json")
def speed(
    recording: Annotated[
        Path | None,
        typer.Option(help="Events with an IMU of your own.", show_default="a simulated stream, 1 Mev/s"),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(help="How much of it.", min=1.0, show_default="10, or all of a recording"),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the figures as JSON; usable as a baseline.")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Measure so often; medians count.", min=1, max=100)] = 3,
    beside: Annotated[
        int, typer.Option(help="Also beside so many processes that keep cores busy.", min=0, max=64)
    ] = 0,
    paced: Annotated[
        bool, typer.Option("--paced", help="Also the latency with events at the pace of the recording.")
    ] = False,
    cold: Annotated[
        bool, typer.Option("--cold", help="Also a start without compiled kernels; takes minutes.")
    ] = False,
    baseline: Annotated[
        Path | None, typer.Option(help="Earlier figures to compare with.", show_default="the package's own")
    ] = None,
    gate: Annotated[
        float | None,
        typer.Option(help="Fail where a stage takes more than so many times the baseline.", min=0.0),
    ] = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    preset: PresetOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Measure the speed of front end, estimator and pipeline, stage by stage, and compare with a baseline.

    The simulated stream is made once and kept in the cache. Times are compared over those of a fixed piece of
    work measured alongside, so the baseline may be of another machine. The exit status is 1 when the gate is
    exceeded, or when there is nothing to compare with.
    """
    from asyneio.cli.progress import reading_progress, share_progress, task_progress
    from asyneio.errors import StudyError
    from asyneio.io import ReadOptions
    from asyneio.io.parsing.atomic import write_text
    from asyneio.studies.speed import SpeedOptions, measure_speed
    from asyneio.studies.speed_report import (
        NO_BASELINE,
        compare,
        package_baseline,
        read_baseline,
        speed_json,
        speed_markdown,
    )
    from asyneio.studies.speed_workload import Workload, simulated_workload

    settings = with_scheme(with_tracker(settings_of(config, preset), tracker), scheme)
    # Read first: a wrong file is not found out after minutes.
    earlier = package_baseline() if baseline is None else read_baseline(baseline)
    if gate is not None and earlier is None:
        raise StudyError(f"the gate needs a baseline: {NO_BASELINE}")
    if recording is None:
        with share_progress("simulating") as advance:
            workload = simulated_workload(seconds or _SIMULATED_S, settings, progress=advance)
    else:
        options = ReadOptions(calibration, imu, preset=preset)
        workload = Workload(recording.name, recording, seconds or 0.0, settings, options)
    # Converted into the cache here, so that the process that measures only opens it.
    with reading_progress(workload.path) as advance:
        workload.open(advance)
    with task_progress("speed") as progress:
        found = measure_speed(workload, SpeedOptions(repeats, beside, paced, cold), progress)
    comparison = compare(found, earlier)
    plain = speed_json(found, comparison)
    if output is not None:
        write_text(output, plain)
    typer.echo((plain if as_json else speed_markdown(found, comparison)).rstrip())
    _judge(found, comparison, gate)


def _judge(found: Figures, comparison: Comparison, gate: float | None) -> None:
    """Notes on standard error; raises StudyError where the gate is exceeded or cannot be applied."""
    from asyneio.cli import console
    from asyneio.errors import StudyError

    if found["pipeline"]["failure"]:
        console.say(f"note: the run that was measured is not whole: {found['pipeline']['failure']}")
    if comparison.why_not:
        console.say(f"note: not compared with the baseline: {comparison.why_not}")
    if gate is None:
        return
    if comparison.why_not:
        raise StudyError(
            f"the gate needs a baseline of the same workload: {comparison.why_not}; make one with "
            "-o FILE and name it with --baseline FILE"
        )
    slower = comparison.slower_than(gate)
    if slower:
        stages = ", ".join(f"{name} {ratio:.2f}" for name, ratio in slower.items())
        raise StudyError(
            f"slower than {gate:g} times the baseline: {stages}; measure again on a quiet machine, then look "
            "at what has changed"
        )
