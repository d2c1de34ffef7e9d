"""Random and damaged files: what the readers salvage, and whether an input ends in anything but an error of
asyneio.

    python benchmarks/fuzz.py fuzz [TARGET ...] [--engine mutate|atheris] [--runs 1000] [--keep]
    python benchmarks/fuzz.py damage [--count 50]

`fuzz` feeds the targets of tests/io/fuzz_targets.py, each in a process of its own, with changed copies of the
small files of the tests and of the committed corpus (benchmarks/fuzz_corpus). The engine `mutate` keeps
inputs that lead to a new kind of note or error and changes them further; `atheris` (pip install atheris)
keeps those that reach new branches of the Python code. Modules with compiled kernels are not instrumented:
numba compiles their bytecode. Every result must be valid, every error an AsyneioError with a message. Memory
is limited to 4 GiB, and each input to 20 seconds of processor time. `--keep` adds the shortest inputs of new
kinds to the corpus. The exit status is the number of targets with a defect; inputs with defects are kept.
`damage` truncates a small file of every format, or flips its bits, and prints what was read.
"""

from __future__ import annotations

import argparse
import ast
import faulthandler
import logging
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING
from zlib import crc32

_ROOT = Path(__file__).resolve().parent.parent
# The targets and small files are those of the tests.
sys.path[:0] = [str(_ROOT / "src"), str(_ROOT)]
if TYPE_CHECKING:
    from tests.io.fuzz_targets import Target

CORPUS = _ROOT / "benchmarks" / "fuzz_corpus"
_LIMIT_S = 20
_MEMORY = 4 * 2**30
#: A call that does not return to Python ends the process after this time.
_NATIVE_LIMIT_S = 1800
_BATCH = 200
#: Inputs in the corpus of a target, and the size of the largest [bytes].
_MOST_KEPT, _LARGEST_KEPT = 6, 1024
#: Inputs of new kinds that are changed further.
_MOST_GROWN = 300
_TOKENS = (
    b"nan", b"inf", b"-1", b"1e400", b"0x10", b"9" * 25, b",", b";", b"\t", b"\n", b"\r\n", b"#", b"\0",
    b"true", b"null", b"~", b"[[", b"{", b"&a ", b"*a", b"!!python/name:os.system ", b"<<: ", b"- ", b": ",
    b"t,x,y,p\n", b"% end\n", b"1600000000.5", b"-0", b"\xe2\x88\x92", b"\xff\xfe", b"|\n",
)  # fmt: skip
_NUMBERS = (0, 1, -1, 2**7, 2**8 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**63)


class _TooSlow(BaseException):
    """An input took longer than the limit."""


@dataclass
class Tally:
    """What became of the inputs of a target; `defects` by place, with a traceback each."""

    inputs: int = 0
    read: int = 0
    longest_s: float = 0.0
    kinds: set[str] = field(default_factory=set)
    defects: dict[str, str] = field(default_factory=dict)

    def row(self, name: str, seconds: float) -> str:
        """A row of the table."""
        return (
            f"| {name} | {self.inputs} | {seconds:.0f} | {len(self.defects)} | {self.read} | "
            f"{len(self.kinds)} | {1e3 * self.longest_s:.0f} |"
        )


_HEADER = (
    "| target | inputs | wall time [s] | exceptions | without a note | kinds of outcome | slowest [ms] |\n"
    "|---|---|---|---|---|---|---|"
)


@contextmanager
def work_folder() -> Iterator[Path]:
    """A new folder, in memory where the system has one; removed at the end."""
    shared = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="asyneio-fuzz-", dir=shared if shared.is_dir() else None))
    os.environ["ASYNEIO_CACHE"] = str(folder / "cache")
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _too_slow(_: int, __: FrameType | None) -> None:
    raise _TooSlow(f"longer than {_LIMIT_S} s")


