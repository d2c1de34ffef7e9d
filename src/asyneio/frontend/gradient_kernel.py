"""The event loop of the default tracker: Algorithm 1 of the paper over one packet of events."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.features import FREE, GROWING, TRACKING, Features, begin, push
from asyneio.frontend.gradient_feature import MOVED, GradientSettings, try_birth, update
from asyneio.frontend.gradient_template import MATCH
from asyneio.frontend.patch import Workspace
from asyneio.frontend.registration import BUCKET, Registration, move, register, unregister
from asyneio.frontend.surface import Surface, record_event
from asyneio.types import FloatArray, IntArray, RecordArray

#: Indices of the counters: identifiers given out, features alive (growing or tracked), ended by distrust, by
#: silence, at the border, beside an older feature, given up before they were tracked; corners found, events masked.
NEXT_ID, ALIVE, UNTRUSTED, SILENT, BORDER, CROWDED, ABANDONED, CORNERS, HOT = range(9)
COUNTERS = 9

#: Events between two looks for silent features; the most updates that so many events can bring.
CHECK_EVENTS = 2048
MAX_UPDATES = 4 * CHECK_EVENTS
#: How many pixels a feature may run ahead of its registration before it is moved there.
_SLACK_PX = 1.5


class LoopSettings(NamedTuple):
    """Of Algorithm 1; times in nanoseconds."""

    silence_ns: int
    spacing_px: float
    crowding_px: float
    border_px: int
    t_min_ns: int
    t_max_ns: int
    birth_max_ns: int
    max_features: int


@nb.njit(cache=True, nogil=True)
def process_events(
    events: RecordArray,
    start: int,
    surface: Surface,
    features: Features,
    registration: Registration,
    loop: LoopSettings,
    settings: GradientSettings,
    work: Workspace,
    weight: FloatArray,
    roll: FloatArray,
    counters: IntArray,
    observations: RecordArray,
) -> tuple[int, int]:
    """Process events from `start` on; the next event to process and the number of observations written.

    `weight` (4,): events seen and weight, of off and of on events. `roll` (3,): time [ns], roll of the camera then
    [rad], its rate [rad/s]. Stops early when `observations` may not hold what follows.
    """
    height, width = surface.hot.shape
    written = 0
    guess = np.zeros(2)
    out = np.zeros(MATCH)
    scratch = np.zeros(SCRATCH, dtype=np.int64)
    reach = settings.feed_radius_px + _SLACK_PX
    feed2 = settings.feed_radius_px**2
    spacing2 = loop.spacing_px**2
    nearest_edge = loop.border_px + 3
    for i in range(start, events.size):
        t_ns = events[i]["t_ns"]
        x, y, p = np.int64(events[i]["x"]), np.int64(events[i]["y"]), np.int64(events[i]["p"])
        if i % CHECK_EVENTS == 0:
            if written + MAX_UPDATES > observations.size:
                return i, written
            _remove_idle(features, registration, t_ns, loop, counters)
        first_of_edge = record_event(surface, t_ns, x, y, p, loop.silence_ns)
        if surface.hot[y, x]:
            counters[HOT] += 1
            continue
        weight[p] += 1.0
        w = weight[3] if p == 1 else -weight[2]
        row, column = y // BUCKET, x // BUCKET
        near = False
        k = registration.count[row, column]
        while k > 0:
            k -= 1
            # An update may take features out of this very bucket.
            if k >= registration.count[row, column]:
                continue
            slot = registration.slots[row, column, k]
            tracking = features.state[slot] == TRACKING
            ahead_s = (t_ns - features.t_ns[slot]) * 1e-9 if tracking else 0.0
            dx = x - features.centre[slot, 0] - features.velocity[slot, 0] * ahead_s
            dy = y - features.centre[slot, 1] - features.velocity[slot, 1] * ahead_s
            distance2 = dx * dx + dy * dy
            near = near or distance2 < spacing2
            if distance2 > feed2 or not push(features, slot, t_ns, x, y, w):
                continue
            if not tracking:
                if features.fresh[slot] < settings.birth_events:
                    continue
                reach_px = 2 if _neighbours_velocity(features, slot, guess) else 5
                now = roll[1] + roll[2] * (t_ns - roll[0]) * 1e-9
                if try_birth(features, slot, now, roll[2], guess, reach_px, settings, work):
                    features.state[slot] = TRACKING
                    features.id[slot] = counters[NEXT_ID]
                    counters[NEXT_ID] += 1
                    move(registration, slot, features.centre[slot, 0], features.centre[slot, 1], reach)
                continue
            need = features.density[slot] * settings.step_px / features.stride[slot]
            if features.fresh[slot] < max(need, settings.min_step_events):
                continue
            now = roll[1] + roll[2] * (t_ns - roll[0]) * 1e-9
            status = update(features, slot, now, roll[2], settings, width, height, work, out)
            cx, cy = features.centre[slot, 0], features.centre[slot, 1]
            b = loop.border_px
            outside = cx < b or cy < b or cx > width - 1 - b or cy > height - 1 - b
            if status < 0 or outside:
                release(features, registration, slot, counters, BORDER if outside else UNTRUSTED)
            elif status == MOVED:
                move(registration, slot, cx, cy, reach)
                if features.t_ns[slot] - features.emitted_ns[slot] >= loop.t_min_ns:
                    _emit(features, slot, now, out, settings.covariance_scale, observations[written])
                    written += 1
        if near or not first_of_edge or counters[ALIVE] >= loop.max_features:
            continue
        if not (nearest_edge <= x < width - nearest_edge and nearest_edge <= y < height - nearest_edge):
            continue
        if is_corner(surface.latest_ns[p], x, y, scratch):
            slot = begin(features, t_ns, x, y)
            counters[CORNERS] += 1
            counters[ALIVE] += 1
            register(registration, slot, x, y, reach)
    return events.size, written


@nb.njit(cache=True)
def release(
    features: Features, registration: Registration, slot: int, counters: IntArray, why: int
) -> None:
    """End a feature and count why."""
    unregister(registration, slot)
    features.state[slot] = FREE
    counters[ALIVE] -= 1
    counters[why] += 1


@nb.njit(cache=True)
def _remove_idle(
    features: Features, registration: Registration, t_ns: int, loop: LoopSettings, counters: IntArray
) -> None:
    """Release features that are silent, that never began to move, or that ran into an older one."""
    n = features.state.size
    for slot in range(n):
        if features.state[slot] == GROWING:
            if t_ns - features.born_ns[slot] > loop.birth_max_ns:
                release(features, registration, slot, counters, ABANDONED)
        elif features.state[slot] == TRACKING:
            if t_ns - features.t_ns[slot] > loop.t_max_ns:
                release(features, registration, slot, counters, SILENT)
                continue
            for other in range(n):
                if features.state[other] != TRACKING or features.born_ns[other] >= features.born_ns[slot]:
                    continue
                dx = features.centre[slot, 0] - features.centre[other, 0]
                dy = features.centre[slot, 1] - features.centre[other, 1]
                if dx * dx + dy * dy < loop.crowding_px**2:
                    release(features, registration, slot, counters, CROWDED)
                    break


@nb.njit(cache=True)
def _neighbours_velocity(features: Features, slot: int, out: FloatArray) -> bool:
    """Mean velocity (2,) of the three nearest tracked features; False, and zero, unless three are within 60 px."""
    nearest = np.full(3, 3600.0)
    who = np.full(3, -1, dtype=np.int64)
    for other in range(features.state.size):
        if features.state[other] != TRACKING:
            continue
        dx = features.centre[slot, 0] - features.centre[other, 0]
        dy = features.centre[slot, 1] - features.centre[other, 1]
        d2 = dx * dx + dy * dy
        for i in range(3):
            if d2 < nearest[i]:
                for j in range(2, i, -1):
                    nearest[j], who[j] = nearest[j - 1], who[j - 1]
                nearest[i], who[i] = d2, other
                break
    out[0] = out[1] = 0.0
    if who[2] < 0:
        return False
    for i in range(3):
        out[0] += features.velocity[who[i], 0] / 3.0
        out[1] += features.velocity[who[i], 1] / 3.0
    return True


@nb.njit(cache=True)
def _emit(
    features: Features, slot: int, roll: float, out: FloatArray, scale: float, observation: np.void
) -> None:
    """Give out the feature's position with its covariance."""
    angle = roll - features.birth_roll[slot]
    c, s = np.cos(angle), np.sin(angle)
    ox, oy = features.offset[slot, 0], features.offset[slot, 1]
    observation["t_ns"] = features.t_ns[slot]
    observation["id"] = features.id[slot]
    observation["u"] = features.centre[slot, 0] + c * ox - s * oy
    observation["v"] = features.centre[slot, 1] + s * ox + c * oy
    features.emitted_ns[slot] = features.t_ns[slot]
    # Inverse Hessian of the match, turned from the patch frame into the image.
    det = max(out[3] * out[5] - out[4] * out[4], 1e-12)
    variance = scale * out[10] * max(1.0 - out[2] * out[2], 0.0) / det
    a, b, d = variance * out[5], -variance * out[4], variance * out[3]
    observation["covariance"][0] = c * c * a - 2.0 * c * s * b + s * s * d
    observation["covariance"][1] = c * s * (a - d) + (c * c - s * s) * b
    observation["covariance"][2] = s * s * a + 2.0 * c * s * b + c * c * d
