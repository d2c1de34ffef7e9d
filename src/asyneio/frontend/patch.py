"""Patches of events: drawn with motion compensation, blurred, shifted."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.features import (
    MATCH_HALF,
    PATCH_HALF,
    PATCH_SIDE,
    RING,
    TEMPLATE_HALF,
    TEMPLATE_SIDE,
    Features,
)
from asyneio.types import FloatArray


class Workspace(NamedTuple):
    """Buffers of one update, float32."""

    patch: np.ndarray  # (PATCH_SIDE, PATCH_SIDE)
    blurred: np.ndarray
    rows: np.ndarray
    shifted: np.ndarray  # (TEMPLATE_SIDE, TEMPLATE_SIDE)
    template: np.ndarray
    mask: np.ndarray
    active: np.ndarray


def make_workspace(mask_sigma_px: float) -> Workspace:
    """Buffers, and the Gaussian mask within the region that is matched."""
    patch = np.zeros((PATCH_SIDE, PATCH_SIDE), dtype=np.float32)
    template = np.zeros((TEMPLATE_SIDE, TEMPLATE_SIDE), dtype=np.float32)
    axis = np.arange(-TEMPLATE_HALF, TEMPLATE_HALF + 1)
    weight = np.exp(-0.5 * (axis / mask_sigma_px) ** 2) * (np.abs(axis) <= MATCH_HALF)
    mask = np.outer(weight, weight).astype(np.float32)
    return Workspace(
        patch, patch.copy(), patch.copy(), template, template.copy(), mask, template.copy()
    )


@nb.njit(cache=True)
def draw_patch(features: Features, slot: int, count: int, at: FloatArray, work: Workspace) -> None:
    """Draw the newest `count` events, compensated to `at` = [t_ns, x, y, vx, vy, roll, roll_rate].

    `roll` turns the patch frame into the image frame at that time.
    """
    patch = work.patch
    patch[:] = 0.0
    ring = features.ring[slot]
    newest = features.written[slot] - 1
    cos, sin = np.cos(at[5]), np.sin(at[5])
    t_ref = np.int64(at[0])
    for i in range(count):
        k = (newest - i) % RING
        dt = (ring[k]["t_ns"] - t_ref) * 1e-9
        dx = ring[k]["x"] - at[1] - at[3] * dt
        dy = ring[k]["y"] - at[2] - at[4] * dt
        turn = at[6] * dt
        # R(-roll - turn): the turn within a window is small.
        c, s = cos - sin * turn, sin + cos * turn
        u = c * dx + s * dy + PATCH_HALF
        v = c * dy - s * dx + PATCH_HALF
        if u < 0.0 or v < 0.0 or u >= PATCH_SIDE - 1 or v >= PATCH_SIDE - 1:
            continue
        iu, iv = int(u), int(v)
        fu, fv = np.float32(u - iu), np.float32(v - iv)
        w = ring[k]["w"]
        one = np.float32(1.0)
        patch[iv, iu] += w * (one - fu) * (one - fv)
        patch[iv, iu + 1] += w * fu * (one - fv)
        patch[iv + 1, iu] += w * (one - fu) * fv
        patch[iv + 1, iu + 1] += w * fu * fv


@nb.njit(cache=True, fastmath=True)
def blur(work: Workspace) -> None:
    """Binomial 1-4-6-4-1 along both axes, from `patch` into `blurred`; the rim of two pixels is zero."""
    n = PATCH_SIDE
    a, b, c = np.float32(1.0 / 16.0), np.float32(4.0 / 16.0), np.float32(6.0 / 16.0)
    source, rows, out = work.patch, work.rows, work.blurred
    for v in range(n):
        for u in range(2, n - 2):
            rows[v, u] = (
                a * (source[v, u - 2] + source[v, u + 2])
                + b * (source[v, u - 1] + source[v, u + 1])
                + c * source[v, u]
            )
    for v in range(2, n - 2):
        for u in range(2, n - 2):
            out[v, u] = (
                a * (rows[v - 2, u] + rows[v + 2, u]) + b * (rows[v - 1, u] + rows[v + 1, u]) + c * rows[v, u]
            )


@nb.njit(cache=True, fastmath=True)
def shift_patch(work: Workspace, du: float, dv: float) -> None:
    """`shifted(X) = blurred(X + d)` over the template's region; |d| < PATCH_HALF - TEMPLATE_HALF."""
    iu, iv = int(np.floor(du)), int(np.floor(dv))
    fu, fv = np.float32(du - iu), np.float32(dv - iv)
    one = np.float32(1.0)
    w00, w01, w10, w11 = (one - fu) * (one - fv), fu * (one - fv), (one - fu) * fv, fu * fv
    margin = PATCH_HALF - TEMPLATE_HALF
    source, out = work.blurred, work.shifted
    for v in range(TEMPLATE_SIDE):
        y = v + margin + iv
        for u in range(TEMPLATE_SIDE):
            x = u + margin + iu
            out[v, u] = (
                w00 * source[y, x] + w01 * source[y, x + 1] + w10 * source[y + 1, x] + w11 * source[y + 1, x + 1]
            )


@nb.njit(cache=True)
def contrast(work: Workspace) -> float:
    """Sum of squares of the blurred patch over the mask."""
    margin = PATCH_HALF - TEMPLATE_HALF
    total = 0.0
    for v in range(TEMPLATE_SIDE):
        for u in range(TEMPLATE_SIDE):
            w = work.blurred[v + margin, u + margin]
            total += work.mask[v, u] * w * w
    return total


@nb.njit(cache=True)
def activate_mask(features: Features, slot: int, work: Workspace) -> float:
    """Mask restricted to the region that always lay inside the image; the share of the weight left."""
    u0, u1, v0, v1 = features.valid[slot]
    total = left = 0.0
    for v in range(TEMPLATE_SIDE):
        for u in range(TEMPLATE_SIDE):
            w = work.mask[v, u]
            total += w
            inside = u0 <= u <= u1 and v0 <= v <= v1
            work.active[v, u] = w if inside else np.float32(0.0)
            if inside:
                left += w
    return left / total
