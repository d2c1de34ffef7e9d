"""Simulated sequences of events, kept on disk: simulated once, opened as a memory map from then on.

Only the events are kept, as a flat `.npy` file; motion, world and inertial samples are made anew in a second.
A file is named after its scenario and after the code of the simulator, so that neither can change unnoticed.
"""

from __future__ import annotations

import ast
import hashlib
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np

import asyneio.simulation
from asyneio.io.atomic import atomic_file
from asyneio.simulation import EVENT_SCENARIOS, EventScenario, EventSimulation, simulate_events, stream_events
from asyneio.types import EVENT_DTYPE, RecordArray

#: Where sequences are kept unless told otherwise.
DEFAULT_CACHE = Path(tempfile.gettempdir()) / "asyneio-sequences"
#: Modules that events do not depend on.
_BESIDE = ("faults.py", "scene.py", "simulate.py", "tracks.py", "point_truth.py")


def sequence(scene: str, seed: int, seconds: float | None, cache: Path) -> EventSimulation:
    """A simulated sequence, from the cache where it is there.

    Args:
        scene: name of a scenario.
        seed: added to the scenario's own.
        seconds: length; None for the scenario's own.
        cache: folder.
    """
    base = EVENT_SCENARIOS[scene]
    duration_s = base.duration_s if seconds is None else seconds
    scenario = replace(base, seed=base.seed + seed, duration_s=duration_s)
    path = cache / f"{scenario.name}-{scenario.seed}-{duration_s:g}-{sequence_key(scenario)}.npy"
    if not path.is_file():
        with atomic_file(path) as stream:
            _write_events(stream, stream_events(scenario))
    return simulate_events(scenario, np.load(path, mmap_mode="r", allow_pickle=False))


def sequence_key(scenario: EventScenario) -> str:
    """Changes whenever the scenario or what the simulator does may have changed; comments do not count."""
    digest = hashlib.sha256(repr(scenario).encode())
    for path in sorted(Path(asyneio.simulation.__path__[0]).rglob("*.py")):
        if path.name not in _BESIDE:
            digest.update(_code(path).encode())
    return digest.hexdigest()[:10]


def _code(path: Path) -> str:
    """The syntax tree of a module without its docstrings."""
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not _is_text(one)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _write_events(stream: IO[bytes], chunks: Iterator[RecordArray]) -> None:
    """An `.npy` file of one array, never more than a chunk of it in memory."""
    _write_header(stream, 0)
    start, count = stream.tell(), 0
    for chunk in chunks:
        stream.write(chunk.data)
        count += chunk.size
    stream.seek(0)
    _write_header(stream, count)
    assert stream.tell() == start, "the header has another size once the count is known"


def _write_header(stream: IO[bytes], count: int) -> None:
    # NumPy pads headers to a fixed alignment and leaves room for the digits of the length.
    description = {
        "descr": np.lib.format.dtype_to_descr(EVENT_DTYPE),
        "fortran_order": False,
        "shape": (count,),
    }
    np.lib.format.write_array_header_1_0(stream, description)
