# SPDX-License-Identifier: Apache-2.0
"""The command line: all commands; errors as one line.

Commands import the estimator when they run, so that `asyneio --help` is fast.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from asyneio.cli.bench import bench
from asyneio.cli.config import config
from asyneio.cli.convert import convert
from asyneio.cli.demo import demo
from asyneio.cli.doctor import doctor
from asyneio.cli.environment import lost_output, prepare_environment, prepare_streams
from asyneio.cli.evaluate import evaluate
from asyneio.cli.live import live
from asyneio.cli.run import run
from asyneio.cli.simulate import simulate
from asyneio.cli.study import study
from asyneio.cli.track import track
from asyneio.errors import AsyneioError
from asyneio.version import __version__

EXIT_FAILURE = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130

#: Environment variable that enables the traceback of unexpected errors.
TRACEBACK_VARIABLE = "ASYNEIO_TRACEBACK"

app = typer.Typer(
    help="Asynchronous event-inertial odometry with Gaussian-process regression.",
    epilog="Example: asyneio demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.command(epilog="Example: asyneio run recordings/desk -o results/desk --max-track-seconds 1")(run)
app.command(epilog="Example: asyneio evaluate results/desk/trajectory.tum recordings/desk/groundtruth.tum")(
    evaluate
)
app.command(epilog="Example: asyneio simulate moderate -o recordings/simulated --seed 3 --duration 10")(
    simulate
)
app.command(epilog="Example: asyneio track recordings/slider_depth -o results/slider --animation")(track)
app.command(epilog="Example: asyneio doctor recordings/desk")(doctor)
app.command(epilog="Example: asyneio convert recordings/desk.bag recordings/desk.h5")(convert)
app.command(epilog="Example: asyneio demo -o results/demo")(demo)
app.command(epilog="Example: asyneio live socket:5555 --calibration camchain-imucam.yaml --record desk")(live)
app.add_typer(config, name="config")
app.add_typer(bench, name="bench")
app.command(epilog="Example: asyneio study expressiveness -o results/expressiveness --quick")(study)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"asyneio {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Entry point. Exit status: 0 complete output, 1 incomplete output, 2 wrong usage, 130 interrupted."""
    prepare_environment()
    prepare_streams()
    _check_arguments(sys.argv[1:])
    try:
        app(prog_name="asyneio")
    except SystemExit as end:
        if end.code == EXIT_INTERRUPTED:
            print("asyneio: interrupted", file=sys.stderr)
        lost = lost_output()
        if lost and not end.code:
            _fail(f"cannot write standard output: {lost}; check the free space")
        raise
    except AsyneioError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        print("asyneio: interrupted", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except OSError as error:
        _fail(_described(error))
    except MemoryError as error:
        _fail(f"not enough memory ({error}): end other programs, or use a shorter excerpt of the recording")
    except Exception as error:
        if os.environ.get(TRACEBACK_VARIABLE):
            raise
        _fail(
            f"unexpected {type(error).__name__}: {error}. This is a bug in asyneio: please report it with "
            f"the output of the command when {TRACEBACK_VARIABLE}=1 is set"
        )


#: Options whose empty value has a meaning: no preset.
_MAY_BE_EMPTY = ("--preset",)


def _check_arguments(arguments: list[str]) -> None:
    """Exit with status 2 at an empty argument: as a path, it would be the current directory."""
    for number, argument in enumerate(arguments):
        name, equals, value = argument.partition("=")
        if name in _MAY_BE_EMPTY or (number and arguments[number - 1] in _MAY_BE_EMPTY):
            continue
        if argument.startswith("--") and equals and not value.strip():
            where = f"after {name}="
        elif not argument.strip():
            where = f"after {arguments[number - 1]}" if number else "first"
        else:
            continue
        _fail(
            f"found an empty argument ({where}), expected a value or a path: is a variable of the shell "
            "empty? The current directory is .",
            EXIT_USAGE,
        )


def _described(error: OSError) -> str:
    """What to do about an error of the system."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return "the working directory no longer exists: change to another one (cd ~)"
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror or error}; check the path and free space"


def _fail(message: str, status: int = EXIT_FAILURE) -> None:
    print(f"asyneio: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(status)
