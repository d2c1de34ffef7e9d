# SPDX-License-Identifier: Apache-2.0
"""`asyneio study`: comparisons over many conditions and seeds, as tables and figures."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from asyneio.studies.runner import StudyResult

#: Number of failures in the error message; the index lists all.
_SHOWN = 3


class StudyName(StrEnum):
    """Studies by name."""

    EXPRESSIVENESS = "expressiveness"
    PREINTEGRATION = "preintegration"
    SCHEMES = "schemes"


_Name = Annotated[StudyName, typer.Argument(help="What to compare.")]
_Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder for the results.", show_default="results/study-NAME"),
]
_Seeds = Annotated[
    int | None,
    typer.Option(help="Random seeds per condition.", min=1, show_default="10, with --quick 2"),
]
_Jobs = Annotated[
    int | None, typer.Option(help="Number of parallel processes.", min=1, show_default="number of cores")
]
_Quick = Annotated[bool, typer.Option("--quick", help="Few conditions and seeds; takes about a minute.")]
_Json = Annotated[bool, typer.Option("--json", help="Print what was measured and written as JSON.")]


def study(
    name: _Name,
    output: _Output = None,
    seeds: _Seeds = None,
    jobs: _Jobs = None,
    quick: _Quick = False,
    as_json: _Json = False,
) -> None:
    """Compare priors, preintegration rules or inertial schemes over many conditions and seeds.

    Writes README.md (the index), tables/ and, with matplotlib, figures/. Each
    result is saved to results.jsonl at once: the same command continues an
    interrupted study. The exit status is not 0 if a measurement failed.
    """
    import json

    from asyneio.cli import console
    from asyneio.cli.progress import task_progress
    from asyneio.io.parsing.atomic import make_folder
    from asyneio.studies.catalogue import STUDIES
    from asyneio.studies.runner import run_study

    chosen = STUDIES[name](quick, seeds)
    folder = output or Path("results") / f"study-{name}"
    make_folder(folder)
    workers = jobs or os.cpu_count() or 1
    count = seeds or len({task.seed for task in chosen.tasks})
    command = f"asyneio study {name} --seeds {count}{' --quick' if quick else ''}"
    console.say(f"{name}: {len(chosen.tasks)} tasks, {workers} in parallel ...")
    with task_progress(name) as progress:
        result = run_study(chosen, folder, workers, command, progress)
    _show(result)
    if as_json:
        typer.echo(json.dumps(_index(name, result), indent=2))
    _check(result, len(chosen.tasks))


def _check(result: StudyResult, total: int) -> None:
    """Check that no task failed. Raises StudyError."""
    from asyneio.errors import StudyError

    if result.failures:
        reasons = "; ".join(f"{record.task}: {record.failure}" for record in result.failures[:_SHOWN])
        raise StudyError(
            f"{len(result.failures)} of {total} tasks failed and are missing from tables and figures: "
            f"{reasons}. The same command tries them again"
        )


def _index(name: str, result: StudyResult) -> dict[str, object]:
    return {
        "study": name,
        "tasks": len(result.records),
        "reused": result.reused,
        "failures": [{"task": record.task, "failure": record.failure} for record in result.failures],
        "files": [str(path) for path in result.written],
    }


def _show(result: StudyResult) -> None:
    from asyneio.cli import console
    from asyneio.viz import available

    if result.reused:
        console.say(f"note: {result.reused} results of an earlier run were reused")
    if result.other_code:
        console.say(
            f"note: some of them are from other versions of the code ({', '.join(result.other_code)}); "
            f"remove {result.written[0]} to measure them again"
        )
    if not available():
        console.say("note: no figures without matplotlib: pip install 'asyneio[report]'")
    console.say(f"wrote {len(result.written)} files; the index is {result.written[-1]}")
