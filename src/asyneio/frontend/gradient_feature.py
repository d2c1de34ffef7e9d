"""One feature of the default tracker: its birth, its update, and when it is no longer trusted.

Windows and steps are tied to displacement: a feature learns how many events one pixel of its motion brings, so the
same settings serve slow and fast motion, rich and poor texture, bright and dim light.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.features import (
    RING,
    TEMPLATE_HALF,
    TEMPLATE_SIDE,
    Features,
    newest_events,
    shrink_valid,
    thin_out,
)
from asyneio.frontend.flow import find_flow
from asyneio.frontend.gradient_template import learn, match, synthesise
from asyneio.frontend.patch import Workspace, activate_mask, blur, draw_patch, shift_patch
from asyneio.types import FloatArray

ENDED, REFUSED, MOVED = -1, 0, 1

#: Least sharpening by motion compensation that shows a patch to move as one.
_SHARPENING = 1.05
_ITERATIONS = 3


class GradientSettings(NamedTuple):
    """Of the default tracker; displacements in pixels, times in nanoseconds."""

    feed_radius_px: float = 12.0  # events this near belong to a feature
    mask_sigma_px: float = 6.0  # weight of a patch, from its centre outwards
    birth_px: float = 1.5  # motion that a patch must hold before it becomes a template
    birth_events: int = 150
    step_px: float = 1.5  # motion between two registrations
    window_px: float = 2.0  # motion drawn into a patch
    min_step_events: int = 30
    min_window_events: int = 100
    max_window_ns: int = 250_000_000
    kept_per_px: float = 200.0  # events kept of each pixel of motion, where there are more
    memory_px: float = 60.0  # motion over which the template forgets
    ridge_px2: float = 0.1  # doubt about directions in which the patch has not moved yet
    velocity_gain: float = 0.5
    max_jump_px: float = 2.9
    min_ncc: float = 0.65
    max_refusals: int = 3
    trust_gain: float = 0.2  # running means of what follows
    max_disagreement_px: float = 0.35  # between two halves of the patch ...
    noise_share: float = 0.5  # ... plus what noise explains, in units of `sigma`
    max_sigma: float = 2.5
    covariance_scale: float = 0.1  # of residual times inverse Hessian: blurred noise is correlated


@nb.njit(cache=True)
def try_birth(
    features: Features,
    slot: int,
    roll: float,
    roll_rate: float,
    guess: FloatArray,
    reach_px: int,
    settings: GradientSettings,
    work: Workspace,
) -> bool:
    """Cut the template once the collected events span enough motion. False while they do not.

    `guess` (2,) px/s is where the search for the velocity starts, `reach_px` how far it goes.
    """
    count, first, mean, last = newest_events(features, slot, RING, settings.max_window_ns)
    span_s = (last - first) * 1e-9
    centre, velocity = features.centre[slot], features.velocity[slot]
    at = np.array([mean, centre[0], centre[1], guess[0], guess[1], 0.0, roll_rate])
    enough = count >= settings.birth_events and span_s > 1e-4
    sharpening = find_flow(features, slot, count, at, span_s, reach_px, work) if enough else 0.0
    moved = np.hypot(at[3], at[4]) * span_s
    if moved < settings.birth_px or sharpening < _SHARPENING:
        if features.written[slot] >= RING:
            thin_out(features, slot)
        # Look again when there is half as much more to see.
        features.fresh[slot] = settings.birth_events - min(features.written[slot], RING) // 2
        return False
    velocity[0], velocity[1] = at[3], at[4]
    features.density[slot] = count * features.stride[slot] / moved
    wanted = int(max(count * settings.window_px / moved, settings.min_window_events))
    count, first, mean, last = newest_events(features, slot, wanted, settings.max_window_ns)
    # The corner was where it was seen at the founding event.
    dt = (mean - features.t_ns[slot]) * 1e-9
    centre[0] += velocity[0] * dt
    centre[1] += velocity[1] * dt
    features.t_ns[slot] = mean
    at[0], at[1], at[2] = mean, centre[0], centre[1]
    draw_patch(features, slot, count, at, work)
    blur(work)
    shift_patch(work, 0.0, 0.0)
    features.birth_roll[slot] = roll + roll_rate * (mean - last) * 1e-9
    features.evidence[slot] = 0.0
    features.information[slot] = 0.0
    span_s = (last - first) * 1e-9
    learn(features, slot, velocity[0] * span_s, velocity[1] * span_s, 1.0, work)
    activate_mask(features, slot, work)
    _place_offset(features, slot, work)
    features.refusals[slot] = 0
    features.fresh[slot] = 0
    features.disagreement[slot] = 0.0
    features.sigma[slot] = 0.0
    return True


@nb.njit(cache=True)
def _place_offset(features: Features, slot: int, work: Workspace) -> None:
    """Report the centroid of the patch's own edges: at a depth edge, what stands out most is what is followed."""
    weight = u_sum = v_sum = 0.0
    for v in range(TEMPLATE_SIDE):
        for u in range(TEMPLATE_SIDE):
            w = work.active[v, u] * work.shifted[v, u] ** 2
            weight += w
            u_sum += w * (u - TEMPLATE_HALF)
            v_sum += w * (v - TEMPLATE_HALF)
    features.offset[slot, 0] = u_sum / max(weight, 1e-9)
    features.offset[slot, 1] = v_sum / max(weight, 1e-9)


