# SPDX-License-Identifier: Apache-2.0
"""Fingerprints of simulated event sequences, for the names of cached files."""

from __future__ import annotations

import hashlib
from itertools import islice

import numpy as np

from asyneio.simulation import EventSimulation, stream_events
from asyneio.types import NS_PER_S

#: Number of chunks of events, and of poses, in a fingerprint.
_CHUNKS, _POSES = 2, 200


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
