# SPDX-License-Identifier: Apache-2.0
"""`asyneio bench`: accuracy on whole data sets next to published figures, and speed against a baseline."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.bench_speed import speed
from asyneio.cli.options import (
    CameraOption,
    ConfigOption,
    SchemeOption,
    TablesJsonOption,
    TrackerOption,
    settings_of,
    with_scheme,
    with_tracker,
)

if TYPE_CHECKING:
    from asyneio.studies.measuring import Measured
    from asyneio.studies.uzh import BenchSettings, SequenceTask

bench = typer.Typer(
    help="Measure accuracy on whole data sets, next to published figures, and speed.", no_args_is_help=True
)

RESULTS_FILE, TABLES_FILE, JSON_FILE = "results.jsonl", "README.md", "results.json"

_UzhData = Annotated[Path, typer.Option(help="Folder with the sequences: folders, .bag or .zip files.")]
_UzhOutput = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")]
_Sequences = Annotated[
    str | None,
    typer.Option(help="Names, separated by commas.", show_default="all available with translation"),
]
_FirstSeconds = Annotated[
    float | None, typer.Option(help="Use only this many seconds from the start.", min=1.0, show_default="all")
]
_Workers = Annotated[int, typer.Option(help="Sequences processed in parallel.", min=1, max=16)]
_Cluster = Annotated[
    str | None,
    typer.Option(
        help="Address of a Dask scheduler, such as tcp://host:8786: its workers run the sequences.",
        show_default="processes on this computer",
    ),
]
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
    cluster: _Cluster = None,
    preset: _UzhPreset = "DAVIS240C",
    calibration: _UzhCalibration = None,
    imu: _UzhImu = None,
    camera: CameraOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    as_json: TablesJsonOption = False,
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
    measured = _measure(tasks, settings, workers, output / RESULTS_FILE, cluster)
    _write_tables(measured, output, as_json)
    _check_sequences(measured, len(tasks))


def _measure(
    tasks: tuple[SequenceTask, ...],
    settings: BenchSettings,
    workers: int,
    path: Path,
    cluster: str | None,
) -> Measured:
    from functools import partial

    from asyneio.cli.progress import task_progress
    from asyneio.studies.measuring import measure_missing
    from asyneio.studies.uzh import measure_sequence

    measure = partial(measure_sequence, settings=settings)
    with task_progress("uzh") as progress:
        return measure_missing(path, measure, tasks, settings.fingerprint, workers, progress, cluster)


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
    for record in measured.records:
        if record.restarts:
            console.say(
                f"note: {record.task['sequence']} was run again {record.restarts} time(s), as its worker died"
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


bench.command(epilog="Example: asyneio bench speed --beside 2 --paced -o speed.json")(speed)
