# SPDX-License-Identifier: Apache-2.0
"""`asyneio bench SUITE`: recordings of a data set times schemes times settings times seeds, as tables."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.options import (
    CameraOption,
    ConfigOption,
    SchemeName,
    TablesJsonOption,
    TrackerName,
    TrackerOption,
    settings_of,
    with_tracker,
)

if TYPE_CHECKING:
    from asyneio.studies.measuring import Measured
    from asyneio.studies.suites.data_set import DataSet
    from asyneio.studies.suites.jobs import BenchSettings, BenchTask
    from asyneio.studies.suites.report import BenchReport

RESULTS_FILE, TABLES_FILE, JSON_FILE = "results.jsonl", "README.md", "results.json"
#: Number of failures in the error message; the tables list all.
_SHOWN = 3

_Folder = Annotated[Path, typer.Argument(help="Folder with the sequences as they were downloaded.")]
_Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder for the results.", show_default="results/bench-SUITE"),
]
_Sequences = Annotated[
    str | None,
    typer.Option(help="Names, separated by commas.", show_default="those of the suite that exist"),
]
_Schemes = Annotated[
    str | None,
    typer.Option(help="Inertial schemes to compare, separated by commas.", show_default="as configured"),
]
_Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Setting with values to compare: section.name=value,value. May be repeated.",
        metavar="KEY=VALUES",
    ),
]
_Seeds = Annotated[
    int, typer.Option(help="Number of random seeds; recorded data have one, as nothing is random.", min=1)
]
_FirstSeconds = Annotated[
    float | None, typer.Option(help="Use only this many seconds from the start.", min=1.0, show_default="all")
]
_Jobs = Annotated[
    int, typer.Option(help="Number of parallel processes; each run uses up to two cores.", min=1, max=64)
]
_Cluster = Annotated[
    str | None,
    typer.Option(
        help="Address of a Dask scheduler, such as tcp://host:8786: its workers run the jobs.",
        show_default="processes on this computer",
    ),
]
_CameraModel = Annotated[
    str | None,
    typer.Option(
        "--preset",
        help="Camera model whose published values fill gaps in the calibration; '' for none.",
        show_default="that of the suite",
    ),
]
_Calibration = Annotated[
    Path | None,
    typer.Option(help="Camera calibration file (any supported format).", show_default="of the data set"),
]
_Imu = Annotated[
    Path | None, typer.Option(help="IMU noise file (any supported format).", show_default="of the data set")
]


@dataclass(frozen=True)
class _Request:
    """Options of the command."""

    suite: str
    folder: Path | None
    output: Path | None
    sequences: str | None
    schemes: str | None
    assignments: list[str]
    seeds: int
    seconds: float | None
    jobs: int
    cluster: str | None
    config: Path | None
    tracker: TrackerName | None
    as_json: bool
    preset: str | None = None
    calibration: Path | None = None
    imu: Path | None = None
    camera: str | None = None


def _data_set_command(suite: str, what: str) -> Callable[..., None]:
    """The command of a data set."""

    def command(
        folder: _Folder,
        output: _Output = None,
        sequences: _Sequences = None,
        schemes: _Schemes = None,
        assignments: _Set = None,
        seeds: _Seeds = 1,
        seconds: _FirstSeconds = None,
        jobs: _Jobs = 1,
        cluster: _Cluster = None,
        preset: _CameraModel = None,
        calibration: _Calibration = None,
        imu: _Imu = None,
        camera: CameraOption = None,
        config: ConfigOption = None,
        tracker: TrackerOption = None,
        as_json: TablesJsonOption = False,
    ) -> None:
        _bench(
            _Request(
                suite, folder, output, sequences, schemes, assignments or [], seeds, seconds, jobs, cluster,
                config, tracker, as_json, preset, calibration, imu, camera,
            )
        )  # fmt: skip

    command.__doc__ = f"Run {what} and compare with published figures.\n\n{_MORE}"
    return command


def _simulated_command(suite: str, what: str) -> Callable[..., None]:
    """The command of simulated recordings, which has no files."""

    def command(
        output: _Output = None,
        sequences: _Sequences = None,
        schemes: _Schemes = None,
        assignments: _Set = None,
        seeds: _Seeds = 1,
        seconds: _FirstSeconds = None,
        jobs: _Jobs = 1,
        cluster: _Cluster = None,
        config: ConfigOption = None,
        tracker: TrackerOption = None,
        as_json: TablesJsonOption = False,
    ) -> None:
        _bench(
            _Request(
                suite, None, output, sequences, schemes, assignments or [], seeds, seconds, jobs, cluster,
                config, tracker, as_json,
            )
        )  # fmt: skip

    command.__doc__ = f"Run {what}.\n\n{_MORE}"
    return command


_MORE = """Every recording is run with every scheme, setting and seed. Writes README.md
    (tables), results.json and results.jsonl. Each result is saved at once: the
    same command continues an interrupted run. The exit status is not 0 if a
    result failed or is missing.
