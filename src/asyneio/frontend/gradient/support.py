# SPDX-License-Identifier: Apache-2.0
"""Noise filter: an event counts if a neighbouring pixel has fired shortly before.

Noise events are alone in space and time, events of an edge are not (background-activity filter, Delbruck
2008). What "shortly" means depends on the motion: a slow edge takes long from one pixel to the next. The
window is therefore a share of the mean time between two events of a pixel, which becomes shorter with faster
motion just as the time between neighbours does. If all events were noise, evenly distributed, a third of them
would pass.

The filter has its own surface of events, on which corners are looked for: on the surface of all events, a few
noise events in a circle break the arc of an edge. The share of events without such a neighbour shows how much
noise there is. If they are mostly noise, they are not fed to features either, and the windows of features
become longer. Otherwise features are fed with all events, since lone events are a good part of what a sharp
or slow edge leaves.
"""

from __future__ import annotations

import numpy as np

from asyneio.frontend.gradient.prefetch import prefetch
from asyneio.frontend.gradient.state import GradientArrays
from asyneio.frontend.surface import NEVER_NS, Event, Surface, is_first_of_edge
from asyneio.frontend.tracker import INLINE, Record
from asyneio.jit import njit
from asyneio.types import NS_PER_S, IntArray

#: Window as a share of the mean time between two events of a pixel and polarity.
SUPPORT_SHARE = 0.05
#: Longest window [ns]: when hardly anything moves, every event counts.
MAX_SUPPORT_NS = 1_000 * NS_PER_S
#: Time over which the event rate and the share of events without support are averaged [ns].
RATE_TIME_NS = 100_000_000
#: Share of events without support among those of edges, 0.04 to 0.3 in scenes without noise, and among those
#: of noise: if half of the events are noise, exp(-8 SUPPORT_SHARE / 2).
_OF_EDGES, _OF_NOISE = 0.2, 0.8
#: Largest factor by which the windows of features become longer.
MAX_STRETCH = 2.0


@njit(**INLINE)
def prefetch_neighbours(surface: Surface, event: Event) -> None:
    """Fetch the surface above and below the pixel of an event that comes later."""
    width = surface.hot.shape[1]
    prefetch(surface.latest_ns, 2 * ((event.y - 1) * width + event.x))
    prefetch(surface.latest_ns, 2 * ((event.y + 1) * width + event.x))


@njit(**INLINE)
def measure_noise(state: Record, pixels: int, elapsed_ns: int) -> None:
    """Update the window `state.support_ns` by the rate of the events since the last call, and `state.filters`
    and `state.stretch` by the share of them that were without support.

    The longer the window of a patch, the more events of noise and the more motion are in it: with a share `n`
    of noise, a window that is longer by `1 / (1 - n)` matches about as precisely as without noise.
    """
    rate_hz = state.unmeasured * NS_PER_S / max(elapsed_ns, 1)
    gain = elapsed_ns / (elapsed_ns + RATE_TIME_NS)
    state.rate_hz += (rate_hz - state.rate_hz) * gain
    window_ns = SUPPORT_SHARE * 2 * pixels * NS_PER_S / max(state.rate_hz, 1.0)
    state.support_ns = np.int64(min(window_ns, MAX_SUPPORT_NS))
    if state.unmeasured > 0:
        share = state.unsupported / state.unmeasured
        state.unsupported_share += (share - state.unsupported_share) * gain
        noise = (state.unsupported_share - _OF_EDGES) / (_OF_NOISE - _OF_EDGES)
        noise = min(max(noise, 0.0), 1.0 - 1.0 / MAX_STRETCH)
        # Those of edges are less than half of the events without support.
        state.filters = 2.0 * (1.0 - noise) * _OF_EDGES < state.unsupported_share
        state.stretch = 1.0 / (1.0 - noise) if state.filters else 1.0
    state.unmeasured = state.unsupported = 0


@njit(**INLINE)
def is_supported(tracker: GradientArrays, event: Event) -> bool:
    """Whether a neighbour of an event has fired shortly before; at the border of the image every event
    counts."""
    state = tracker.state[0]
    supported = event.t_ns - newest_neighbour_ns(tracker.surface.latest_ns, event) <= state.support_ns
    state.unmeasured += 1
    state.unsupported += int(not supported)
    return supported


@njit(**INLINE)
def record_supported(tracker: GradientArrays, event: Event) -> bool:
    """Write an event to `supported_ns`; True if it is the first of an edge there."""
    supported_ns = tracker.supported_ns
    first_of_edge = is_first_of_edge(supported_ns, event, tracker.loop[0].silence_ns)
    supported_ns[np.uint64(event.y), np.uint64(event.x), np.uint64(event.p)] = event.t_ns
    return first_of_edge


@njit(**INLINE)
def newest_neighbour_ns(latest_ns: IntArray, event: Event) -> int:
    """Time of the latest event with the polarity of an event at the eight pixels around it; that of the event
    itself at the border of the image."""
    if not (0 < event.x < latest_ns.shape[1] - 1 and 0 < event.y < latest_ns.shape[0] - 1):
        return event.t_ns
    sign, newest = np.uint64(event.p), NEVER_NS
    for v in range(-1, 2):
        row = np.uint64(event.y + v)
        for u in range(-1, 2):
            if u != 0 or v != 0:
                newest = max(newest, latest_ns[row, np.uint64(event.x + u), sign])
    return newest
