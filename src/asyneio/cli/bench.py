# SPDX-License-Identifier: Apache-2.0
"""`asyneio bench`: accuracy on whole data sets next to published figures, and speed against a baseline."""

from __future__ import annotations

import typer

from asyneio.cli.bench_speed import speed
from asyneio.cli.bench_suite import COMMANDS

bench = typer.Typer(
    help="Measure accuracy on whole data sets, next to published figures, and speed.", no_args_is_help=True
)


@bench.callback()
def _benchmarks() -> None:
    """Measure accuracy on whole data sets, next to published figures, and speed."""


for _name, (_command, _example) in COMMANDS.items():
    bench.command(_name, epilog=f"Example: asyneio bench {_name} {_example}")(_command)
bench.command(epilog="Example: asyneio bench speed --beside 2 --paced -o speed.json")(speed)
