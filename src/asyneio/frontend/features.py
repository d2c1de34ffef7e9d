"""State of all features, in flat arrays: one slot a feature, nothing allocated while events flow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.types import FloatArray, IntArray

FREE = 0
GROWING = 1
TRACKING = 2

#: An event as a feature keeps it: time, pixel, and polarity times what the event stands for.
RING_DTYPE = np.dtype([("t_ns", "<i8"), ("x", "<i2"), ("y", "<i2"), ("w", "<f4")], align=True)

#: Events a feature keeps.
RING = 512

#: Half sides [px]: of the region that is matched, of the template (one more, for its gradient) and of the
#: patch into which events are drawn (room for the largest jump that is accepted).
MATCH_HALF = 10
TEMPLATE_HALF = 11
PATCH_HALF = 14
TEMPLATE_SIDE = 2 * TEMPLATE_HALF + 1
PATCH_SIDE = 2 * PATCH_HALF + 1


class Features(NamedTuple):
    """N slots. Positions and velocities in distorted pixels, in the image frame unless said otherwise."""

    state: np.ndarray  # (N,) FREE, GROWING or TRACKING
    id: IntArray  # (N,)
    centre: FloatArray  # (N,2) centre of the patch at `t_ns`
    velocity: FloatArray  # (N,2) px/s
    t_ns: IntArray  # (N,) what `centre` belongs to
    born_ns: IntArray  # (N,)
    birth_roll: FloatArray  # (N,) rad, roll of the camera when the patch was cut
    offset: FloatArray  # (N,2) of the reported point from the centre, patch frame
    density: FloatArray  # (N,) events per pixel of displacement
    refusals: IntArray  # (N,) in a row
    ring: np.ndarray  # (N,RING) RING_DTYPE
    written: IntArray  # (N,) events put into the ring since birth
    fresh: IntArray  # (N,) of these, since the last attempt
    stride: IntArray  # (N,) only every so many-th event is kept
    skipped: IntArray  # (N,)
    evidence: np.ndarray  # (N,2,side,side) float32, sum of displacement times patch
    information: FloatArray  # (N,3) xx, xy, yy: sum of displacement times its transpose
    valid: IntArray  # (N,4) region of the template that was always inside the image: u0, u1, v0, v1
    quality: FloatArray  # (N,Q) diagnostics of the last update


def make_features(capacity: int) -> Features:
    """Empty slots."""

    def ints(*shape: int) -> IntArray:
        return np.zeros((capacity, *shape), dtype=np.int64)

    def floats(*shape: int) -> FloatArray:
        return np.zeros((capacity, *shape))

    return Features(
        state=np.zeros(capacity, dtype=np.uint8),
        id=ints(),
        centre=floats(2),
        velocity=floats(2),
        t_ns=ints(),
        born_ns=ints(),
        birth_roll=floats(),
        offset=floats(2),
        density=floats(),
        refusals=ints(),
        ring=np.zeros((capacity, RING), dtype=RING_DTYPE),
        written=ints(),
        fresh=ints(),
        stride=ints(),
        skipped=ints(),
        evidence=np.zeros((capacity, 2, TEMPLATE_SIDE, TEMPLATE_SIDE), dtype=np.float32),
        information=floats(3),
        valid=ints(4),
        quality=floats(8),
    )
