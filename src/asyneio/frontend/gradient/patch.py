# SPDX-License-Identifier: Apache-2.0
"""Patches of events: drawn with motion compensation, blurred, shifted."""

from __future__ import annotations

import numpy as np

from asyneio.frontend.gradient.features import (
    MATCH_HALF,
    PATCH_HALF,
    PATCH_SIDE,
    PATCH_SIZE,
    RING,
    ROW,
    ROW_BITS,
    TEMPLATE_HALF,
    TEMPLATE_SIDE,
    TEMPLATE_SIZE,
)
from asyneio.frontend.tracker import Record
from asyneio.jit import njit
from asyneio.types import FloatArray, RecordArray

#: Sums over pixels are accumulated per column; the columns are added last. Such loops vectorise without
#: permission to reorder floating-point operations, so results are identical to the bit in every compilation.
#: Number of columns, and of sums that are accumulated together.
COLUMNS = 24
SUMS = 6

#: Result of matching a patch against a template.
MATCH_DTYPE = np.dtype(
    [
        ("u", "<f8"),  # shift of the patch [px]
        ("v", "<f8"),
        ("ncc", "<f8"),  # normalised correlation there
        ("xx", "<f8"),  # Hessian there
        ("xy", "<f8"),
        ("yy", "<f8"),
        ("residual", "<f8"),  # weighted sum of squares of the residual at the best gain
        ("apart_h", "<f8", (2,)),  # shift (u, v) of the right half minus that of the left half [px]
        ("apart_v", "<f8", (2,)),  # lower half minus upper half
    ]
)

#: Buffers of one update, and the frame in which its events are drawn.
WORK_DTYPE = np.dtype(
    [
        ("patch", "<f4", (PATCH_SIZE,)),
        ("rows", "<f4", (PATCH_SIZE,)),
        ("blurred", "<f4", (PATCH_SIZE,)),
        ("shifted", "<f4", (TEMPLATE_SIZE,)),
        ("template", "<f4", (TEMPLATE_SIZE,)),
        ("mask", "<f4", (TEMPLATE_SIZE,)),  # Gaussian, zero outside the region that is matched
        ("weight", "<f4", (TEMPLATE_SIZE,)),  # the mask where it is valid
        ("sketch", "<f4", (4, RING)),  # events of a growing feature: dx, dy, dt, w
        ("t_ns", "<i8"),  # frame: time at which its centre is at x, y [px], moving with vx, vy [px/s]
        ("x", "<f8"),
        ("y", "<f8"),
        ("vx", "<f8"),
        ("vy", "<f8"),
        ("roll", "<f8"),  # rad, rotates the patch frame into the image frame at `t_ns`
        ("roll_rate", "<f8"),  # rad/s
        ("sums", "<f4", (SUMS * COLUMNS,)),
        ("region", "<i4", (4,)),  # u0, u1, v0, v1 of the feature for which `weight` was filled
        ("share", "<f4"),  # of the mask in that region
        ("match", MATCH_DTYPE),
    ],
    align=True,
)

#: Limit on the lag: where events are few, noise resembles weak contrast.
_MAX_LAG_PX = 1.5


def make_workspace(mask_sigma_px: float) -> RecordArray:
    """Buffers (1,) WORK_DTYPE with the mask computed."""
    work = np.zeros(1, dtype=WORK_DTYPE)
    axis = np.arange(-TEMPLATE_HALF, TEMPLATE_HALF + 1)
    weight = np.exp(-0.5 * (axis / mask_sigma_px) ** 2) * (np.abs(axis) <= MATCH_HALF)
    mask = np.zeros((TEMPLATE_SIDE, ROW))
    mask[:, :TEMPLATE_SIDE] = np.outer(weight, weight)
    work["mask"][0] = mask.ravel()[:TEMPLATE_SIZE]
    work["region"] = -1
    return work


@njit(cache=True)
def draw_patch(rings: RecordArray, slot: int, newest: int, count: int, work: Record) -> None:
    """Draw `count` events of a ring, up to index `newest`, at their positions at the time of the frame."""
    patch = work.patch
    for k in range(PATCH_SIZE):
        patch[k] = 0.0
    cos, sin = np.cos(work.roll), np.sin(work.roll)
    t_ns, x, y, vx, vy, roll_rate = work.t_ns, work.x, work.y, work.vx, work.vy, work.roll_rate
    for i in range(count):
        event = rings[slot, (newest - i) & (RING - 1)]
        dt = (event.t_ns - t_ns) * 1e-9
        dx = event.x - x - vx * dt
        dy = event.y - y - vy * dt
        turn = roll_rate * dt
        # R(-roll - turn), linearized: the rotation within a window is small.
        c, s = cos - sin * turn, sin + cos * turn
        u = c * dx + s * dy + PATCH_HALF
        v = c * dy - s * dx + PATCH_HALF
        if u < 0.0 or v < 0.0 or u >= PATCH_SIDE - 1 or v >= PATCH_SIDE - 1:
            continue
        share(patch, u, v, event.w)


@njit(cache=True)
def share(patch: FloatArray, u: float, v: float, w: float) -> None:
    """Distribute `w` over the four pixels around (u, v), which must be inside the patch."""
    iu, iv = np.uint32(u), np.uint32(v)
    fu, fv = np.float32(u - iu), np.float32(v - iv)
    j = iv * np.uint32(ROW) + iu
    lower = w * fv
    upper = w - lower
    a, b = upper * fu, lower * fu
    patch[j] += upper - a
    patch[j + np.uint32(1)] += a
    patch[j + np.uint32(ROW)] += lower - b
    patch[j + np.uint32(ROW + 1)] += b


