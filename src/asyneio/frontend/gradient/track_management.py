"""What the event loop of the default tracker keeps in order besides the features themselves."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.feature_grid import Tables, leave
from asyneio.frontend.gradient.features import FREE, GROWING, TRACKING
from asyneio.frontend.record import INNER, Record
from asyneio.frontend.surface import NEVER_NS
from asyneio.types import RecordArray

#: Sample of events over which the thresholds for on and off are balanced.
_BALANCE_EVENTS = 20_000

#: What the loop carries from packet to packet, and counts.
STATE_DTYPE = np.dtype(
    [
        ("checked_ns", "<i8"),  # when silent features were last looked for
        ("hot_ns", "<i8"),  # ... and hot pixels
        ("roll_ns", "<i8"),
        ("roll", "<f8"),  # rad, of the camera at `roll_ns`
        ("roll_rate", "<f8"),  # rad/s
        ("seen", "<f8", (2,)),  # off and on events
        ("worth", "<f8", (2,)),  # signed weight of an off and of an on event
        ("alive", "<i8"),  # features, growing or tracked,
        ("places", "<i8"),  # and up to how many of them new ones may begin
        ("tests", "<f8"),  # of corners that may be made now
        ("load", "<f8"),  # share of a core that may be used, by nominal costs; zero: any
        ("credit_ns", "<f8"),  # of computing, by nominal costs
        ("credited_ns", "<i8"),  # when that was last added to
        ("allowed", "<f8"),  # features, so that the load is borne
        ("hot_pixels", "<i8"),
        ("hot_events", "<i8"),
        ("fed", "<i8"),  # events given to features, each once for every feature
        ("untested", "<i8"),  # events that might have been corners
        ("shed_events", "<i8"),  # that concern no feature,
        ("shed_fed", "<i8"),  # that some feature might have used
        ("shed_features", "<i8"),
        ("corners", "<i8"),
        ("tracks", "<i8"),
        ("untrusted", "<i8"),  # ended by distrust,
        ("crowded", "<i8"),  # beside an older feature,
        ("silent", "<i8"),
        ("border", "<i8"),  # leaving the image
        ("abandoned", "<i8"),  # never tracked
    ]
)


class LoopSettings(NamedTuple):
    """Of Algorithm 1; times in nanoseconds."""

    silence_ns: int
    spacing_px: float
    neighbourhood_px: float
    crowding_px: float
    border_px: int
    t_min_ns: int
    t_max_ns: int
    birth_max_ns: int


def make_state(places: int, load: float) -> RecordArray:
    """State (1,) STATE_DTYPE before the first event, with so many places for features; `load`: share of a
    core that may be used, zero for any."""
    state = np.zeros(1, dtype=STATE_DTYPE)
    state["checked_ns"] = state["hot_ns"] = state["roll_ns"] = state["credited_ns"] = NEVER_NS
    state["worth"] = -1.0, 1.0
    state["places"] = places
    state["load"], state["allowed"] = load, np.inf
    return state


@nb.njit(**INNER)
def turn(state: Record, t_ns: int, rate: float) -> None:
    """Integrate the roll up to a time, and go on at another rate."""
    if state.roll_ns != NEVER_NS:
        state.roll += state.roll_rate * (t_ns - state.roll_ns) * 1e-9
    state.roll_ns, state.roll_rate = t_ns, rate


@nb.njit(**INNER)
def release(feature: Record, tables: Tables, slot: int, state: Record) -> None:
    """End a feature."""
    leave(tables, slot)
    feature.state = FREE
    state.alive -= 1


@nb.njit(**INNER)
def remove_idle(records: RecordArray, tables: Tables, t_ns: int, loop: Record, state: Record) -> None:
    """Release features that are silent, that never began to move, or that ran into an older one."""
    for slot in range(records.size):
        feature = records[slot]
        if feature.state == GROWING and t_ns - feature.born_ns > loop.birth_max_ns:
            release(feature, tables, slot, state)
            state.abandoned += 1
        if feature.state != TRACKING:
            continue
        if t_ns - feature.t_ns > loop.t_max_ns:
            release(feature, tables, slot, state)
            state.silent += 1
            continue
        for k in range(records.size):
            other = records[k]
            dx, dy = feature.x - other.x, feature.y - other.y
            beside = dx * dx + dy * dy < loop.crowding_px**2
            if beside and other.state == TRACKING and other.born_ns < feature.born_ns:
                release(feature, tables, slot, state)
                state.crowded += 1
                break


@nb.njit(**INNER)
def balance(state: Record) -> None:
    """On and off thresholds of a sensor differ; over time both polarities carry the same change of
    brightness."""
    off, on = state.seen[0], state.seen[1]
    if off + on > _BALANCE_EVENTS:
        ratio = min(max(np.sqrt(max(off, 1.0) / max(on, 1.0)), 0.5), 2.0)
        state.worth[0], state.worth[1] = -1.0 / ratio, ratio
        state.seen[0], state.seen[1] = 0.5 * off, 0.5 * on


@nb.njit(**INNER)
def guess_velocity(records: RecordArray, feature: Record, within_px: float, work: Record) -> bool:
    """Mean velocity of the three nearest tracked features, into the frame `work`; False, and zero, unless
    three are near enough."""
    first = second = third = within_px * within_px
    a = b = c = -1
    for k in range(records.size):
        other = records[k]
        if other.state != TRACKING:
            continue
        dx, dy = feature.x - other.x, feature.y - other.y
        d2 = dx * dx + dy * dy
        if d2 < first:
            first, second, third, a, b, c = d2, first, second, k, a, b
        elif d2 < second:
            second, third, b, c = d2, second, k, b
        elif d2 < third:
            third, c = d2, k
    work.vx = work.vy = 0.0
    if c < 0:
        return False
    work.vx = (records[a].vx + records[b].vx + records[c].vx) / 3.0
    work.vy = (records[a].vy + records[b].vy + records[c].vy) / 3.0
    return True


@nb.njit(**INNER)
def place(feature: Record, roll: float, lag_share: float) -> tuple[float, float]:
    """Where the point that a feature reports is in the image: ahead of its picture by the lag of events.

    `roll` [rad] turns the patch frame into the image frame.
    """
    c, s = np.cos(roll), np.sin(roll)
    ahead = lag_share * feature.lag / max(np.hypot(feature.vx, feature.vy), 1e-3)
    u = feature.x + c * feature.offset_x - s * feature.offset_y + ahead * feature.vx
    v = feature.y + s * feature.offset_x + c * feature.offset_y + ahead * feature.vy
    return u, v


@nb.njit(**INNER)
def emit(
    feature: Record,
    work: Record,
    t_ns: int,
    u: float,
    v: float,
    scale: float,
    width: int,
    height: int,
    out: Record,
) -> int:
    """Write an observation of a feature just matched, with the covariance of the match; how many: none
    outside the image."""
    if u < 0.0 or v < 0.0 or u > width - 1 or v > height - 1:
        return 0
    out.t_ns, out.id, out.u, out.v = t_ns, feature.id, u, v
    # Inverse Hessian, turned from the patch frame into the image.
    c, s = np.cos(work.roll), np.sin(work.roll)
    found = work.match
    variance = scale * found.residual / max(found.xx * found.yy - found.xy * found.xy, 1e-12)
    a, b, d = variance * found.yy, -variance * found.xy, variance * found.xx
    out.covariance[0] = c * c * a - 2.0 * c * s * b + s * s * d
    out.covariance[1] = c * s * (a - d) + (c * c - s * s) * b
    out.covariance[2] = s * s * a + 2.0 * c * s * b + c * c * d
    return 1
