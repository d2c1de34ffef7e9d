"""The template of a feature: the gradient of the log brightness around it, learned from its own events.

Events that a patch collects while it moves by `s` add up, to first order, to `W = s . G`, where `G` is the gradient of
the log brightness there (Gehrig et al., EKLT 2018). `G` is estimated from all past windows by recursive least
squares (two images and one 2x2 matrix a feature) and gives the template for whatever direction the motion now
has, so that a turn does not age it. Patches are registered against it by efficient second-order minimisation
(Benhimane and Malis 2004) with a free gain.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.features import PATCH_HALF, TEMPLATE_HALF, TEMPLATE_SIDE, Features
from asyneio.frontend.patch import Workspace, shift_patch
from asyneio.types import FloatArray

#: Number of sums that `sums` makes, and of values that `match` gives out.
SUMS = 8
MATCH = 3 + SUMS + 4


@nb.njit(cache=True, fastmath=True)
def synthesise(features: Features, slot: int, sx: float, sy: float, ridge: float, work: Workspace) -> float:
    """Template for a displacement (sx, sy) in the patch frame; its relative predicted variance.

    `T = s^T (A + ridge)^-1 B`. The second value, `s^T (A + ridge)^-1 s`, is large for a direction not seen yet.
    """
    xx = features.information[slot, 0] + ridge
    xy = features.information[slot, 1]
    yy = features.information[slot, 2] + ridge
    det = xx * yy - xy * xy
    a = np.float32((yy * sx - xy * sy) / det)
    b = np.float32((xx * sy - xy * sx) / det)
    B, T = features.evidence[slot], work.template
    for v in range(TEMPLATE_SIDE):
        for u in range(TEMPLATE_SIDE):
            T[v, u] = a * B[0, v, u] + b * B[1, v, u]
    return a * sx + b * sy


@nb.njit(cache=True, fastmath=True)
def sums(
    work: Workspace, gain: float, u0: int, u1: int, v0: int, v1: int, out: FloatArray
) -> None:
    """Add to `out` (8,), over a region of the mask, for `r = W - g T` and `J = (grad W + g grad T) / 2`:

    J J^T (xx, xy, yy), J r (x, y), T W, T T, W W.
    """
    W, T, m = work.shifted, work.template, work.active
    g = np.float32(gain)
    quarter = np.float32(0.25)
    hxx = hxy = hyy = bx = by = tw = tt = ww = np.float32(0.0)
    for v in range(v0, v1):
        for u in range(u0, u1):
            weight = m[v, u]
            w, t = W[v, u], T[v, u]
            jx = quarter * (W[v, u + 1] - W[v, u - 1] + g * (T[v, u + 1] - T[v, u - 1]))
            jy = quarter * (W[v + 1, u] - W[v - 1, u] + g * (T[v + 1, u] - T[v - 1, u]))
            r = w - g * t
            wx, wy = weight * jx, weight * jy
            hxx += wx * jx
            hxy += wx * jy
            hyy += wy * jy
            bx += wx * r
            by += wy * r
            tw += weight * t * w
            tt += weight * t * t
            ww += weight * w * w
    out[0] += hxx
    out[1] += hxy
    out[2] += hyy
    out[3] += bx
    out[4] += by
    out[5] += tw
    out[6] += tt
    out[7] += ww


@nb.njit(cache=True)
def match(work: Workspace, max_jump: float, iterations: int, out: FloatArray) -> bool:
    """Register the blurred patch against the template.

    `out` (MATCH,): shift du, dv and normalised correlation; the eight `sums` at the solution; by how much the right
    half's own shift differs from the left half's (u, v), and the lower's from the upper's. False when it leaves
    the patch or has no corner to hold on to.
    """
    limit = min(max_jump, PATCH_HALF - TEMPLATE_HALF - 0.01)
    first, last, middle = 1, TEMPLATE_SIDE - 1, TEMPLATE_HALF
    du = dv = 0.0
    gain = 1.0
    acc = np.zeros(SUMS)
    shift_patch(work, du, dv)
    sums(work, gain, first, last, first, last, acc)
    for _ in range(iterations):
        if acc[6] <= 0.0 or acc[5] <= 0.0:
            return False
        gain = acc[5] / acc[6]
        acc[:] = 0.0
        sums(work, gain, first, last, first, last, acc)
        det = acc[0] * acc[2] - acc[1] * acc[1]
        if det <= 1e-4 * (acc[0] + acc[2]) ** 2:
            return False
        du -= (acc[2] * acc[3] - acc[1] * acc[4]) / det
        dv -= (acc[0] * acc[4] - acc[1] * acc[3]) / det
        if not (abs(du) < limit and abs(dv) < limit):
            return False
        shift_patch(work, du, dv)
    quadrants = np.zeros((4, SUMS))
    sums(work, gain, first, middle, first, middle, quadrants[0])
    sums(work, gain, middle, last, first, middle, quadrants[1])
    sums(work, gain, first, middle, middle, last, quadrants[2])
    sums(work, gain, middle, last, middle, last, quadrants[3])
    for i in range(SUMS):
        out[3 + i] = quadrants[0, i] + quadrants[1, i] + quadrants[2, i] + quadrants[3, i]
    if out[9] <= 0.0 or out[10] <= 0.0:
        return False
    out[0], out[1] = du, dv
    out[2] = out[8] / np.sqrt(out[9] * out[10])
    left_u, left_v = _shift_of(quadrants, 0, 2)
    right_u, right_v = _shift_of(quadrants, 1, 3)
    upper_u, upper_v = _shift_of(quadrants, 0, 1)
    lower_u, lower_v = _shift_of(quadrants, 2, 3)
    out[11], out[12] = right_u - left_u, right_v - left_v
    out[13], out[14] = lower_u - upper_u, lower_v - upper_v
    return True


@nb.njit(cache=True)
def _shift_of(quadrants: FloatArray, a: int, b: int) -> tuple[float, float]:
    """Shift that two quadrants together still ask for; damped, since half a patch may be one edge."""
    xx = quadrants[a, 0] + quadrants[b, 0]
    xy = quadrants[a, 1] + quadrants[b, 1]
    yy = quadrants[a, 2] + quadrants[b, 2]
    x = quadrants[a, 3] + quadrants[b, 3]
    y = quadrants[a, 4] + quadrants[b, 4]
    damping = 0.02 * (xx + yy) + 1e-9
    xx += damping
    yy += damping
    det = xx * yy - xy * xy
    return -(yy * x - xy * y) / det, -(xx * y - xy * x) / det


@nb.njit(cache=True, fastmath=True)
def learn(features: Features, slot: int, sx: float, sy: float, keep: float, work: Workspace) -> None:
    """Add the registered patch, seen under displacement (sx, sy), to the evidence; older evidence fades."""
    B, W = features.evidence[slot], work.shifted
    a, b, k = np.float32(sx), np.float32(sy), np.float32(keep)
    for v in range(TEMPLATE_SIDE):
        for u in range(TEMPLATE_SIDE):
            B[0, v, u] = k * B[0, v, u] + a * W[v, u]
            B[1, v, u] = k * B[1, v, u] + b * W[v, u]
    A = features.information[slot]
    A[0] = keep * A[0] + sx * sx
    A[1] = keep * A[1] + sx * sy
    A[2] = keep * A[2] + sy * sy