"""

#: Commands by name, with the arguments of an example.
COMMANDS: dict[str, tuple[Callable[..., None], str]] = {
    "uzh": (
        _data_set_command("uzh", "the UZH event camera data set (DAVIS240C)"),
        "recordings/uzh --sequences boxes_6dof,poster_6dof --schemes gpif,gpp",
    ),
    "tum-vie": (_data_set_command("tum-vie", "TUM-VIE"), "recordings/tum-vie --jobs 2"),
    "vector": (_data_set_command("vector", "VECtor"), "recordings/vector --sequences desk_normal"),
    "mvsec": (_data_set_command("mvsec", "MVSEC (indoor flying)"), "recordings/mvsec"),
    "dsec": (
        _data_set_command("dsec", "DSEC (IMU, extrinsics and ground truth from elsewhere)"),
        "recordings/dsec",
    ),
    "evslam": (
        _data_set_command("evslam", "the EvSLAM benchmark"),
        "recordings/EvSLAM --cluster tcp://192.168.0.10:8786",
    ),
    "simulated": (
        _simulated_command("simulated", "simulated sequences, which need no data set"),
        "--sequences moderate,aggressive --seconds 10 --seeds 3 --set window.length_s=1,2",
    ),
}


def _bench(request: _Request) -> None:
    from asyneio.cli import console
    from asyneio.io.parsing.atomic import make_folder
    from asyneio.studies.suites.catalogue import SUITES
    from asyneio.studies.suites.report import BenchReport

    suite = SUITES[request.suite]
    tasks, settings = _prepare(suite, request)
    output = request.output or Path("results") / f"bench-{suite.name}"
    make_folder(output)
    names = list(dict.fromkeys(task.sequence for task in tasks))
    console.say(f"{len(tasks)} job(s) of {len(names)} recording(s): {', '.join(names)}")
    measured = _measure(tasks, settings, request, output / RESULTS_FILE)
    command = shlex.join(["asyneio", *sys.argv[1:]])
    missing = tuple(task for task in tasks if task in measured.missing)
    report = BenchReport(suite, measured.records, missing, command)
    _write_tables(report, output, request.as_json)
    _say_notes(report, measured, output)
    _check(report, measured)


def _prepare(suite: DataSet, request: _Request) -> tuple[tuple[BenchTask, ...], BenchSettings]:
    """Jobs and their common settings; every condition is checked before anything runs.

    Raises:
        StudyError, ConfigError: something is missing or invalid.
    """
    from asyneio.studies.suites.finding import Given, find_recordings
    from asyneio.studies.suites.jobs import BenchSettings, Grid, configured, jobs, variants_of

    schemes = tuple(_scheme(name) for name in _names(request.schemes)) or ("",)
    variants = variants_of(request.assignments)
    preset = (suite.preset if request.preset is None else request.preset) or None
    config = with_tracker(settings_of(request.config, preset), request.tracker)
    for scheme in schemes:
        for variant in variants:
            configured(config, scheme, variant)
    given = Given(request.calibration, request.imu)
    found = find_recordings(suite, request.folder, _names(request.sequences), given)
    grid = Grid(schemes, variants, request.seeds, request.seconds or 0.0)
    return jobs(suite, found, grid), BenchSettings(suite.name, config, preset, request.camera)


def _names(text: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in (text or "").split(",") if name.strip())


def _scheme(name: str) -> str:
    """Raises StudyError: unknown."""
    from asyneio.errors import StudyError

    if name not in list(SchemeName):
        raise StudyError(f"scheme {name!r} is unknown; expected one of {', '.join(SchemeName)}")
    return name


def _measure(
    tasks: tuple[BenchTask, ...], settings: BenchSettings, request: _Request, path: Path
) -> Measured:
    from functools import partial

    from asyneio.cli.progress import task_progress
    from asyneio.studies.measuring import measure_missing
    from asyneio.studies.suites.measure import measure_job

    measure = partial(measure_job, settings=settings)
    jobs = min(request.jobs, len(tasks), os.cpu_count() or 1)
    with task_progress(request.suite) as progress:
        return measure_missing(path, measure, tasks, settings.fingerprint, jobs, progress, request.cluster)


def _write_tables(report: BenchReport, folder: Path, as_json: bool) -> None:
    """Write and print tables or JSON."""
    import json

    from asyneio.io.parsing.atomic import write_text
    from asyneio.studies.suites.report import report_json, report_markdown

    plain = json.dumps(report_json(report), indent=2)
    tables = report_markdown(report)
    write_text(folder / TABLES_FILE, tables)
    write_text(folder / JSON_FILE, plain + "\n")
    typer.echo(plain if as_json else tables.rstrip())


def _say_notes(report: BenchReport, measured: Measured, folder: Path) -> None:
    """Notes on earlier results and on what ran again; the written files."""
    from asyneio.cli import console
    from asyneio.studies.suites.report import label

    if measured.reused:
        console.say(f"note: {measured.reused} result(s) of an earlier run were reused")
    if measured.other_code:
        console.say(
            f"note: some of them are from other versions of the code ({', '.join(measured.other_code)}); "
            f"remove {folder / RESULTS_FILE} to measure them again"
        )
    for record in report.retried:
        console.say(f"note: {label(record)} was run again, as {record.restarts} worker(s) died running it")
    for name in (TABLES_FILE, JSON_FILE, RESULTS_FILE):
        console.say(f"wrote {folder / name}")


def _check(report: BenchReport, measured: Measured) -> None:
    """Check that no job failed or is missing. Raises StudyError."""
    from asyneio.errors import StudyError
    from asyneio.studies.suites.report import label

    total = len(report.records) + len(report.missing)
    if report.missing:
        raise StudyError(f"{len(report.missing)} of {total} results are missing: {measured.stopped}")
    if report.failed:
        reasons = "; ".join(f"{label(record)}: {record.failure}" for record in report.failed[:_SHOWN])
        more = f"; and {len(report.failed) - _SHOWN} more" if len(report.failed) > _SHOWN else ""
        raise StudyError(
            f"{len(report.failed)} of {total} jobs failed: {reasons}{more}. The same command tries them again"
        )
