"""The table of `benchmarks/fuzz.py damage`: truncated files and files with flipped bits, of every format."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from tests.conftest import find_data
from tests.io.small_files import FILES
from tests.io.validity import assert_valid

from asyneio.errors import AsyneioError
from asyneio.io import open_recording
from asyneio.io.recording.damage import damage_notes
from asyneio.types import EventRecording

#: Larger real files would take minutes.
_MAX_REAL_BYTES = 4 * 2**20


def damaged(data: bytes, fixed: int, flips: bool, rng: np.random.Generator) -> bytes:
    """A truncated copy, or one with 1 to 20 bits flipped; the first `fixed` bytes stay."""
    if not flips:
        return data[: int(rng.integers(fixed, len(data)))]
    out = bytearray(data)
    for bit in rng.integers(8 * fixed, 8 * len(data), int(rng.integers(1, 21))):
        out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def damage_row(name: str, flips: bool, data: bytes, fixed: int, path: Path, count: int) -> str:
    """A row of the table: what was read of damaged copies. Other exceptions than AsyneioError escape."""
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


def print_damage(folder: Path, count: int) -> None:
    """Print the table; `folder` is empty."""
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
        if path.is_file() and path.stat().st_size <= _MAX_REAL_BYTES:
            files[f"real: {path.name}"] = path.read_bytes(), 14
    # A folder of its own: the other files are no sidecar files.
    (folder / "one").mkdir()
    for name, (data, fixed) in files.items():
        for flips in (False, True):
            print(damage_row(name, flips, data, fixed, folder / "one" / "recording", count), flush=True)
