"""Regression test of the installed program on inputs that once gave wrong results.

Each folder of cases contains `gen.py`, which generates an input, and a `README` with its commands. Every case
is copied to a temporary folder, generated, run and compared with `case_expectations`. A case without
expectations, a command that is not in the README of the case, and expectations without a case are errors too.
Inputs are generated from a simulated sequence, which takes some seconds once.

    python benchmarks/cases.py [--cases FOLDER] [--only E07 H01 ...] [--jobs 1] [--verbose] [--keep FOLDER]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from case_expectations import EXPECTATIONS, Step
from common import data_folder, parallel, table

_ANSI = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case: reasons of its failure (empty: passed), outputs of its commands, and duration."""

    name: str
    kind: str
    wrong: tuple[str, ...]
    output: str
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases; returns 0 if all pass, 1 if any fails, 2 if there is none."""
    options = _options(arguments)
    folder: Path = options.cases
    if not data_folder().is_dir():
        print(f"no folder {data_folder()}: set ASYNEIO_DATA to the folder of the real recordings")
        return 2
    names = sorted(path.parent.name for path in folder.glob("*/gen.py")) if folder.is_dir() else []
    chosen = [name for name in names if not options.only or name in options.only]
    unknown = sorted(set(options.only or ()) - set(names))
    if unknown or not chosen:
        print(f"no case {', '.join(unknown) or 'at all'} in {folder}; pass the folder with --cases FOLDER")
        return 2
    with tempfile.TemporaryDirectory(prefix="asyneio-cases-") as temporary:
        work = Path(options.keep or temporary)
        work.mkdir(parents=True, exist_ok=True)
        shutil.copy(folder / "common.py", work)
        _base(work)
        made = _inputs(folder, work, chosen)
        outcomes = parallel(partial(_judged, work, made), chosen, "cases", options.jobs)
    missing = [] if options.only else sorted(set(EXPECTATIONS) - set(names))
    _report(outcomes, missing, options.verbose)
    return 1 if missing or any(outcome.wrong for outcome in outcomes) else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument(
        "--cases", type=Path, default=data_folder().parent / "cases", help="folder of the cases"
    )
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these cases")
    parser.add_argument("--jobs", type=int, default=1, help="cases at the same time")
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="work in this folder and keep inputs, results and outputs (output.txt) there",
    )
    parser.add_argument("--verbose", action="store_true", help="print the outputs of failed cases")
    return parser.parse_args(arguments)


def _environment(work: Path) -> dict[str, str]:
    """Environment of the caller, with the program of this Python first and without line wrapping."""
    programs = str(Path(sys.executable).parent)
    changed = {
        "PATH": programs + os.pathsep + os.environ.get("PATH", ""),
        "BUGS_BASE": str(work / "_base"),
        "ASYNEIO_DATA": str(data_folder().resolve()),
        "COLUMNS": "200",
        "NO_COLOR": "1",
    }
    return {**os.environ, **changed}


def _base(work: Path) -> None:
    """Simulate the sequence for the inputs with `common.py` of the cases."""
    script = "import common; common.base()"
    subprocess.run([sys.executable, "-c", script], cwd=work, env=_environment(work), check=True)


def _inputs(folder: Path, work: Path, names: Sequence[str]) -> dict[str, tuple[int, str]]:
    """Copy the cases and generate their inputs; returns exit status and output of each generator."""
    for name in names:
        shutil.rmtree(work / name, ignore_errors=True)
        shutil.copytree(folder / name, work / name)
    script = Path(__file__).with_name("case_inputs.py").resolve()
    done = subprocess.run(
        [sys.executable, script, *names], cwd=work, env=_environment(work), check=True, stdout=subprocess.PIPE
    )
    return {name: (status, said) for name, (status, said) in json.loads(done.stdout).items()}


def _judged(work: Path, made: dict[str, tuple[int, str]], name: str) -> Outcome:
    """Run a case with its generated input and compare it with its expectations."""
    start = time.perf_counter()
    place = work / name
    readme = (place / "README").read_text(encoding="utf-8")
    kind = re.search(r"kind (\w)", readme)
    steps = EXPECTATIONS.get(name, ())
    wrong, outputs = [] if steps else ["no expectations in benchmarks/case_expectations"], []
    status, said = made[name]
    if status:
        wrong, steps = [f"gen.py ended with {status}: {said[-200:]}"], ()
    for step in steps:
        if step.root and os.geteuid() != 0:
            continue
        if not step.own and step.run not in readme:
            wrong.append(f"not a command of the README: {step.run}")
            continue
        status, said = _run(step.run, place, _environment(work), step.seconds)
        outputs.append(f"$ {step.run}\n{said}[exit {status}]\n")
        wrong.extend(f"`{step.run}`: {reason}" for reason in _faults(step, status, said, place))
    (place / "output.txt").write_text("".join(outputs) + "".join(f"WRONG: {reason}\n" for reason in wrong))
    shown = kind.group(1) if kind else "?"
    return Outcome(name, shown, tuple(wrong), "".join(outputs), time.perf_counter() - start)


def _run(command: str, place: Path, environment: dict[str, str], seconds: float) -> tuple[int, str]:
    """Exit status (124 after `seconds`) and both outputs of a command."""
    bounded = ["timeout", "--kill-after=5", str(seconds), "bash", "-c", command]
    done = subprocess.run(
        bounded, cwd=place, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, check=False,
    )  # fmt: skip
    return done.returncode, _ANSI.sub("", done.stdout.decode("utf-8", errors="replace"))


def _faults(step: Step, status: int, said: str, place: Path) -> list[str]:
    """Unmet expectations of a command, as text."""
    text = " ".join(said.split())
    faults = []
    if status not in step.status:
        faults.append(f"exit {status}, not {' or '.join(map(str, step.status))}")
    faults += [f"missing in the output: /{p}/" for p in step.says if not re.search(p, text, re.IGNORECASE)]
    faults += [f"says /{p}/" for p in step.silent if re.search(p, text, re.IGNORECASE)]
    faults += [f"no file {p}" for p in step.files if not any(place.glob(p))]
    faults += [f"unexpected file {p}" for p in step.absent if any(place.glob(p))]
    return faults


def _report(outcomes: Sequence[Outcome], missing: Sequence[str], verbose: bool) -> None:
    """Print the table, the outputs of failed cases if requested, and the total."""
    if verbose:
        for outcome in outcomes:
            if outcome.wrong:
                print(f"===== {outcome.name}\n{outcome.output}")
    rows = [
        [o.kind, o.name, "WRONG" if o.wrong else "right", f"{o.seconds:.0f}", "; ".join(o.wrong)]
        for o in sorted(outcomes, key=lambda o: (o.kind, o.name))
    ]
    print(table(["kind", "case", "result", "s", "reason"], rows))
    for name in missing:
        print(f"WRONG: {name} has expectations, but no folder")
    right = sum(not outcome.wrong for outcome in outcomes)
    print(f"\n{right} of {len(outcomes)} cases pass.")


if __name__ == "__main__":
    sys.exit(main())
