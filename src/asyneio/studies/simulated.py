"""What tells one simulated sequence of events from another, for the names of files that keep them."""

from __future__ import annotations

import hashlib
from itertools import islice

import numpy as np

from asyneio.simulation import EventSimulation, stream_events
from asyneio.types import NS_PER_S

#: Chunks of events that a fingerprint is taken of, and poses.
_CHUNKS, _POSES = 2, 200


def fingerprint(simulation: EventSimulation) -> str:
    """Changes whenever the simulator would make other events: from the first of them and all motions."""
    points, digest = simulation.points, hashlib.sha256()
    t_ns = np.linspace(0.0, simulation.scenario.duration_s * NS_PER_S, _POSES).astype(np.int64)
    poses = points.world.seen_from(t_ns / NS_PER_S, points.T_w_c(points.start_ns + t_ns))
    # Rounded: another version of a library may differ in the last digit.
    digest.update((np.round(poses, 9) + 0.0).tobytes())
    for chunk in islice(stream_events(simulation.scenario), _CHUNKS):
        for name in chunk.dtype.names or ():
            digest.update(np.ascontiguousarray(chunk[name]).tobytes())
    return digest.hexdigest()[:10]