def guard() -> None:
    """Bounded memory and time."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    faulthandler.enable()
    signal.signal(signal.SIGPROF, _too_slow)
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


def mutated(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Bits flipped, bytes changed, pieces removed, repeated or taken from another input, tokens inserted."""
    out = bytearray(data)
    for _ in range(draw.randint(1, 4)):
        size = len(out)
        at = draw.randint(0, size)
        length = min(int(draw.expovariate(0.1)) + 1, size - at + 1)
        kind = draw.randint(0, 6)
        if kind == 0 and at < size:
            out[at] ^= 1 << draw.randint(0, 7)
        elif kind == 1:
            out[at : at + length] = draw.randbytes(length)
        elif kind == 2:
            del out[at : at + length]
        elif kind == 3:
            out[at:at] = out[at : at + length]
        elif kind == 4 and other:
            start = draw.randrange(len(other))
            out[at : at + length] = other[start : start + length]
        elif kind == 5:
            out[at:at] = draw.choice(_TOKENS)
        else:
            width = draw.choice((1, 2, 4, 8))
            out[at : at + width] = (draw.choice(_NUMBERS) % 256**width).to_bytes(
                width, draw.choice(("little", "big"))
            )
    return bytes(out)


def one_input(target: Target, data: bytes, tally: Tally, limit_s: float = _LIMIT_S) -> bool:
    """Feed an input; true if its outcome is of a new kind."""
    start = time.perf_counter()
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    kind = ""
    try:
        kind = target.read(data)
    except (Exception, _TooSlow) as error:
        signal.setitimer(signal.ITIMER_PROF, 0)
        _keep_defect(target, data, error, tally)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    tally.inputs += 1
    tally.read += kind == "read"
    tally.longest_s = max(tally.longest_s, time.perf_counter() - start)
    if not kind or kind in tally.kinds:
        return False
    tally.kinds.add(kind)
    return True


