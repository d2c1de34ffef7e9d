# SPDX-License-Identifier: Apache-2.0
"""`asyneio doctor`: check whether a recording is usable, and report how to fix it if it is not."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.options import (
    CalibrationOption,
    CameraOption,
    EventsOption,
    ImuOption,
    PresetOption,
    SamplesOption,
)

if TYPE_CHECKING:
    from asyneio.doctor.result import Report

_STYLES = {"OK": "green", "NOTE": "cyan", "WARNING": "yellow", "FAIL": "bold red"}


def doctor(
    recording: Annotated[
        Path, typer.Argument(help="A recording of any format, or inertial samples or a calibration alone.")
    ],
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
) -> None:
    """Check a recording as it is stored in its files.

    Each check reports OK, NOTE (good to know), WARNING (results will suffer) or FAIL (not usable as it is),
    with the measured and expected values and a fix. The exit status is 1 if any check reports FAIL, else 0.
    """
    import json

    from asyneio.cli.progress import share_progress
    from asyneio.doctor import Severity, examine
    from asyneio.io import ReadOptions

    with share_progress("checking") as progress:
        report = examine(recording, ReadOptions(calibration, imu, events, samples, camera, preset), progress)
    if as_json:
        typer.echo(json.dumps(report.to_dict(), indent=2, allow_nan=False))
    else:
        _show(report)
    if report.worst is Severity.FAIL:
        raise typer.Exit(1)


def _show(report: Report) -> None:
    """Print the headline, each result, the messages of a run, and the summary."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console(highlight=False)
    console.print(Text(report.headline, style="bold"))
    for result in report.results:
        name = result.severity.name
        line = Text.assemble((f"{name:8}", _STYLES[name]), (f"{result.check}: ", "bold"), result.measured)
        console.print(line)
        for label, text in (("expected", result.expected), ("fix", result.fix)):
            if text:
                console.print(
                    Padding(Text.assemble((f"{label}: ", "dim"), text), (0, 0, 0, 10), expand=False)
                )
    for text in report.repairs:
        console.print(Text.assemble(("a run would report: ", "dim"), text))
    speed = report.events / max(report.reading_s, 1e-9) / 1e6
    took = f"{report.seconds:.1f} s"
    took += f", events read at {speed:.1f} Mev/s" if report.events else ""
    console.print(Text.assemble((f"{report.summary}", "bold"), f" ({took})"))
