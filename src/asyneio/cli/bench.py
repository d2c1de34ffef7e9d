"""`asyneio bench`: whole data sets, beside what is published of them."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.options import (
    CameraOption,
    ConfigOption,
    SchemeOption,
    TrackerOption,
    settings_of,
    with_scheme,
    with_tracker,
)

if TYPE_CHECKING:
    from asyneio.studies.measuring import Measured

bench = typer.Typer(help="Measure whole data sets, beside published figures.", no_args_is_help=True)

RESULTS_FILE, TABLES_FILE, JSON_FILE = "results.jsonl", "README.md", "results.json"


@bench.callback()
def _benchmarks() -> None:
    """Measure whole data sets, beside published figures."""


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
    from asyneio.io.atomic import make_folder, write_text
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
