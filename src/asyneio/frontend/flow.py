"""Velocity of a young patch by contrast maximisation: the motion that draws the sharpest picture."""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.features import PATCH_HALF, PATCH_SIDE, PATCH_SIZE, RING, ROW
from asyneio.frontend.patch import SKETCH, blur, contrast, draw_patch
from asyneio.frontend.record import Record
from asyneio.types import RecordArray


@nb.njit(cache=True)
def make_sketch(rings: RecordArray, slot: int, newest: int, count: int, work: Record) -> int:
    """Copy some of the newest `count` events, relative to the frame, to where they are read quickly; how
    many."""
    every = count // SKETCH + 1
    n = 0
    for i in range(0, count, every):
        event = rings[slot, (newest - i) & (RING - 1)]
        work.sketch[0, n] = event.x - work.x + (PATCH_HALF + 0.5)
        work.sketch[1, n] = event.y - work.y + (PATCH_HALF + 0.5)
        work.sketch[2, n] = (event.t_ns - work.t_ns) * 1e-9
        work.sketch[3, n] = event.w
        n += 1
    return n


@nb.njit(cache=True)
def rough_contrast(work: Record, n: int, vx: float, vy: float) -> float:
    """Sum of squares of the patch with each sketched event in its nearest pixel only: quick, for a coarse
    search."""
    patch, sketch = work.patch, work.sketch
    for k in range(PATCH_SIZE):
        patch[k] = 0.0
    vx32, vy32 = np.float32(vx), np.float32(vy)
    side, zero, total = np.float32(PATCH_SIDE), np.float32(0.0), np.float32(0.0)
    for i in range(n):
        u = sketch[0, i] - vx32 * sketch[2, i]
        v = sketch[1, i] - vy32 * sketch[2, i]
        if u < zero or v < zero or u >= side or v >= side:
            continue
        j = np.uint32(v) * np.uint32(ROW) + np.uint32(u)
        w = sketch[3, i]
        old = patch[j]
        total += w * (old + old + w)
        patch[j] = old + w
    return float(total)


@nb.njit(cache=True)
def find_flow(
    rings: RecordArray, slot: int, newest: int, count: int, span_s: float, reach_px: int, work: Record
) -> float:
    """Velocity that draws the sharpest patch, into the frame `work`; its contrast over that of no motion.

    Searches displacements over the window up to `reach_px` around the velocity given, coarse to fine.
    """
    cx, cy = work.vx, work.vy
    best = -1.0
    bx, by = cx, cy
    n = make_sketch(rings, slot, newest, count, work)
    for j in range(-reach_px, reach_px + 1):
        for i in range(-reach_px, reach_px + 1):
            vx, vy = cx + i / span_s, cy + j / span_s
            c = rough_contrast(work, n, vx, vy)
            if c > best:
                best, bx, by = c, vx, vy
    still = sharpest = -1.0
    step = 0.5
    for attempt in range(19):
        # No motion, then two rounds of nine around the best.
        if attempt % 9 == 1:
            cx, cy = bx, by
            step = 0.5 if attempt == 1 else 0.25
        work.vx = cx + ((attempt - 1) % 3 - 1) * step / span_s if attempt else 0.0
        work.vy = cy + ((attempt - 1) // 3 % 3 - 1) * step / span_s if attempt else 0.0
        draw_patch(rings, slot, newest, count, work)
        blur(work)
        c = contrast(work)
        if attempt == 0:
            still = c
        elif c > sharpest:
            sharpest, bx, by = c, work.vx, work.vy
    work.vx, work.vy = bx, by
    return sharpest / max(still, 1e-9)
