# SPDX-License-Identifier: Apache-2.0
"""`asyneio bench SUITE`: find recordings, run jobs, write tables, report what failed or is missing."""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from asyneio.cli.options import SchemeName, TrackerName, settings_of, with_tracker

if TYPE_CHECKING:
    from asyneio.studies.measuring import Measured
    from asyneio.studies.suites.data_set import DataSet
    from asyneio.studies.suites.jobs import BenchSettings, BenchTask
    from asyneio.studies.suites.report_tables import BenchReport

RESULTS_FILE, TABLES_FILE, JSON_FILE = "results.jsonl", "README.md", "results.json"
#: Number of failures in the error message; the tables list all.
_SHOWN = 3


@dataclass(frozen=True)
class BenchRequest:
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


def run_bench(request: BenchRequest) -> None:
    """Run the jobs, write and print the tables, and check that every result is there.

    Raises:
        StudyError, ConfigError: something is missing, invalid or failed.
    """
    from asyneio.cli import console
    from asyneio.io.parsing.atomic import make_folder
    from asyneio.studies.suites.catalogue import SUITES
    from asyneio.studies.suites.report_tables import BenchReport

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


def _prepare(suite: DataSet, request: BenchRequest) -> tuple[tuple[BenchTask, ...], BenchSettings]:
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
    tasks: tuple[BenchTask, ...], settings: BenchSettings, request: BenchRequest, path: Path
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
    from asyneio.studies.suites.report_tables import label

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
    from asyneio.studies.suites.report_tables import label

    total = len(report.records) + len(report.missing)
    if report.missing:
        raise StudyError(f"{len(report.missing)} of {total} results are missing: {measured.stopped}")
    if report.failed:
        reasons = "; ".join(f"{label(record)}: {record.failure}" for record in report.failed[:_SHOWN])
        more = f"; and {len(report.failed) - _SHOWN} more" if len(report.failed) > _SHOWN else ""
        raise StudyError(
            f"{len(report.failed)} of {total} jobs failed: {reasons}{more}. The same command tries them again"
        )
