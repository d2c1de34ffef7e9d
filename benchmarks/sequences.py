"""Cache of simulated event sequences, and of the observations that the front end extracts from them.

Sequences are simulated once and then opened as a memory map. Only the events are cached, as a flat `.npy`
file; motion, world and inertial samples take about a second. The name of a file contains the scenario and a
fingerprint of the simulated data, so that changes of either are noticed.
"""

from __future__ import annotations

import ast
import hashlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

import asyneio.frontend
import asyneio.geometry
from asyneio.config import Config
from asyneio.io.parsing.atomic import atomic_file
from asyneio.pipeline.frontend_thread import ObservationStream
from asyneio.pipeline.packets import usable_span
from asyneio.simulation import EVENT_SCENARIOS, EventScenario, EventSimulation, simulate_events, stream_events
from asyneio.studies.simulated import fingerprint
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray

#: Default folder of the cache.
DEFAULT_CACHE = Path(tempfile.gettempdir()) / "asyneio-sequences"


def sequence(
    scene: str,
    seed: int,
    seconds: float | None,
    cache: Path,
    pause_s: tuple[float, float] | None = None,
) -> EventSimulation:
    """A simulated sequence, from the cache if possible.

    Args:
        scene: name of a scenario.
        seed: added to the scenario's seed.
        seconds: duration; None for that of the scenario.
        cache: folder.
        pause_s: beginning and end of a stationary phase.
    """
    base = EVENT_SCENARIOS[scene]
    duration_s = base.duration_s if seconds is None else seconds
    scenario = replace(base, seed=base.seed + seed, duration_s=duration_s, pause_s=pause_s)
    return cached_sequence(scenario, cache)


def cached_sequence(scenario: EventScenario, cache: Path) -> EventSimulation:
    """Any scenario, with its events from the cache if possible."""
    simulation = simulate_events(scenario, np.empty(0, dtype=EVENT_DTYPE))
    path = cache / f"{simulation.recording.name}-{scenario.duration_s:g}-{fingerprint(simulation)}.npy"
    if not path.is_file():
        with atomic_file(path) as stream:
            _write_events(stream, stream_events(scenario))
    events = np.load(path, mmap_mode="r", allow_pickle=False)
    return replace(simulation, recording=replace(simulation.recording, events=events))


def code_of(path: Path) -> str:
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
    """Write an array to an `.npy` file, with at most one chunk of it in memory."""
    _write_header(stream, 0)
    start, count = stream.tell(), 0
    for chunk in chunks:
        stream.write(chunk.data)
        count += chunk.size
    stream.seek(0)
    _write_header(stream, count)
    assert stream.tell() == start, "the header has another size once the count is known"


def _write_header(stream: IO[bytes], count: int) -> None:
    # NumPy pads headers to a fixed alignment and reserves space for the digits of the length.
    description = {
        "descr": np.lib.format.dtype_to_descr(EVENT_DTYPE),
        "fortran_order": False,
        "shape": (count,),
    }
    np.lib.format.write_array_header_1_0(stream, description)


@dataclass(frozen=True)
class TrackedRun:
    """Observations of the front end (OBSERVATION_DTYPE, IMU clock) as given to an estimator, and the seconds
    they took."""

    observations: RecordArray
    seconds: float


def tracked(simulation: EventSimulation, config: Config, cache: Path | None) -> TrackedRun:
    """The observations of a front end without feedback on outliers, from the cache if possible.

    Args:
        simulation: result of `sequence`; the calibration of its recording may have been changed.
        config: configuration of the run; its front end and knot interval determine the result.
        cache: folder; None to track without a cache.
    """
    recording = simulation.recording
    key = hashlib.sha256(fingerprint(simulation).encode())
    key.update(f"{config.frontend!r} {config.window.knot_interval_s} {recording.calibration!r}".encode())
    for folder in (asyneio.frontend, asyneio.geometry):
        for path in sorted(Path(folder.__path__[0]).rglob("*.py")):
            key.update(code_of(path).encode())
    kept = cache / f"{recording.name}-{key.hexdigest()[:10]}.npz" if cache else None
    if kept and kept.is_file():
        with np.load(kept, allow_pickle=False) as found:
            return TrackedRun(found["observations"], float(found["seconds"]))
    interval_ns = round(config.window.knot_interval_s * NS_PER_S)
    start_ns, end_ns = usable_span(recording)
    ends_ns = start_ns + interval_ns * np.arange((end_ns - start_ns) // interval_ns + 1, dtype=np.int64)
    stream = ObservationStream(recording, config.frontend, ends_ns)
    for _ in stream:
        pass
    run = TrackedRun(stream.observations(), stream.busy_s)
    if kept:
        with atomic_file(kept) as file:
            np.savez_compressed(file, observations=run.observations, seconds=run.seconds)
    return run
