"""State of all features, in flat arrays: one slot a feature, nothing allocated while events flow."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.types import NS_PER_S, FloatArray, IntArray

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
    disagreement: FloatArray  # (N,4) running mean of right minus left, lower minus upper half's shift (u, v each)
    sigma: FloatArray  # (N,) running mean of the matching error along the worst direction, noise units
    emitted_ns: IntArray  # (N,) last observation given out


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
        disagreement=floats(4),
        sigma=floats(),
        emitted_ns=ints(),
    )


@nb.njit(cache=True)
def push(features: Features, slot: int, t_ns: int, x: int, y: int, w: float) -> bool:
    """Keep an event, or skip it if the stride says so. Whether it was kept."""
    features.skipped[slot] += 1
    stride = features.stride[slot]
    if features.skipped[slot] < stride:
        return False
    features.skipped[slot] = 0
    k = features.written[slot] % RING
    ring = features.ring[slot]
    ring[k]["t_ns"] = t_ns
    ring[k]["x"] = x
    ring[k]["y"] = y
    ring[k]["w"] = w * stride
    features.written[slot] += 1
    features.fresh[slot] += 1
    return True


@nb.njit(cache=True)
def newest_events(features: Features, slot: int, wanted: int, max_ns: int) -> tuple[int, int, int, int]:
    """How many of the newest events to take, their first, mean and last time [ns]."""
    ring = features.ring[slot]
    newest = features.written[slot] - 1
    last = ring[newest % RING]["t_ns"]
    available = min(wanted, min(features.written[slot], RING))
    total = np.int64(0)
    first = last
    count = 0
    for i in range(available):
        t = ring[(newest - i) % RING]["t_ns"]
        if last - t > max_ns:
            break
        total += last - t
        first = t
        count += 1
    return count, first, last - total // max(count, 1), last


@nb.njit(cache=True)
def thin_out(features: Features, slot: int) -> None:
    """Keep every other event of a full ring, and of those to come: twice the time in the same memory."""
    ring = features.ring[slot]
    oldest = features.written[slot] - RING
    kept = np.empty_like(ring)
    for i in range(RING // 2):
        kept[i] = ring[(oldest + 2 * i + 1) % RING]
        kept[i]["w"] *= np.float32(2.0)
    for i in range(RING // 2):
        ring[i] = kept[i]
    features.written[slot] = RING // 2
    features.stride[slot] *= 2


@nb.njit(cache=True)
def shrink_valid(features: Features, slot: int, x: float, y: float, width: int, height: int) -> None:
    """Restrict the valid region to what lies inside the image with the patch's centre at (x, y)."""
    valid = features.valid[slot]
    valid[0] = max(valid[0], int(np.ceil(TEMPLATE_HALF - x)) + 1)
    valid[1] = min(valid[1], int(np.floor(TEMPLATE_HALF + width - 1 - x)) - 1)
    valid[2] = max(valid[2], int(np.ceil(TEMPLATE_HALF - y)) + 1)
    valid[3] = min(valid[3], int(np.floor(TEMPLATE_HALF + height - 1 - y)) - 1)


@nb.njit(cache=True)
def begin(features: Features, t_ns: int, x: int, y: int) -> int:
    """Begin a feature at a corner, in a free slot: there must be one."""
    slot = 0
    while features.state[slot] != FREE:
        slot += 1
    features.state[slot] = GROWING
    features.centre[slot, 0], features.centre[slot, 1] = x, y
    features.velocity[slot] = 0.0
    features.t_ns[slot] = t_ns
    features.born_ns[slot] = t_ns
    features.emitted_ns[slot] = t_ns - NS_PER_S
    features.written[slot] = 0
    features.fresh[slot] = 0
    features.stride[slot] = 1
    features.skipped[slot] = 0
    valid = features.valid[slot]
    valid[0], valid[1], valid[2], valid[3] = 0, TEMPLATE_SIDE - 1, 0, TEMPLATE_SIDE - 1
    return slot