@nb.njit(cache=True)
def update(
    features: Features,
    slot: int,
    roll: float,
    roll_rate: float,
    settings: GradientSettings,
    width: int,
    height: int,
    work: Workspace,
    out: FloatArray,
) -> int:
    """Register the newest window of events: MOVED, REFUSED or ENDED.

    `roll` [rad] is the camera's at the newest event. `out` (MATCH,) is `match`'s.
    """
    stride, density = features.stride[slot], features.density[slot]
    wanted = int(max(density * settings.window_px / stride, settings.min_window_events))
    count, first, mean, last = newest_events(features, slot, wanted, settings.max_window_ns)
    features.fresh[slot] = 0
    span_s = max((last - first) * 1e-9, 1e-6)
    dt = max((mean - features.t_ns[slot]) * 1e-9, 1e-6)
    centre, velocity = features.centre[slot], features.velocity[slot]
    x, y = centre[0] + velocity[0] * dt, centre[1] + velocity[1] * dt
    angle = roll + roll_rate * (mean - last) * 1e-9 - features.birth_roll[slot]
    cos, sin = np.cos(angle), np.sin(angle)

    shrink_valid(features, slot, x, y, width, height)
    if activate_mask(features, slot, work) < 0.5:
        return ENDED
    draw_patch(
        features, slot, count, np.array([mean, x, y, velocity[0], velocity[1], angle, roll_rate]), work
    )
    blur(work)
    sx = (cos * velocity[0] + sin * velocity[1]) * span_s
    sy = (cos * velocity[1] - sin * velocity[0]) * span_s
    synthesise(features, slot, sx, sy, settings.ridge_px2, work)
    if not match(work, settings.max_jump_px, _ITERATIONS, out) or out[2] < settings.min_ncc:
        features.refusals[slot] += 1
        return ENDED if features.refusals[slot] >= settings.max_refusals else REFUSED
    if not _is_trusted(features, slot, settings, out):
        return ENDED
    features.refusals[slot] = 0

    # Shifts are in the patch frame.
    shift_x, shift_y = cos * out[0] - sin * out[1], sin * out[0] + cos * out[1]
    centre[0], centre[1] = x + shift_x, y + shift_y
    features.t_ns[slot] = mean
    velocity[0] += settings.velocity_gain * shift_x / dt
    velocity[1] += settings.velocity_gain * shift_y / dt
    speed = np.hypot(velocity[0], velocity[1])
    if speed * span_s > 0.05:
        seen = min(max(count * stride / (speed * span_s), 0.5 * density), 2.0 * density)
        features.density[slot] += 0.3 * (seen - density)
    features.stride[slot] = max(1, int(features.density[slot] / settings.kept_per_px + 0.5))
    sx = (cos * velocity[0] + sin * velocity[1]) * span_s
    sy = (cos * velocity[1] - sin * velocity[0]) * span_s
    keep = np.exp(-min(speed * dt, 4.0) / settings.memory_px)
    learn(features, slot, sx, sy, keep, work)
    return MOVED


@nb.njit(cache=True)
def _is_trusted(features: Features, slot: int, settings: GradientSettings, out: FloatArray) -> bool:
    """Whether the patch still moves as one and is still matched sharply.

    Where a patch spans two depths, or its template has crept away, its halves pull apart long before the
    correlation falls. Both measures are running means; noise raises the first, so its bound grows with the second.
    """
    residual = out[10] * max(1.0 - out[2] * out[2], 0.0)
    trace, det = out[3] + out[5], out[3] * out[5] - out[4] * out[4]
    smallest = 0.5 * trace - np.sqrt(max(0.25 * trace * trace - det, 0.0))
    sigma = np.sqrt(residual / max(smallest, 1e-9))
    features.sigma[slot] += settings.trust_gain * (sigma - features.sigma[slot])
    d = features.disagreement[slot]
    for i in range(4):
        d[i] += settings.trust_gain * (out[11 + i] - d[i])
    apart = np.sqrt(max(d[0] * d[0] + d[1] * d[1], d[2] * d[2] + d[3] * d[3]))
    allowed = settings.max_disagreement_px + settings.noise_share * features.sigma[slot]
    return apart <= allowed and features.sigma[slot] <= settings.max_sigma