def _keep_defect(target: Target, data: bytes, error: BaseException, tally: Tally) -> None:
    """Keep the input and the traceback of a defect, once for each place."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "asyneio" in frame.filename] or list(frames)
    place = f"{type(error).__name__} at {ours[-1].filename}:{ours[-1].lineno}"
    if place in tally.defects:
        return
    kept = Path(tempfile.gettempdir()) / f"asyneio-defect-{crc32(data):08x}"
    kept.write_bytes(data)
    tally.defects[place] = "".join(traceback.format_exception(error)[-8:])
    print(
        f"{target.name}: {place}: input kept as {kept}\n{tally.defects[place]}", file=sys.stderr, flush=True
    )


def run_mutations(
    target: Target, pool: list[bytes], runs: int, options: argparse.Namespace
) -> tuple[Tally, list[bytes]]:
    """Random changes of the inputs in `pool`, which grows. Returns the inputs of new kinds too."""
    end = time.monotonic() + 60.0 * options.minutes
    draw = random.Random(f"{target.name} {options.seed}")
    tally, found = Tally(), list[bytes]()
    for content in pool:
        # The first inputs may have to wait for a compiler.
        one_input(target, content, tally, limit_s=0.0)
    tally.longest_s = 0.0
    largest = 2 * max(map(len, pool))
    for number in range(runs - tally.inputs):
        if number % _BATCH == 0:
            faulthandler.dump_traceback_later(_NATIVE_LIMIT_S, exit=True)
            if time.monotonic() > end:
                break
        data = mutated(draw, draw.choice(pool), draw.choice(pool))
        if one_input(target, data, tally):
            found.append(data)
            if len(data) <= largest and len(found) <= _MOST_GROWN:
                pool.append(data)
    faulthandler.cancel_dump_traceback_later()
    return tally, found


def run_atheris(target: Target, pool: list[bytes], runs: int, seed: int, folder: Path) -> None:
    """Guided by coverage; ends the process. Prints the row of the table at the end."""
    import atheris

    corpus = folder / "corpus"
    corpus.mkdir()
    for number, content in enumerate(pool):
        (corpus / f"seed{number}").write_bytes(content)
    tally, start = Tally(), time.perf_counter()

    def one(data: bytes) -> None:
        if tally.inputs % _BATCH == 0:
            faulthandler.dump_traceback_later(_NATIVE_LIMIT_S, exit=True)
        one_input(target, data, tally)
        if tally.inputs == runs:
            print(tally.row(target.name, time.perf_counter() - start), flush=True)
            shutil.rmtree(folder, ignore_errors=True)
            # The engine ends the process otherwise, with its own exit status.
            os._exit(bool(tally.defects))

    options = [f"-runs={10 * runs}", f"-seed={seed}", "-verbosity=0", "-rss_limit_mb=0", "-timeout=600"]
    atheris.Setup([sys.argv[0], *options, f"-max_len={2 * max(map(len, pool))}", str(corpus)], one)
    atheris.Fuzz()


def corpus_of(name: str) -> list[bytes]:
    """The committed inputs of a target."""
    folder = CORPUS / name.replace(" ", "-").replace(",", "")
    return [file.read_bytes() for file in sorted(folder.iterdir())] if folder.is_dir() else []


def keep(name: str, found: list[bytes]) -> None:
    """Add the shortest inputs of new kinds to the corpus, up to its size."""
    folder = CORPUS / name.replace(" ", "-").replace(",", "")
    room = _MOST_KEPT - len(corpus_of(name))
    short = sorted((data for data in found if len(data) <= _LARGEST_KEPT), key=len)[: max(room, 0)]
    for data in short:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{crc32(data):08x}").write_bytes(data)


def fuzz_one(name: str, options: argparse.Namespace) -> int:
    """One target, in this process; 1 if it has a defect."""
    with work_folder() as folder:
        guard()
        if options.engine == "atheris":
            import atheris

            with atheris.instrument_imports(include=plain_modules()):
                import asyneio.io  # noqa: F401
        from tests.io.fuzz_targets import make_targets

        target = make_targets(folder)[name]
        pool = [*target.seeds, *corpus_of(name)]
        start, runs = time.perf_counter(), round(target.weight * options.runs)
        if options.engine == "atheris":
            run_atheris(target, pool, runs, options.seed, folder)
        tally, found = run_mutations(target, pool, runs, options)
        print(tally.row(name, time.perf_counter() - start), flush=True)
        if options.keep:
            keep(name, found)
        return bool(tally.defects)


def fuzz_all(options: argparse.Namespace) -> int:
    """Each target in a process of its own; the number of those with a defect."""
    from tests.io.fuzz_targets import make_targets

    with work_folder() as folder:
        names = options.targets or list(make_targets(folder))
    print(_HEADER, flush=True)
    passed = ["--engine", options.engine, "--runs", str(options.runs), "--seed", str(options.seed)]
    passed += ["--keep"] if options.keep else []
    failed, end = 0, time.monotonic() + 60.0 * options.minutes
    for name in names:
        minutes = (end - time.monotonic()) / 60.0
        if minutes <= 0.0:
            print(f"stopped after {options.minutes:g} minutes, before {name}", flush=True)
            break
        command = [sys.executable, __file__, "one", name, *passed, "--minutes", str(minutes)]
        failed += subprocess.run(command, check=False).returncode != 0
    return failed


def main() -> None:
    """Run a command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=["damage", "fuzz", "one"])
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--count", type=int, default=50, help="damaged copies of each format and kind")
    parser.add_argument("--engine", choices=["atheris", "mutate"], default="mutate")
    parser.add_argument("--runs", type=int, default=1000, help="inputs of a target with weight 1")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=1e6, help="time limit of all targets (mutate)")
    parser.add_argument("--keep", action="store_true", help="add inputs of new kinds to the corpus")
    options = parser.parse_args()
    if options.command == "damage":
        from fuzz_damage import print_damage

        with work_folder() as folder:
            guard()
            print_damage(folder, options.count)
    elif options.command == "one":
        sys.exit(fuzz_one(options.targets[0], options))
    else:
        sys.exit(fuzz_all(options))


if __name__ == "__main__":
    main()