@njit(cache=True)
def blur(work: Record) -> None:
    """Binomial 1-4-6-4-1 along both axes, from `patch` into `blurred`; a margin of two pixels stays zero."""
    a, b, c = np.float32(1.0 / 16.0), np.float32(4.0 / 16.0), np.float32(6.0 / 16.0)
    source, rows, out = work.patch, work.rows, work.blurred
    for k in range(2, PATCH_SIZE - 2):
        rows[k] = a * (source[k - 2] + source[k + 2]) + b * (source[k - 1] + source[k + 1]) + c * source[k]
    one, two = ROW, 2 * ROW
    for v in range(2, PATCH_SIDE - 2):
        for k in range(v * ROW + 2, v * ROW + PATCH_SIDE - 2):
            out[k] = a * (rows[k - two] + rows[k + two]) + b * (rows[k - one] + rows[k + one]) + c * rows[k]


@njit(cache=True)
def shift_patch(work: Record, du: float, dv: float) -> None:
    """`shifted(X) = blurred(X + d)` over the template's region; |d| < PATCH_HALF - TEMPLATE_HALF."""
    iu, iv = int(np.floor(du)), int(np.floor(dv))
    fu, fv = np.float32(du - iu), np.float32(dv - iv)
    one = np.float32(1.0)
    w00, w01, w10, w11 = (one - fu) * (one - fv), fu * (one - fv), (one - fu) * fv, fu * fv
    margin = PATCH_HALF - TEMPLATE_HALF
    source, out = work.blurred, work.shifted
    # The bounds show the compiler that no index is negative.
    first = min(max((margin + iv) * ROW + margin + iu, 0), 2 * margin * ROW)
    for k in range(TEMPLATE_SIZE):
        j = first + k
        out[k] = w00 * source[j] + w01 * source[j + 1] + w10 * source[j + ROW] + w11 * source[j + ROW + 1]


@njit(cache=True)
def contrast(work: Record) -> float:
    """Sum of squares of the blurred patch over the mask."""
    first = (PATCH_HALF - TEMPLATE_HALF) * (ROW + 1)
    mask, blurred, sums = work.mask, work.blurred, work.sums
    clear_sums(work, 1)
    for v in range(TEMPLATE_SIDE):
        for u in range(COLUMNS):
            k = v * ROW + u
            w = blurred[first + k]
            sums[u] += mask[k] * w * w
    return total_of(work, 0, 0, COLUMNS)


@njit(cache=True)
def clear_sums(work: Record, count: int) -> None:
    """Set the first `count` sums to zero."""
    for k in range(count * COLUMNS):
        work.sums[k] = 0.0


@njit(cache=True)
def total_of(work: Record, which: int, start: int, end: int) -> float:
    """One of the sums over the columns start..end-1."""
    total = 0.0
    for u in range(start, end):
        total += work.sums[which * COLUMNS + u]
    return total


@njit(cache=True)
def restrict(feature: Record, x: float, y: float, width: int, height: int) -> None:
    """Restrict a feature's valid region to what lies inside the image with the patch's centre at (x, y)."""
    feature.u0 = max(feature.u0, int(np.ceil(TEMPLATE_HALF - x)) + 1)
    feature.u1 = min(feature.u1, int(np.floor(TEMPLATE_HALF + width - 1 - x)) - 1)
    feature.v0 = max(feature.v0, int(np.ceil(TEMPLATE_HALF - y)) + 1)
    feature.v1 = min(feature.v1, int(np.floor(TEMPLATE_HALF + height - 1 - y)) - 1)


@njit(cache=True)
def weigh(feature: Record, work: Record) -> float:
    """Compute `weight`, the mask within the valid region of a feature; returns its share of the full mask."""
    u0, u1, v0, v1 = feature.u0, feature.u1, feature.v0, feature.v1
    region = work.region
    # Most features are well inside the image and share their weights.
    if region[0] == u0 and region[1] == u1 and region[2] == v0 and region[3] == v1:
        return work.share
    region[0], region[1], region[2], region[3] = u0, u1, v0, v1
    zero = np.float32(0.0)
    total = left = zero
    for k in range(TEMPLATE_SIZE):
        u, v = k & (ROW - 1), k >> ROW_BITS
        w = work.mask[k]
        valid = w if (u >= u0) & (u <= u1) & (v >= v0) & (v <= v1) else zero
        work.weight[k] = valid
        total += w
        left += valid
    work.share = left / total
    return work.share


@njit(cache=True)
def seen_lag(work: Record, moved_px: float) -> float:
    """Lag of the event image behind the scene [px]: the motion that changes brightness by half a threshold.

    An event is triggered when the brightness has changed by a whole threshold, on average half a threshold
    late. The event image therefore lags along the direction of motion, and jumps when that direction changes:
    by `1 / 2n` for `n` events per pixel and pixel of motion. `n` is the mean of |W| / moved, weighted by the
    squared contrast, as in the match.
    """
    absolute = square = 0.0
    for k in range(TEMPLATE_SIZE):
        w = work.shifted[k]
        absolute += work.weight[k] * abs(w)
        square += work.weight[k] * w * w
    return min(0.5 * moved_px * absolute / max(square, 1e-9), _MAX_LAG_PX)
