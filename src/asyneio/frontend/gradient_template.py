"""The default tracker: signed event patches registered against a learned gradient of the brightness.

Events that a patch collects while it moves by `s` add up, to first order, to `W = s . G`, where `G` is the gradient
of the log brightness there (Gallego et al., EKLT 2018). `G` is estimated from all past windows by recursive
least squares (two images and one 2x2 matrix a feature) and gives the template for whatever direction the
motion now has, so that a turn does not age it. Windows and steps are tied to displacement: a feature learns how
many events one pixel of its motion brings.
"""

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


class TemplateSettings(NamedTuple):
    """Displacements in pixels, times in nanoseconds."""

    step_px: float
    window_px: float
    kept_per_px: float
    min_step_events: int
    min_window_events: int
    max_window_ns: int
    memory_px: float
    ridge_px2: float
    min_ncc: float
    max_jump_px: float
    max_refusals: int
    velocity_gain: float
    mask_sigma_px: float
    birth_px: float
    birth_events: int
    feed_radius_px: float


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


@nb.njit(cache=True, fastmath=True)
def sums(work: Workspace, gain: float, out: FloatArray) -> None:
    """Over the mask, for the residual `r = W - g T` and `J = (grad W + g grad T) / 2`, into `out`:

    J J^T (xx, xy, yy), J r (x, y), T W, T T, W W.
    """
    W, T, m = work.shifted, work.template, work.active
    g = np.float32(gain)
    quarter = np.float32(0.25)
    hxx = hxy = hyy = bx = by = tw = tt = ww = np.float32(0.0)
    for v in range(1, TEMPLATE_SIDE - 1):
        for u in range(1, TEMPLATE_SIDE - 1):
            weight = m[v, u]
            jx = quarter * (W[v, u + 1] - W[v, u - 1] + g * (T[v, u + 1] - T[v, u - 1]))
            jy = quarter * (W[v + 1, u] - W[v - 1, u] + g * (T[v + 1, u] - T[v - 1, u]))
            r = W[v, u] - g * T[v, u]
            wx, wy = weight * jx, weight * jy
            hxx += wx * jx
            hxy += wx * jy
            hyy += wy * jy
            bx += wx * r
            by += wy * r
            tw += weight * T[v, u] * W[v, u]
            tt += weight * T[v, u] * T[v, u]
            ww += weight * W[v, u] * W[v, u]
    out[0], out[1], out[2], out[3], out[4] = hxx, hxy, hyy, bx, by
    out[5], out[6], out[7] = tw, tt, ww


