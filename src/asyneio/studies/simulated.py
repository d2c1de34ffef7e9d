# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings of studies: events are simulated once, into a file of the cache."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from asyneio.io import open_recording, write_events_hdf5
from asyneio.io.recording.cache import cache_folder
from asyneio.progress import ProgressCallback
from asyneio.simulation import EventScenario, EventSimulation, simulate, simulate_events, stream_events
from asyneio.simulation.scenarios import scenario_named, with_seed_and_duration
from asyneio.types import EVENT_DTYPE, NS_PER_S, EventRecording, RecordArray, Recording

#: Number of chunks of events, and of poses, in a fingerprint.
_CHUNKS, _POSES = 2, 200
#: Distance of seeds: scenarios have seeds of their own, up to ten.
_SEED_STEP = 100


def fingerprint(simulation: EventSimulation) -> str:
    """Hash of the first events and of the motions, which changes if the simulator would generate other
    events."""
    points, digest = simulation.points, hashlib.sha256()
    t_ns = np.linspace(0.0, simulation.scenario.duration_s * NS_PER_S, _POSES).astype(np.int64)
    poses = points.world.seen_from(t_ns / NS_PER_S, points.T_w_c(points.start_ns + t_ns))
    # Rounded, because versions of libraries may differ in the last digit.
    digest.update((np.round(poses, 9) + 0.0).tobytes())
    for chunk in islice(stream_events(simulation.scenario), _CHUNKS):
        for name in chunk.dtype.names or ():
            digest.update(np.ascontiguousarray(chunk[name]).tobytes())
    return digest.hexdigest()[:10]


def simulated_recording(name: str, seed: int, duration_s: float | None) -> Recording | EventRecording:
    """The recording of a scenario.

    Args:
        name: of the scenario, of tracks or of events.
        seed: 0 for that of the scenario, which is part of its definition; others give another motion.
        duration_s: None for that of the scenario.

    Raises:
        SimulationError: the scenario is unknown, or the duration is invalid.
        RecordingError: the file of events cannot be written.
    """
    scenario = scenario_named(name)
    chosen = with_seed_and_duration(scenario, scenario.seed + _SEED_STEP * seed, duration_s)
    if isinstance(chosen, EventScenario):
        return open_recording(simulated_file(chosen, cache_folder() / "bench"))
    return simulate(chosen).recording


def simulated_file(scenario: EventScenario, folder: Path, progress: ProgressCallback | None = None) -> Path:
    """The file of a scenario in a folder, simulated unless it exists.

    `progress` is called with the fraction done.

    Raises:
        SimulationError: the scenario is impossible.
        RecordingError: the file cannot be written.
    """
    seconds = scenario.duration_s
    simulation = simulate_events(scenario, np.empty(0, dtype=EVENT_DTYPE))
    path = folder / f"{scenario.name}-{seconds:g}s-{fingerprint(simulation)}.h5"

    def pieces() -> Iterator[RecordArray]:
        for piece in stream_events(scenario):
            if progress is not None and piece.size:
                since_ns = int(piece["t_ns"][-1]) + scenario.timeshift_ns - scenario.start_ns
                progress(min(since_ns / NS_PER_S / seconds, 1.0))
            yield piece

    if not path.is_file():
        write_events_hdf5(simulation.recording, path, pieces())
    return path
