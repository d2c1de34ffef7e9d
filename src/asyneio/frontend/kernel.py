"""The event loop: Algorithm 1 of the paper over one packet of events."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.features import FREE, GROWING, TRACKING, Features
from asyneio.frontend.registration import BUCKET, Registration, move, register, unregister
from asyneio.frontend.gradient_template import TemplateSettings, Workspace, push, try_birth, update
from asyneio.frontend.surface import Surface, record_event
from asyneio.types import FloatArray, IntArray


class LoopSettings(NamedTuple):
    silence_ns: int
    spacing_px: float
    border_px: int
    t_min_ns: int
    t_max_ns: int
    birth_max_ns: int
    max_features: int


class Counters(NamedTuple):
    """(K,) int64: 0 next id, 1 alive, 2 births, 3 tracks begun, 4 ended by refusal, 5 by silence, 6 border,
    7 hot events, 8 corner tests, 9 updates, 10 births abandoned."""

    value: IntArray


@nb.njit(cache=True)
def free_slot(features: Features) -> int:
    for slot in range(features.state.size):
        if features.state[slot] == FREE:
            return slot
    return -1


@nb.njit(cache=True)
def release(features: Features, registration: Registration, slot: int, counters: IntArray) -> None:
    unregister(registration, slot)
    features.state[slot] = FREE
    counters[1] -= 1


@nb.njit(cache=True)
def remove_silent(
    features: Features, registration: Registration, t_ns: int, settings: LoopSettings, counters: IntArray
) -> None:
    """Release features that have not moved for `t_max`, or not begun to track in time."""
    for slot in range(features.state.size):
        state = features.state[slot]
        if state == TRACKING and t_ns - features.t_ns[slot] > settings.t_max_ns:
            release(features, registration, slot, counters)
            counters[5] += 1
        elif state == GROWING and t_ns - features.born_ns[slot] > settings.birth_max_ns:
            release(features, registration, slot, counters)
            counters[10] += 1


@nb.njit(cache=True)
def neighbours_velocity(features: Features, x: float, y: float, out: FloatArray) -> int:
    """Mean velocity of the three nearest tracked features, into `out`; how many within 60 px."""
    best = np.full(3, 3600.0)
    who = np.full(3, -1, dtype=np.int64)
    for slot in range(features.state.size):
        if features.state[slot] != TRACKING:
            continue
        dx, dy = features.centre[slot, 0] - x, features.centre[slot, 1] - y
        d2 = dx * dx + dy * dy
        for i in range(3):
            if d2 < best[i]:
                for j in range(2, i, -1):
                    best[j] = best[j - 1]
                    who[j] = who[j - 1]
                best[i], who[i] = d2, slot
                break
    n = 0
    out[0] = out[1] = 0.0
    for i in range(3):
        if who[i] >= 0:
            out[0] += features.velocity[who[i], 0]
            out[1] += features.velocity[who[i], 1]
            n += 1
    if n:
        out[0] /= n
        out[1] /= n
    return n


@nb.njit(cache=True, nogil=True)
def process_events(
    events: np.ndarray, start: int, surface: Surface, features: Features, registration: Registration,
    settings: LoopSettings, template: TemplateSettings, work: Workspace, balance: FloatArray,
    roll0: float, roll_rate: float, roll_t0: int, counters: IntArray, observations: np.ndarray,
) -> tuple[int, int]:
    """Process events from `start`; returns (next event, observations written). Stops when the output is full."""
    height, width = surface.hot.shape
    size = (width, height)
    written = 0
    guess = np.zeros(2)
    out = np.zeros(12)
    scratch = np.zeros(SCRATCH, dtype=np.int64)
    reach = template.feed_radius_px + 1.5
    feed2 = template.feed_radius_px**2
    spacing2 = settings.spacing_px**2
    t_check = np.int64(0)
    for i in range(start, events.size):
        t_ns = events[i]["t_ns"]
        x = np.int64(events[i]["x"])
        y = np.int64(events[i]["y"])
        p = np.int64(events[i]["p"])
        if i % 4096 == 0 or t_ns - t_check > 10_000_000:
            t_check = t_ns
            remove_silent(features, registration, t_ns, settings, counters)
            if written + 4 * 4096 > observations.size:
                return i, written
        first_of_edge = record_event(surface, t_ns, x, y, p, settings.silence_ns)
        if surface.hot[y, x]:
            counters[7] += 1
            continue
        balance[p] += 1.0
        w = balance[2] if p == 1 else -balance[3]
        row, column = y // BUCKET, x // BUCKET
        near = False
        k = registration.count[row, column]
        while k > 0:
            k -= 1
            if k >= registration.count[row, column]:
                continue
            slot = registration.slots[row, column, k]
            dt = (t_ns - features.t_ns[slot]) * 1e-9
            tracking = features.state[slot] == TRACKING
            dx = x - features.centre[slot, 0]
            dy = y - features.centre[slot, 1]
            if tracking:
                dx -= features.velocity[slot, 0] * dt
                dy -= features.velocity[slot, 1] * dt
            r2 = dx * dx + dy * dy
            if r2 < spacing2:
                near = True
            if r2 > feed2 or not push(features, slot, t_ns, x, y, w):
                continue
            if tracking:
                need = features.density[slot] * template.step_px / features.stride[slot]
                if features.fresh[slot] < max(need, template.min_step_events):
                    continue
                roll = roll0 + roll_rate * (t_ns - roll_t0) * 1e-9
                status = update(features, slot, roll, roll_rate, template, size, work, out)
                counters[9] += 1
                cx, cy = features.centre[slot, 0], features.centre[slot, 1]
                b = settings.border_px
                outside = cx < b or cy < b or cx > width - 1 - b or cy > height - 1 - b
                if status < 0 or outside:
                    counters[6 if outside else 4] += 1
                    release(features, registration, slot, counters)
                    continue
                if status == 0:
                    continue
                move(registration, slot, features.centre[slot, 0], features.centre[slot, 1], reach)
                angle = roll - features.birth_roll[slot]
                c, s = np.cos(angle), np.sin(angle)
                ox, oy = features.offset[slot, 0], features.offset[slot, 1]
                o = observations[written]
                o["t_ns"] = features.t_ns[slot]
                o["id"] = features.id[slot]
                o["u"] = cx + c * ox - s * oy
                o["v"] = cy + s * ox + c * oy
                o["ncc"] = out[2]
                o["novelty"] = out[3]
                o["h"][0], o["h"][1], o["h"][2] = out[4], out[5], out[6]
                o["tw"], o["tt"], o["ww"] = out[9], out[10], out[11]
                written += 1
            else:
                if features.fresh[slot] < template.birth_events:
                    continue
                features.fresh[slot] = 0
                roll = roll0 + roll_rate * (t_ns - roll_t0) * 1e-9
                n = neighbours_velocity(features, features.centre[slot, 0], features.centre[slot, 1], guess)
                if try_birth(
                    features, slot, roll, roll_rate, guess, 2 if n == 3 else 5, template, size, work
                ):
                    features.state[slot] = TRACKING
                    features.id[slot] = counters[0]
                    counters[0] += 1
                    counters[3] += 1
                    move(registration, slot, features.centre[slot, 0], features.centre[slot, 1], reach)
        if near or not first_of_edge or counters[1] >= settings.max_features:
            continue
        b = settings.border_px + 3
        if x < b or y < b or x >= width - b or y >= height - b:
            continue
        counters[8] += 1
        if not is_corner(surface.latest_ns[p], x, y, scratch):
            continue
        slot = free_slot(features)
        if slot < 0:
            continue
        features.state[slot] = GROWING
        features.centre[slot, 0], features.centre[slot, 1] = x, y
        features.velocity[slot] = 0.0
        features.t_ns[slot] = t_ns
        features.born_ns[slot] = t_ns
        features.written[slot] = 0
        features.fresh[slot] = 0
        features.stride[slot] = 1
        features.skipped[slot] = 0
        counters[1] += 1
        counters[2] += 1
        register(registration, slot, x, y, reach)
    return events.size, written
