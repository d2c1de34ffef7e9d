# SPDX-License-Identifier: Apache-2.0
"""The template of a feature: the gradient of the log brightness around it, learned from its own events.

The events of a patch that moves by `s` sum, to first order, to `W = s . G`, where `G` is the gradient of the
log brightness (Gehrig et al., EKLT, ECCV 2018). `G` is estimated from all past windows by recursive least
squares (two images and one 2x2 matrix per feature). It gives a template for any direction of motion, so a
change of direction does not invalidate it. Patches are aligned with the template by efficient second-order
minimization (Benhimane and Malis, IROS 2004) with a free gain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.frontend.gradient.features import PATCH_HALF, ROW, TEMPLATE_HALF, TEMPLATE_SIDE, TEMPLATE_SIZE
from asyneio.frontend.gradient.patch import COLUMNS, clear_sums, shift_patch, total_of
from asyneio.frontend.tracker import Record
from asyneio.jit import njit

_FIRST, _MIDDLE, _LAST = 1, TEMPLATE_HALF, TEMPLATE_SIDE - 1


class Products(NamedTuple):
    """Weighted sums of products of template T and patch W."""

    tw: float
    tt: float
    ww: float


class NormalSums(NamedTuple):
    """Weighted sums of one alignment step: J J^T (xx, xy, yy), J r (x, y) and T W."""

    xx: float
    xy: float
    yy: float
    x: float
    y: float
    tw: float


@njit(cache=True)
def synthesise(
    feature: Record, gradient_sums: np.ndarray, slot: int, sx: float, sy: float, ridge: float, work: Record
) -> None:
    """Template for a displacement s = (sx, sy) in the patch frame: `T = s^T (A + ridge)^-1 B`."""
    xx, xy, yy = feature.xx + ridge, feature.xy, feature.yy + ridge
    det = xx * yy - xy * xy
    a = np.float32((yy * sx - xy * sy) / det)
    b = np.float32((xx * sy - xy * sx) / det)
    for k in range(TEMPLATE_SIZE):
        work.template[k] = a * gradient_sums[slot, 0, k] + b * gradient_sums[slot, 1, k]


@njit(cache=True)
def learn(
    feature: Record, gradient_sums: np.ndarray, slot: int, sx: float, sy: float, keep: float, work: Record
) -> None:
    """Add the aligned patch with displacement (sx, sy) to the sums of a slot; older patches are scaled by
    `keep`."""
    a, b, kept = np.float32(sx), np.float32(sy), np.float32(keep)
    for k in range(TEMPLATE_SIZE):
        w = work.shifted[k]
        gradient_sums[slot, 0, k] = kept * gradient_sums[slot, 0, k] + a * w
        gradient_sums[slot, 1, k] = kept * gradient_sums[slot, 1, k] + b * w
    feature.xx = keep * feature.xx + sx * sx
    feature.xy = keep * feature.xy + sx * sy
    feature.yy = keep * feature.yy + sy * sy


@njit(cache=True)
def correlate(work: Record) -> Products:
    """Weighted sums over the template and the shifted patch."""
    weight, W, T, sums = work.weight, work.shifted, work.template, work.sums
    clear_sums(work, 3)
    for v in range(TEMPLATE_SIDE):
        for u in range(COLUMNS):
            k = v * ROW + u
            m, w, t = weight[k], W[k], T[k]
            sums[u] += m * t * w
            sums[COLUMNS + u] += m * t * t
            sums[2 * COLUMNS + u] += m * w * w
    n = COLUMNS
    return Products(total_of(work, 0, 0, n), total_of(work, 1, 0, n), total_of(work, 2, 0, n))


@njit(cache=True)
def normal_equations(work: Record, gain: float, top: int, bottom: int) -> None:
    """Sum J J^T, J r and T W, weighted, over the rows top..bottom-1, column by column; see `read_sums`.

    `r = W - g T` and `J = (grad W + g grad T) / 2`. The gradient needs a margin: 1 <= top and
    bottom < TEMPLATE_SIDE.
    """
    g = np.float32(gain)
    weight, W, T, sums = work.weight, work.shifted, work.template, work.sums
    clear_sums(work, 6)
    # The bounds show the compiler that no index is negative; without them it does not vectorise.
    for v in range(max(top, 1), min(bottom, TEMPLATE_SIDE - 1)):
        for u in range(COLUMNS):
            k = v * ROW + u
            m, w, t = weight[k], W[k], T[k]
            jx = W[k + 1] - W[k - 1] + g * (T[k + 1] - T[k - 1])
            jy = W[k + ROW] - W[k - ROW] + g * (T[k + ROW] - T[k - ROW])
            r = w - g * t
            mx, my = m * jx, m * jy
            sums[u] += mx * jx
            sums[COLUMNS + u] += mx * jy
            sums[2 * COLUMNS + u] += my * jy
            sums[3 * COLUMNS + u] += mx * r
            sums[4 * COLUMNS + u] += my * r
            sums[5 * COLUMNS + u] += m * t * w


@njit(cache=True)
def read_sums(work: Record, start: int, end: int) -> NormalSums:
    """The sums of `normal_equations` over the columns start..end-1."""
    # Central differences, and the mean of two: a quarter each.
    return NormalSums(
        total_of(work, 0, start, end) / 16.0,
        total_of(work, 1, start, end) / 16.0,
        total_of(work, 2, start, end) / 16.0,
        total_of(work, 3, start, end) / 4.0,
        total_of(work, 4, start, end) / 4.0,
        total_of(work, 5, start, end),
    )


@njit(cache=True)
def match(work: Record, max_jump: float, min_corner: float, iterations: int, out: Record) -> bool:
    """Align the blurred patch with the template, into `out` MATCH_DTYPE.

    `min_corner` is the least determinant of the Hessian divided by its squared trace, at most a quarter; a
    smaller value means a straight edge, along which the position is undetermined. Returns False for such an
    edge, and for a shift beyond `max_jump`.
    """
    limit = min(max_jump, PATCH_HALF - TEMPLATE_HALF - 0.01)
    du = dv = 0.0
    shift_patch(work, du, dv)
    gain = 1.0
    tw, tt, _ = correlate(work)
    for _ in range(iterations):
        if tw <= 0.0 or tt <= 0.0:
            return False
        gain = tw / tt
        normal_equations(work, gain, _FIRST, _LAST)
        xx, xy, yy, x, y, tw = read_sums(work, 0, COLUMNS)
        det = xx * yy - xy * xy
        if det <= min_corner * (xx + yy) ** 2:
            return False
        du -= (yy * x - xy * y) / det
        dv -= (xx * y - xy * x) / det
        if not (abs(du) < limit and abs(dv) < limit):
            return False
        shift_patch(work, du, dv)
    out.u, out.v = du, dv
    return _measure(work, gain, out)


@njit(cache=True)
def _measure(work: Record, gain: float, out: Record) -> bool:
    """Correlation, residual, Hessian and disagreement of the halves after the last step, into `out`; False
    without contrast."""
    tw, tt, ww = correlate(work)
    if tt <= 0.0 or ww <= 0.0:
        return False
    normal_equations(work, gain, _FIRST, _MIDDLE)
    a, b = read_sums(work, 0, _MIDDLE), read_sums(work, _MIDDLE, COLUMNS)
    normal_equations(work, gain, _MIDDLE, _LAST)
    c, d = read_sums(work, 0, _MIDDLE), read_sums(work, _MIDDLE, COLUMNS)
    out.ncc = tw / np.sqrt(tt * ww)
    out.residual = ww * max(1.0 - out.ncc * out.ncc, 0.0)
    out.xx = a.xx + b.xx + c.xx + d.xx
    out.xy = a.xy + b.xy + c.xy + d.xy
    out.yy = a.yy + b.yy + c.yy + d.yy
    left_u, left_v = _shift_of(a, c)
    right_u, right_v = _shift_of(b, d)
    upper_u, upper_v = _shift_of(a, b)
    lower_u, lower_v = _shift_of(c, d)
    out.apart_h[0], out.apart_h[1] = right_u - left_u, right_v - left_v
    out.apart_v[0], out.apart_v[1] = lower_u - upper_u, lower_v - upper_v
    return True


@njit(cache=True)
def _shift_of(a: NormalSums, b: NormalSums) -> tuple[float, float]:
    """Remaining shift (u, v) of two quadrants together; damped, since half a patch may be a single edge."""
    xx, xy, yy, x, y = a.xx + b.xx, a.xy + b.xy, a.yy + b.yy, a.x + b.x, a.y + b.y
    damping = 0.02 * (xx + yy) + 1e-9
    xx += damping
    yy += damping
    det = xx * yy - xy * xy
    return -(yy * x - xy * y) / det, -(xx * y - xy * x) / det
