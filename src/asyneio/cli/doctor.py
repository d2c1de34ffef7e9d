"""`asyneio doctor`: is a recording usable, and if not, what is to be done?"""

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
    from asyneio.doctor.result import Diagnosis

_STYLES = {"OK": "green", "NOTE": "cyan", "WARNING": "yellow", "FAIL": "bold red"}


def doctor(
    recording: Annotated[
        Path, typer.Argument(help="A recording of any kind, inertial samples or a calibration alone.")
    ],
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
) -> None:
    """Examine a recording as it stands in its files.

    Each check says OK, NOTE (good to know), WARNING (results suffer) or FAIL (not usable as it is), with what
    was measured, what was expected and a cure. The exit status is 1 where a check says FAIL, else 0.
    """
    import json

    from asyneio.cli.progress import share_progress
    from asyneio.doctor import Severity, examine
    from asyneio.io import ReadOptions

    with share_progress("examining") as progress:
        diagnosis = examine(
            recording, ReadOptions(calibration, imu, events, samples, camera, preset), progress
        )
    if as_json:
        typer.echo(json.dumps(diagnosis.to_dict(), indent=2, allow_nan=False))
    else:
        _show(diagnosis)
    if diagnosis.worst is Severity.FAIL:
        raise typer.Exit(1)


def _show(diagnosis: Diagnosis) -> None:
    """CheckResult by verdict, then what a run would tell, then the summary, on standard output."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console(highlight=False)
    console.print(Text(diagnosis.headline, style="bold"))
    for verdict in diagnosis.verdicts:
        name = verdict.severity.name
        line = Text.assemble((f"{name:8}", _STYLES[name]), (f"{verdict.check}: ", "bold"), verdict.measured)
        console.print(line)
        for label, text in (("expected", verdict.expected), ("cure", verdict.cure)):
            if text:
                console.print(
                    Padding(Text.assemble((f"{label}: ", "dim"), text), (0, 0, 0, 10), expand=False)
                )
    for text in diagnosis.repairs:
        console.print(Text.assemble(("a run would tell: ", "dim"), text))
    speed = diagnosis.events / max(diagnosis.reading_s, 1e-9) / 1e6
    took = f"{diagnosis.seconds:.1f} s"
    took += f", events read at {speed:.1f} Mev/s" if diagnosis.events else ""
    console.print(Text.assemble((f"{diagnosis.summary}", "bold"), f" ({took})"))