@nb.njit(cache=True)
def match(work: Workspace, max_jump: float, iterations: int, out: FloatArray) -> bool:
    """Efficient second-order registration with a free gain.

    `out` (12,): du, dv (patch frame), NCC, then the eight sums at the solution. False when it leaves the patch
    or has no corner to hold on to.
    """
    limit = min(max_jump, PATCH_HALF - TEMPLATE_HALF - 0.01)
    du = dv = 0.0
    acc = out[4:12]
    shift_patch(work, du, dv)
    sums(work, 1.0, acc)
    for _ in range(iterations):
        if acc[6] <= 0.0 or acc[5] <= 0.0:
            return False
        sums(work, acc[5] / acc[6], acc)
        det = acc[0] * acc[2] - acc[1] * acc[1]
        if det <= 1e-4 * (acc[0] + acc[2]) ** 2:
            return False
        du -= (acc[2] * acc[3] - acc[1] * acc[4]) / det
        dv -= (acc[0] * acc[4] - acc[1] * acc[3]) / det
        if not (abs(du) < limit and abs(dv) < limit):
            return False
        shift_patch(work, du, dv)
        sums(work, acc[5] / acc[6], acc)
    if acc[6] <= 0.0 or acc[7] <= 0.0:
        return False
    out[0], out[1] = du, dv
    out[2] = acc[5] / np.sqrt(acc[6] * acc[7])
    return True


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
def shrink_valid(features: Features, slot: int, x: float, y: float, width: int, height: int) -> None:
    """Restrict the valid region to what lies inside the image with the patch's centre at (x, y)."""
    valid = features.valid[slot]
    valid[0] = max(valid[0], int(np.ceil(TEMPLATE_HALF - x)) + 1)
    valid[1] = min(valid[1], int(np.floor(TEMPLATE_HALF + width - 1 - x)) - 1)
    valid[2] = max(valid[2], int(np.ceil(TEMPLATE_HALF - y)) + 1)
    valid[3] = min(valid[3], int(np.floor(TEMPLATE_HALF + height - 1 - y)) - 1)


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
def try_birth(
    features: Features, slot: int, roll: float, roll_rate: float, guess: FloatArray, guess_reach: int,
    settings: TemplateSettings, size: tuple[int, int], work: Workspace,
) -> bool:
    """Cut the template once the collected events span enough motion. False while they do not."""
    count, first, mean, last = newest_events(features, slot, RING, settings.max_window_ns)
    if count < settings.birth_events or last - first < 1000:
        return False
    span_s = (last - first) * 1e-9
    at = np.zeros(7)
    at[0], at[1], at[2] = mean, features.centre[slot, 0], features.centre[slot, 1]
    at[3], at[4], at[5], at[6] = guess[0], guess[1], 0.0, roll_rate
    ratio = find_flow(features, slot, count, at, span_s, guess_reach, work)
    moved = np.hypot(at[3], at[4]) * span_s
    if moved < settings.birth_px or ratio < 1.05:
        if features.written[slot] >= RING:
            thin_out(features, slot)
        # Look again when there is half as much more to see.
        features.fresh[slot] = -(min(features.written[slot], RING) // 2) + settings.birth_events
        return False
    features.velocity[slot, 0], features.velocity[slot, 1] = at[3], at[4]
    stride = features.stride[slot]
    features.density[slot] = count * stride / moved
    # The corner was where it was seen at the founding event.
    dt = (mean - features.t_ns[slot]) * 1e-9
    features.centre[slot, 0] += at[3] * dt
    features.centre[slot, 1] += at[4] * dt
    features.t_ns[slot] = mean
    window = int(min(count, max(count * settings.window_px / moved, settings.min_window_events)))
    used, first, mean, last = newest_events(features, slot, window, settings.max_window_ns)
    dt = (mean - features.t_ns[slot]) * 1e-9
    at[0], at[1], at[2] = mean, features.centre[slot, 0] + at[3] * dt, features.centre[slot, 1] + at[4] * dt
    draw_patch(features, slot, used, at, work)
    blur(work)
    shift_patch(work, 0.0, 0.0)
    features.centre[slot, 0], features.centre[slot, 1] = at[1], at[2]
    features.t_ns[slot] = mean
    features.birth_roll[slot] = roll + roll_rate * (mean - last) * 1e-9
    valid = features.valid[slot]
    valid[0], valid[1], valid[2], valid[3] = 0, TEMPLATE_SIDE - 1, 0, TEMPLATE_SIDE - 1
    shrink_valid(features, slot, at[1], at[2], size[0], size[1])
    features.evidence[slot] = 0.0
    features.information[slot] = 0.0
    span_s = (last - first) * 1e-9
    learn(features, slot, at[3] * span_s, at[4] * span_s, 1.0, work)
    activate_mask(features, slot, work)
    weight = wx = wy = 0.0
    for v in range(TEMPLATE_SIDE):
        for u in range(TEMPLATE_SIDE):
            w = work.active[v, u] * work.shifted[v, u] ** 2
            weight += w
            wx += w * (u - TEMPLATE_HALF)
            wy += w * (v - TEMPLATE_HALF)
    features.offset[slot, 0] = wx / max(weight, 1e-9)
    features.offset[slot, 1] = wy / max(weight, 1e-9)
    features.refusals[slot] = 0
    features.fresh[slot] = 0
    return True


@nb.njit(cache=True)
def update(
    features: Features, slot: int, roll: float, roll_rate: float, settings: TemplateSettings,
    size: tuple[int, int], work: Workspace, out: FloatArray,
) -> int:
    """Register the newest window. 1: moved; 0: refused; -1: ended.

    `roll` is the camera's at the newest event.
    """
    stride = features.stride[slot]
    density = features.density[slot]
    wanted = int(max(density * settings.window_px / stride, settings.min_window_events))
    count, first, mean, last = newest_events(features, slot, wanted, settings.max_window_ns)
    span_s = max((last - first) * 1e-9, 1e-6)
    dt = (mean - features.t_ns[slot]) * 1e-9
    vx, vy = features.velocity[slot, 0], features.velocity[slot, 1]
    at = np.empty(7)
    at[0] = mean
    at[1] = features.centre[slot, 0] + vx * dt
    at[2] = features.centre[slot, 1] + vy * dt
    at[3], at[4] = vx, vy
    angle = roll + roll_rate * (mean - last) * 1e-9 - features.birth_roll[slot]
    at[5], at[6] = angle, roll_rate
    shrink_valid(features, slot, at[1], at[2], size[0], size[1])
    draw_patch(features, slot, count, at, work)
    blur(work)
    cos, sin = np.cos(angle), np.sin(angle)
    sx = (cos * vx + sin * vy) * span_s
    sy = (cos * vy - sin * vx) * span_s
    novelty = synthesise(features, slot, sx, sy, settings.ridge_px2, work)
    share = activate_mask(features, slot, work)
    features.fresh[slot] = 0
    if share < 0.5:
        return -1
    found = match(work, settings.max_jump_px, 3, out)
    if not found or out[2] < settings.min_ncc:
        features.refusals[slot] += 1
        return -1 if features.refusals[slot] >= settings.max_refusals else 0
    features.refusals[slot] = 0
    ix = cos * out[0] - sin * out[1]
    iy = sin * out[0] + cos * out[1]
    x, y = at[1] + ix, at[2] + iy
    dt = max(dt, 1e-6)
    features.velocity[slot, 0] = vx + settings.velocity_gain * ix / dt
    features.velocity[slot, 1] = vy + settings.velocity_gain * iy / dt
    features.centre[slot, 0], features.centre[slot, 1] = x, y
    features.t_ns[slot] = mean
    speed = np.hypot(features.velocity[slot, 0], features.velocity[slot, 1])
    moved = speed * span_s
    if moved > 0.05:
        d = count * stride / moved
        d = min(max(d, 0.5 * density), 2.0 * density)
        features.density[slot] += 0.3 * (d - density)
    features.stride[slot] = max(1, int(features.density[slot] / settings.kept_per_px + 0.5))
    nx, ny = features.velocity[slot, 0], features.velocity[slot, 1]
    sx = (cos * nx + sin * ny) * span_s
    sy = (cos * ny - sin * nx) * span_s
    step = min(speed * dt, 4.0)
    learn(features, slot, sx, sy, np.exp(-step / settings.memory_px), work)
    out[3] = novelty
    return 1
