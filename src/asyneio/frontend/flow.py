"""Velocity of a young patch by contrast maximisation: the motion that draws the sharpest picture."""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.features import PATCH_HALF, PATCH_SIDE, RING, Features
from asyneio.frontend.patch import Workspace, blur, contrast, draw_patch
from asyneio.types import FloatArray


@nb.njit(cache=True)
def rough_contrast(
    features: Features, slot: int, count: int, every: int, x: float, y: float, vx: float, vy: float, t_ref: int,
    grid: np.ndarray,
) -> float:
    """Sum of squares of the patch with each event in its nearest pixel only: quick, for a coarse search."""
    grid[:] = 0.0
    ring = features.ring[slot]
    newest = features.written[slot] - 1
    total = np.float32(0.0)
    for i in range(0, count, every):
        k = (newest - i) % RING
        dt = (ring[k]["t_ns"] - t_ref) * 1e-9
        u = int(ring[k]["x"] - x - vx * dt + (PATCH_HALF + 0.5))
        v = int(ring[k]["y"] - y - vy * dt + (PATCH_HALF + 0.5))
        if u < 0 or v < 0 or u >= PATCH_SIDE or v >= PATCH_SIDE:
            continue
        w = ring[k]["w"]
        old = grid[v, u]
        total += w * (old + old + w)
        grid[v, u] = old + w
    return total


@nb.njit(cache=True)
def find_flow(
    features: Features, slot: int, count: int, at: FloatArray, span_s: float, reach_px: int, work: Workspace
) -> float:
    """Velocity that draws the sharpest patch, into `at[3:5]`; its contrast over that of no motion.

    Searches displacements over the window up to `reach_px` around the velocity given, coarse to fine.
    """
    t_ref = np.int64(at[0])
    x, y = at[1], at[2]
    cx, cy = at[3], at[4]
    best = np.float32(-1.0)
    bx, by = cx, cy
    every = count // 160 + 1
    for j in range(-reach_px, reach_px + 1):
        for i in range(-reach_px, reach_px + 1):
            vx, vy = cx + i / span_s, cy + j / span_s
            c = rough_contrast(features, slot, count, every, x, y, vx, vy, t_ref, work.patch)
            if c > best:
                best, bx, by = c, vx, vy
    at[3], at[4] = 0.0, 0.0
    draw_patch(features, slot, count, at, work)
    blur(work)
    still = contrast(work)
    sharpest = -1.0
    step = 0.5
    for _ in range(2):
        cx, cy = bx, by
        for j in range(-1, 2):
            for i in range(-1, 2):
                at[3], at[4] = cx + i * step / span_s, cy + j * step / span_s
                draw_patch(features, slot, count, at, work)
                blur(work)
                c = contrast(work)
                if c > sharpest:
                    sharpest, bx, by = c, at[3], at[4]
        step *= 0.5
    at[3], at[4] = bx, by
    return sharpest / max(still, 1e-9)
