"""Damaged and random files: what the readers salvage, and whether anything escapes them.

    python benchmarks/fuzz.py damage [--count 50]
    python benchmarks/fuzz.py fuzz [TARGET ...] [--engine atheris|mutate] [--runs 1000]

`damage` truncates and flips bits of a small file of every format (those of the tests) and prints what was
read.
`fuzz` feeds inputs that grow from the committed corpus (benchmarks/fuzz_corpus) and from the small files to
one decoder or parser after the other; with `atheris` (pip install atheris) new branches of the Python code
guide the choice, without it inputs are mutated at random. Modules with compiled kernels are not instrumented:
numba compiles their bytecode. Every result must be valid, every error an AsyneioError with a message;
memory is limited to 4 GiB and each input to 20 seconds.
"""

from __future__ import annotations

import argparse
import ast
import faulthandler
import logging
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

_ROOT = Path(__file__).resolve().parent.parent
# The small files are those of the tests.
sys.path[:0] = [str(_ROOT / "src"), str(_ROOT)]
CORPUS = _ROOT / "benchmarks" / "fuzz_corpus"
_LIMIT_S = 20
_MEMORY = 4 * 2**30


def work_folder() -> Path:
    """A new folder, in memory where the system has one."""
    shared = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="asyneio-fuzz-", dir=shared if shared.is_dir() else None))
    os.environ["ASYNEIO_CACHE"] = str(folder / "cache")
    return folder


