"""The template of a feature: the gradient of the log brightness around it, learned from its own events.

Events that a patch collects while it moves by `s` add up, to first order, to `W = s . G`, where `G` is the
gradient of the log brightness there (Gehrig et al., EKLT 2018). `G` is estimated from all past windows by
recursive least squares (two images and one 2x2 matrix a feature) and gives the template for whatever
direction the motion now has, so that a turn does not age it. Patches are registered against it by efficient
second-order minimisation (Benhimane and Malis 2004) with a free gain.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.features import PATCH_HALF, ROW, TEMPLATE_HALF, TEMPLATE_SIDE, TEMPLATE_SIZE
from asyneio.frontend.patch import ALL, LEFT, REORDER, RIGHT, shift_patch
from asyneio.frontend.record import Record

#: Least determinant of the Hessian over its squared trace (a quarter at best): less is a straight edge, along
#: which a patch slides.
_LEAST_CORNER = 0.03
_FIRST = ROW
_MIDDLE = TEMPLATE_HALF * ROW
_LAST = (TEMPLATE_SIDE - 1) * ROW


@nb.njit(cache=True)
def synthesise(
    feature: Record, evidence: np.ndarray, slot: int, sx: float, sy: float, ridge: float, work: Record
) -> None:
    """Template for a displacement s = (sx, sy) in the patch frame: `T = s^T (A + ridge)^-1 B`."""
    xx, xy, yy = feature.xx + ridge, feature.xy, feature.yy + ridge
    det = xx * yy - xy * xy
    a = np.float32((yy * sx - xy * sy) / det)
    b = np.float32((xx * sy - xy * sx) / det)
    for k in range(TEMPLATE_SIZE):
        work.template[k] = a * evidence[slot, 0, k] + b * evidence[slot, 1, k]


@nb.njit(cache=True)
def learn(
    feature: Record, evidence: np.ndarray, slot: int, sx: float, sy: float, keep: float, work: Record
) -> None:
    """Add the registered patch, seen under displacement (sx, sy), to the evidence; older evidence fades."""
    a, b, kept = np.float32(sx), np.float32(sy), np.float32(keep)
    for k in range(TEMPLATE_SIZE):
        w = work.shifted[k]
        evidence[slot, 0, k] = kept * evidence[slot, 0, k] + a * w
        evidence[slot, 1, k] = kept * evidence[slot, 1, k] + b * w
    feature.xx = keep * feature.xx + sx * sx
    feature.xy = keep * feature.xy + sx * sy
    feature.yy = keep * feature.yy + sy * sy


@nb.njit(cache=True, fastmath=REORDER)
def correlate(work: Record) -> tuple[float, float, float]:
    """Weighted sums T W, T T and W W."""
    tw = tt = ww = np.float32(0.0)
    for k in range(_FIRST, _LAST):
        weight, w, t = work.weight[ALL, k], work.shifted[k], work.template[k]
        tw += weight * t * w
        tt += weight * t * t
        ww += weight * w * w
    return float(tw), float(tt), float(ww)


@nb.njit(cache=True, fastmath=REORDER)
def normal_equations(
    work: Record, part: int, gain: float, start: int, end: int
) -> tuple[float, float, float, float, float, float]:
    """Weighted sums of J J^T (xx, xy, yy), J r (x, y) and T W over the pixels start..end-1 of a part of the
    patch.

    `r = W - g T` and `J = (grad W + g grad T) / 2`.
    """
    g = np.float32(gain)
    # The bounds tell the compiler that no index is negative; without them it does not vectorise.
    start, end = max(start, _FIRST), min(end, _LAST)
    xx = xy = yy = x = y = tw = np.float32(0.0)
    W, T = work.shifted, work.template
    for k in range(start, end):
        jx = W[k + 1] - W[k - 1] + g * (T[k + 1] - T[k - 1])
        jy = W[k + ROW] - W[k - ROW] + g * (T[k + ROW] - T[k - ROW])
        w, t, weight = W[k], T[k], work.weight[part, k]
        r = w - g * t
        wx, wy = weight * jx, weight * jy
        xx += wx * jx
        xy += wx * jy
        yy += wy * jy
        x += wx * r
        y += wy * r
        tw += weight * t * w
    # Central differences, and the mean of two: a quarter each.
    return float(xx) / 16.0, float(xy) / 16.0, float(yy) / 16.0, float(x) / 4.0, float(y) / 4.0, float(tw)


@nb.njit(cache=True)
def match(work: Record, max_jump: float, iterations: int, out: Record) -> bool:
    """Register the blurred patch against the template; `out` MATCH_DTYPE.

    False when it leaves the patch or has no corner to hold on to.
    """
    limit = min(max_jump, PATCH_HALF - TEMPLATE_HALF - 0.01)
    du = dv = 0.0
    shift_patch(work, du, dv)
    gain = 1.0
    tw, tt, ww = correlate(work)
    for _ in range(iterations):
        if tw <= 0.0 or tt <= 0.0:
            return False
        gain = tw / tt
        xx, xy, yy, x, y, tw = normal_equations(work, ALL, gain, _FIRST, _LAST)
        det = xx * yy - xy * xy
        if det <= _LEAST_CORNER * (xx + yy) ** 2:
            return False
        du -= (yy * x - xy * y) / det
        dv -= (xx * y - xy * x) / det
        if not (abs(du) < limit and abs(dv) < limit):
            return False
        shift_patch(work, du, dv)
    tw, tt, ww = correlate(work)
    if tt <= 0.0 or ww <= 0.0:
        return False
    a = normal_equations(work, LEFT, gain, _FIRST, _MIDDLE)
    b = normal_equations(work, RIGHT, gain, _FIRST, _MIDDLE)
    c = normal_equations(work, LEFT, gain, _MIDDLE, _LAST)
    d = normal_equations(work, RIGHT, gain, _MIDDLE, _LAST)
    out.u, out.v = du, dv
    out.ncc = tw / np.sqrt(tt * ww)
    out.residual = ww * max(1.0 - out.ncc * out.ncc, 0.0)
    out.xx = a[0] + b[0] + c[0] + d[0]
    out.xy = a[1] + b[1] + c[1] + d[1]
    out.yy = a[2] + b[2] + c[2] + d[2]
    left_u, left_v = _shift_of(a, c)
    right_u, right_v = _shift_of(b, d)
    upper_u, upper_v = _shift_of(a, b)
    lower_u, lower_v = _shift_of(c, d)
    out.apart_h[0], out.apart_h[1] = right_u - left_u, right_v - left_v
    out.apart_v[0], out.apart_v[1] = lower_u - upper_u, lower_v - upper_v
    return True


@nb.njit(cache=True)
def _shift_of(
    a: tuple[float, float, float, float, float, float], b: tuple[float, float, float, float, float, float]
) -> tuple[float, float]:
    """Shift that two quadrants together still ask for; damped, since half a patch may be one edge."""
    xx, xy, yy, x, y = a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4]
    damping = 0.02 * (xx + yy) + 1e-9
    xx += damping
    yy += damping
    det = xx * yy - xy * xy
    return -(yy * x - xy * y) / det, -(xx * y - xy * x) / det
