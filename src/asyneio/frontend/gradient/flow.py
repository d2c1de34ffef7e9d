# SPDX-License-Identifier: Apache-2.0
"""Velocity of a growing feature by contrast maximization: the motion whose patch has the highest contrast."""

from __future__ import annotations

import numpy as np

from asyneio.frontend.gradient.features import PATCH_HALF, PATCH_SIDE, PATCH_SIZE, RING, ROW
from asyneio.frontend.gradient.patch import blur, contrast, share
from asyneio.frontend.tracker import Record
from asyneio.jit import njit
from asyneio.types import FloatArray, RecordArray

#: Largest number of events in the coarse search.
_SKETCHED = 160
#: Largest distance of the peak from the best whole pixel, in half pixels.
_FURTHEST = 1.5


@njit(cache=True)
def make_sketch(rings: RecordArray, slot: int, newest: int, count: int, work: Record) -> None:
    """Copy the newest `count` events, relative to the frame, to contiguous memory."""
    middle = PATCH_HALF - work.x, PATCH_HALF - work.y
    for i in range(count):
        event = rings[slot, (newest - i) & (RING - 1)]
        dt = (event.t_ns - work.t_ns) * 1e-9
        dx, dy = event.x + middle[0], event.y + middle[1]
        # Rotation of the camera since then, about the centre of the patch; small within a window.
        turn = work.roll_rate * dt
        work.sketch[0, i] = dx + turn * (dy - PATCH_HALF)
        work.sketch[1, i] = dy - turn * (dx - PATCH_HALF)
        work.sketch[2, i] = dt
        work.sketch[3, i] = event.w


@njit(cache=True)
def rough_contrast(work: Record, count: int, every: int, vx: float, vy: float) -> float:
    """Sum of squares of the patch with one in `every` events, each in its nearest pixel: fast."""
    patch, sketch = work.patch, work.sketch
    for k in range(PATCH_SIZE):
        patch[k] = 0.0
    vx32, vy32 = np.float32(vx), np.float32(vy)
    side, zero, total, half = np.float32(PATCH_SIDE), np.float32(0.0), np.float32(0.0), np.float32(0.5)
    for i in range(0, count, every):
        u = sketch[0, i] - vx32 * sketch[2, i] + half
        v = sketch[1, i] - vy32 * sketch[2, i] + half
        if u < zero or v < zero or u >= side or v >= side:
            continue
        j = np.uint32(v) * np.uint32(ROW) + np.uint32(u)
        w = sketch[3, i]
        old = patch[j]
        total += w * (old + old + w)
        patch[j] = old + w
    return float(total)


@njit(cache=True)
def draw_sketch(work: Record, count: int, vx: float, vy: float) -> None:
    """As `draw_patch`, with the copied events and another velocity."""
    patch, sketch = work.patch, work.sketch
    for k in range(PATCH_SIZE):
        patch[k] = 0.0
    vx32, vy32 = np.float32(vx), np.float32(vy)
    end, zero = np.float32(PATCH_SIDE - 1), np.float32(0.0)
    for i in range(count):
        u = sketch[0, i] - vx32 * sketch[2, i]
        v = sketch[1, i] - vy32 * sketch[2, i]
        if u < zero or v < zero or u >= end or v >= end:
            continue
        share(patch, u, v, sketch[3, i])


@njit(cache=True)
def fine_contrast(work: Record, count: int, vx: float, vy: float) -> float:
    """Contrast of the blurred patch with all copied events."""
    draw_sketch(work, count, vx, vy)
    blur(work)
    return contrast(work)


@njit(cache=True)
def find_flow(
    rings: RecordArray, slot: int, newest: int, count: int, span_s: float, reach_px: int, work: Record
) -> float:
    """Write the velocity whose patch has the highest contrast to the frame `work`.

    The search covers displacements over the window up to `reach_px` around the initial velocity: whole pixels
    with some of the events, half pixels around the best with all events, then the peak of a paraboloid.

    Returns:
        The contrast at that velocity divided by the contrast at zero velocity.
    """
    cx, cy = work.vx, work.vy
    best = -1.0
    bx, by = cx, cy
    make_sketch(rings, slot, newest, count, work)
    every = count // _SKETCHED + 1
    for j in range(-reach_px, reach_px + 1):
        for i in range(-reach_px, reach_px + 1):
            vx, vy = cx + i / span_s, cy + j / span_s
            c = rough_contrast(work, count, every, vx, vy)
            if c > best:
                best, bx, by = c, vx, vy
    step = 0.5 / span_s
    without_motion = fine_contrast(work, count, 0.0, 0.0)
    around = np.empty((3, 3))
    for j in range(3):
        for i in range(3):
            around[j, i] = fine_contrast(work, count, bx + (i - 1) * step, by + (j - 1) * step)
    du, dv = peak_of(around)
    work.vx, work.vy = bx + du * step, by + dv * step
    return around[_largest(around)] / max(without_motion, 1e-9)


@njit(cache=True)
def peak_of(around: FloatArray) -> tuple[float, float]:
    """Peak (u, v) of the paraboloid fitted to 3x3 values (row v, column u), in steps from the middle.

    The position of the largest value if there is no peak within a step and a half.
    """
    left = around[0, 0] + around[1, 0] + around[2, 0]
    right = around[0, 2] + around[1, 2] + around[2, 2]
    upper = around[0, 0] + around[0, 1] + around[0, 2]
    lower = around[2, 0] + around[2, 1] + around[2, 2]
    total = left + right + around[0, 1] + around[1, 1] + around[2, 1]
    gu, gv = (right - left) / 6.0, (lower - upper) / 6.0
    # Second differences of the sums of rows and columns.
    uu, vv = (3.0 * (left + right) - 2.0 * total) / 3.0, (3.0 * (upper + lower) - 2.0 * total) / 3.0
    uv = (around[0, 0] + around[2, 2] - around[0, 2] - around[2, 0]) / 4.0
    det = uu * vv - uv * uv
    if uu < 0.0 and det > 1e-3 * uu * uu:
        du, dv = (uv * gv - vv * gu) / det, (uv * gu - uu * gv) / det
        if abs(du) <= _FURTHEST and abs(dv) <= _FURTHEST:
            return du, dv
    row, column = _largest(around)
    return column - 1.0, row - 1.0


@njit(cache=True)
def _largest(around: FloatArray) -> tuple[int, int]:
    """Row and column of the largest of 3x3 values; the first one if several are equal."""
    row, column = 0, 0
    for j in range(3):
        for i in range(3):
            if around[j, i] > around[row, column]:
                row, column = j, i
    return row, column