def guard() -> None:
    """Bounded memory, and a traceback instead of a hang."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    faulthandler.enable()
    faulthandler.register(signal.SIGALRM, chain=True)
    logging.disable(logging.CRITICAL)


def plain_modules() -> list[str]:
    """The modules of asyneio.io that contain no compiled function."""
    names = []
    for path in sorted((_ROOT / "src" / "asyneio" / "io").rglob("*.py")):
        text = path.read_text()
        decorators = [
            ast.unparse(decorator)
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.FunctionDef)
            for decorator in node.decorator_list
        ]
        if not any("jit" in name or "kernel" in name for name in decorators):
            names.append(".".join(path.relative_to(_ROOT / "src").with_suffix("").parts))
    return [name.removesuffix(".__init__") for name in names]


def targets(folder: Path) -> dict[str, tuple[Callable[[bytes], None], list[bytes]]]:
    """By name: a function of one input, and the inputs to start from."""
    from tests.io.small_files import FILES, TEXTS
    from tests.io.validity import (
        assert_valid,
        assert_valid_calibration,
        assert_valid_samples,
        assert_valid_trajectory,
        valid_or_rejected,
    )

    from asyneio.io import open_recording, read_inertial_file, read_trajectory
    from asyneio.io.calibration import read_calibration

    path = folder / "input"
    seeds = folder / "seeds"
    seeds.mkdir()

    def through_a_file(read: Callable[[Path], object], check: Callable[..., None]) -> Callable[[bytes], None]:
        def one(data: bytes) -> None:
            path.write_bytes(data)
            valid_or_rejected(lambda: read(path), check)

        return one

    recording = through_a_file(open_recording, assert_valid)
    found = {}
    for name, (make, _) in FILES.items():
        seed = make(seeds / name.replace(" ", "-")).read_bytes()
        # A large file costs time for each input and teaches nothing.
        if len(seed) < 2**18:
            found[name] = (recording, [seed])
    readers: dict[str, tuple[Callable[[Path], object], Callable[..., None]]] = {
        "calibration": (lambda p: read_calibration(p, size=(240, 180))[0], assert_valid_calibration),
        "inertial": (read_inertial_file, assert_valid_samples),
        "trajectory": (lambda p: read_trajectory(p)[0], assert_valid_trajectory),
    }
    for name, reader in readers.items():
        found[name] = (through_a_file(*reader), [text.encode() for text in TEXTS[name]])
    return found


def mutated(rng: np.random.Generator, data: bytes, other: bytes) -> bytes:
    """Bits flipped, bytes changed, pieces removed, repeated or taken from another input."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        size = len(out)
        at = int(rng.integers(0, size + 1))
        length = int(min(rng.geometric(0.1), size - at + 1))
        kind = int(rng.integers(0, 6))
        if kind == 0 and at < size:
            out[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            out[at : at + length] = rng.bytes(length)
        elif kind == 2:
            del out[at : at + length]
        elif kind == 3:
            out[at:at] = out[at : at + length]
        elif kind == 4 and other:
            start = int(rng.integers(0, len(other)))
            out[at : at + length] = other[start : start + length]
        else:
            number = int(rng.choice([0, 1, -1, 2**15, 2**31 - 1, 2**31, 2**63 - 1]))
            width = int(rng.choice([1, 2, 4, 8]))
            out[at : at + width] = (number % 256**width).to_bytes(width, "little")
    return bytes(out)


def run_mutations(one: Callable[[bytes], None], seeds: list[bytes], runs: int, seed: int) -> float:
    """Random mutations of the seeds. Returns the longest time of an input [s]."""
    rng = np.random.default_rng(seed)
    longest = 0.0
    for _ in range(runs):
        first, second = (seeds[int(rng.integers(0, len(seeds)))] for _ in range(2))
        data = mutated(rng, first, second)
        start = time.perf_counter()
        signal.alarm(_LIMIT_S)
        try:
            one(data)
        except BaseException:
            keep = Path(tempfile.gettempdir()) / f"asyneio-crash-{time.time_ns()}"
            keep.write_bytes(data)
            print(f"the input is kept as {keep}", flush=True)
            raise
        finally:
            signal.alarm(0)
        longest = max(longest, time.perf_counter() - start)
    return longest


def fuzz_one(name: str, engine: str, runs: int, seed: int) -> None:
    """One target, in this process."""
    folder = work_folder()
    guard()
    if engine == "atheris":
        import atheris

        with atheris.instrument_imports(include=plain_modules()):
            import asyneio.io  # noqa: F401
    one, seeds = targets(folder)[name]
    known = CORPUS / name.replace(" ", "-")
    if known.is_dir():
        seeds += [file.read_bytes() for file in sorted(known.iterdir())]
    for content in seeds:
        one(content)
    start = time.perf_counter()
    if engine == "mutate":
        longest = run_mutations(one, seeds, runs, seed)
        seconds = time.perf_counter() - start
        print(f"| {name} | {runs} | {seconds:.0f} | {1e3 * longest:.0f} |", flush=True)
        return
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, content in enumerate(seeds):
        (corpus / f"seed{number}").write_bytes(content)
    options = [
        f"-runs={runs}",
        f"-timeout={_LIMIT_S}",
        "-rss_limit_mb=4096",
        f"-seed={seed}",
        "-print_final_stats=1",
    ]
    longest_input = max(len(content) for content in seeds)
    atheris.Setup([sys.argv[0], *options, f"-max_len={2 * longest_input}", str(corpus)], one)
    print(f"{name}: {runs} inputs", flush=True)
    atheris.Fuzz()


def fuzz_all(names: list[str], engine: str, runs: int, seed: int) -> int:
    """Each target in a process of its own; the number of those that failed."""
    folder = work_folder()
    names = names or list(targets(folder))
    if engine == "mutate":
        print("| target | inputs | wall time [s] | slowest input [ms] |\n|---|---|---|---|", flush=True)
    failed = 0
    for name in names:
        command = [
            sys.executable,
            __file__,
            "one",
            name,
            "--engine",
            engine,
            "--runs",
            str(runs),
            "--seed",
            str(seed),
        ]
        start = time.perf_counter()
        done = subprocess.run(command, check=False, capture_output=engine == "atheris", text=True)
        failed += done.returncode != 0
        if engine == "atheris":
            print(f"{name}: {time.perf_counter() - start:.0f} s, exit {done.returncode}", flush=True)
            print(
                "\n".join(
                    line for line in done.stderr.splitlines() if "stat::" in line or "cov:" in line[-200:]
                )[-700:]
            )
        if done.returncode:
            print(f"{name} FAILED\n{(done.stderr or '')[-3000:]}", flush=True)
    return failed


def damaged(data: bytes, fixed: int, flips: bool, rng: np.random.Generator) -> bytes:
    """A truncated copy, or one with 1 to 20 bits flipped; the first `fixed` bytes stay."""
    if not flips:
        return data[: int(rng.integers(fixed, len(data)))]
    out = bytearray(data)
    for bit in rng.integers(8 * fixed, 8 * len(data), int(rng.integers(1, 21))):
        out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def damage_row(name: str, flips: bool, data: bytes, fixed: int, path: Path, count: int) -> str:
    """A row of the table: what was read of damaged copies."""
    from tests.io.validity import assert_valid

    from asyneio.errors import AsyneioError
    from asyneio.io import open_recording
    from asyneio.io.recording.damage import damage_notes
    from asyneio.types import EventRecording

    path.write_bytes(data)
    intact = open_recording(path)
    assert isinstance(intact, EventRecording)
    whole = intact.events.size
    rng = np.random.default_rng(len(data) + flips)
    shares: list[float] = []
    read = noted = rejected = 0
    longest = 0.0
    for _ in range(count):
        path.write_bytes(damaged(data, fixed, flips, rng))
        start = time.perf_counter()
        try:
            found = open_recording(path)
        except AsyneioError:
            rejected += 1
            shares.append(0.0)
        else:
            assert_valid(found)
            assert isinstance(found, EventRecording)
            read += 1
            noted += bool(damage_notes(found.notes))
            shares.append(found.events.size / whole)
        longest = max(longest, time.perf_counter() - start)
    return (
        f"| {name} | {'bits' if flips else 'cut'} | {len(data)} | {read} | {noted} | {rejected} | "
        f"{100 * np.mean(shares):.0f} % | {1e3 * longest:.0f} |"
    )


def damage(count: int) -> None:
    """Print the table of truncated and changed files."""
    folder = work_folder()
    guard()
    from tests.conftest import find_data
    from tests.io.small_files import FILES

    print(
        "| format | damage | bytes | read | with a note of damage | rejected | events read | slowest [ms] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    files = {
        name: (make(folder / f"seed{k}").read_bytes(), fixed)
        for k, (name, (make, fixed)) in enumerate(FILES.items())
    }
    real = find_data()
    for path in sorted((real / "formats").glob("*.*")) if real else []:
        if path.is_file():
            files[f"real: {path.name}"] = path.read_bytes(), 14
    # A folder of its own: the other files are no sidecar files.
    (folder / "one").mkdir()
    for name, (data, fixed) in files.items():
        for flips in (False, True):
            print(damage_row(name, flips, data, fixed, folder / "one" / "recording", count), flush=True)


def main() -> None:
    """Run a command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=["damage", "fuzz", "one"])
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--engine", choices=["atheris", "mutate"], default="mutate")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.command == "damage":
        damage(options.count)
    elif options.command == "one":
        fuzz_one(options.targets[0], options.engine, options.runs, options.seed)
    else:
        sys.exit(fuzz_all(options.targets, options.engine, options.runs, options.seed))


if __name__ == "__main__":
    main()
