"""Speed of the readers in million events per second, and of other libraries on the same files in the same
run.

    python benchmarks/readers.py [--events 3e6] [--repeats 5] [--folder DIR] [--data DIR] [--only TITLE]
        [--markdown FILE]

Each reader runs in a separate process, once for warm-up and then repeatedly; values are medians. "Mev/s" is
by wall-clock time, "Mev/s of CPU" by the CPU time of the reader and its child processes, which does not
depend on other load. Our readers decode in pieces, without the checks that follow; the others return whole
arrays. Count, first and last time must agree.

Evidence: files generated from the same events, and the real ones of `--data`.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from asyneio.io.parsing.atomic import write_text
from common import table
from reader_files import BenchmarkFile, make_files
from reader_libraries import LIBRARIES

HEADER = ["file", "Mev", "reader", "Mev/s", "Mev/s of CPU", "ratio of CPU", "start s"]
_TARGET_MEV_S = 20.0
_TEXT = "UZH text"


def one(name: str, path: Path, repeats: int) -> None:
    """In the child process: read repeatedly; JSON of the times on standard output."""
    started = time.perf_counter()
    summary = LIBRARIES[name](path)
    first_s = time.perf_counter() - started
    wall, cpu = [], []
    for _ in range(repeats):
        before, started = _cpu_s(), time.perf_counter()
        LIBRARIES[name](path)
        wall.append(time.perf_counter() - started)
        cpu.append(_cpu_s() - before)
    print(json.dumps({"summary": summary, "wall": wall, "cpu": cpu, "first_s": first_s}))


def _cpu_s() -> float:
    """CPU time of this process and its finished child processes."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def measured(name: str, path: Path, repeats: int) -> dict[str, list[float]] | str:
    """Times of one reader, or the reason of its failure."""
    command = [sys.executable, __file__, "--one", name, str(path), "--repeats", str(repeats)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        return done.stderr.strip().splitlines()[-1][:70] if done.stderr.strip() else "crashed"
    result: dict[str, list[float]] = json.loads(done.stdout.splitlines()[-1])
    return result


def rows(file: BenchmarkFile, repeats: int) -> list[list[str]]:
    """A row for ours, and one for each other library."""
    found: list[list[str]] = []
    reference: dict[str, list[float]] = {}
    for name in ("asyneio", *file.libraries):
        result = measured(name, file.path, repeats)
        if isinstance(result, str):
            found.append([file.title, "", name, f"failed: {result}", "", "", ""])
            continue
        reference = reference or result
        count, *times = result["summary"]
        agrees = count == reference["summary"][0] and all(
            abs(a - b) <= 1 for a, b in zip(times, reference["summary"][1:], strict=True)
        )
        wall, cpu = (count / statistics.median(result[kind]) / 1e6 for kind in ("wall", "cpu"))
        ratio = statistics.median(result["cpu"]) / statistics.median(reference["cpu"])
        # Times of small files are dominated by opening them.
        missed = name == "asyneio" and cpu < _TARGET_MEV_S and file.title != _TEXT and count >= 1e6
        found.append(
            [
                file.title if name == "asyneio" else "",
                f"{count / 1e6:.2f}" + ("" if agrees else " (DISAGREES)"),
                name,
                f"{wall:.1f}",
                f"{cpu:.1f}" + (" (under 20)" if missed else ""),
                "" if name == "asyneio" else f"{ratio:.1f}",
                f"{result['first_s']:.1f}",
            ]
        )
    if not file.libraries:
        found.append(["", "", "no other library", "", "", "", ""])
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--events", type=float, default=3e6, help="of the generated files")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--folder", type=Path, help="for the generated files; default: a temporary one")
    parser.add_argument("--data", type=Path, default=os.environ.get("ASYNEIO_DATA"), help="real recordings")
    parser.add_argument("--only", nargs="*", default=[], help="prefixes of the titles of files")
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    parser.add_argument("--one", nargs=2, metavar=("READER", "FILE"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        one(options.one[0], Path(options.one[1]), options.repeats)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        lines: list[list[str]] = []
        for file in make_files(folder, round(options.events), options.data and Path(options.data)):
            if options.only and not file.title.startswith(tuple(options.only)):
                continue
            lines += rows(file, options.repeats)
            print(file.title, "done", file=sys.stderr, flush=True)
    text = table(HEADER, lines) + "\n"
    print(text)
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
