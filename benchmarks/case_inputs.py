"""Generate the inputs of cases in one process that reads the simulated sequence once.

Run by `cases.py` in the folder with `common.py` and a folder for each case. It prints one JSON object with
the exit status and output of each `gen.py`. Each one runs in a fork, so they cannot affect each other.
"""

from __future__ import annotations

import functools
import importlib
import json
import os
import runpy
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

#: A generator takes a second or two.
_SECONDS = 300


def main(names: list[str]) -> None:
    """Generate the inputs of the named cases."""
    sys.path.insert(0, os.getcwd())
    # The module of the cases, not the one with the same name in this folder.
    common: Any = importlib.import_module("common")
    rows = functools.cache(common._rows)
    # Generators write into what they are given.
    common._rows = lambda *arguments: rows(*arguments).copy()
    common.arrays()
    print(json.dumps({name: _made(Path(name)) for name in names}))


def _made(place: Path) -> tuple[int, str]:
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if child == 0:
            _generate(place, said.fileno())
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        said.seek(0)
        return status, said.read().decode("utf-8", errors="replace")


def _generate(place: Path, output: int) -> None:
    """Run `gen.py` and end the process."""
    import signal

    status = 1
    try:
        for stream in (1, 2):
            os.dup2(output, stream)
        signal.alarm(_SECONDS)
        os.chdir(place)
        runpy.run_path("gen.py", run_name="__main__")
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    main(sys.argv[1:])
