# SPDX-License-Identifier: Apache-2.0
"""What all trackers share: their interface, their statistics, and how their kernels are called."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias, get_type_hints

import numpy as np

from asyneio.jit import njit
from asyneio.types import RecordArray

#: States of a feature slot: unused; a corner that still collects the events for its template; tracked.
FREE, GROWING, TRACKING = 0, 1, 2

#: From the event with index `first` on, the image rolls at `rate` [rad/s], positive from x towards y. The
#: first record of a packet has `first` 0; the indices ascend.
TURN_DTYPE = np.dtype([("first", "<i8"), ("rate", "<f8")])

#: A packet without roll.
NO_ROLL = np.zeros(1, dtype=TURN_DTYPE)

#: One element of a structured array. Numba accesses its fields as attributes, which NumPy's type does not
#: declare.
Record: TypeAlias = Any

#: Options of a kernel that is copied into its callers: one that runs for every event, where a call would pass
#: dozens of array fields, or one with a single caller, where that saves time to compile.
INLINE: dict[str, Any] = {"cache": True, "inline": "always"}


@njit(**INLINE)
def has_capacity(state: Record) -> bool:
    """Whether another feature may begin; `state` has the fields `alive` and `capacity`."""
    return state.alive < state.capacity


@njit(**INLINE)
def is_outside(u: float, v: float, sensor: Record, margin: float) -> bool:
    """Whether a position is outside the image or within `margin` [px] of its border; `sensor` has the fields
    `width` and `height`."""
    return u < margin or v < margin or u > sensor.width - 1 - margin or v > sensor.height - 1 - margin


@njit(**INLINE)
def free_slot(records: RecordArray) -> int:
    """The first unused slot; there must be one."""
    slot = int(np.int64(0))
    while records[slot].state != FREE:
        slot += 1
    return slot


@dataclass(frozen=True)
class FrontendStatistics:
    """Counts since the start.

    Attributes:
        events: processed.
        hot_pixels: pixels that are masked now.
        hot_events: events of masked pixels.
        noise_events: other events that were dropped as noise.
        corners: corners that began a feature.
        tracks: features that were tracked, each with an id of its own.
        alive: features tracked now.
        ended_untrusted: tracks ended by a quality check.
        ended_silent: tracks ended for lack of events.
        ended_border: tracks ended at the border of the image.
        untested: events that passed all filters, but exceeded the budget of corner tests.
        fed: events passed to features, counted once per feature.
        shed_events: events without a feature nearby, dropped under `frontend.max_load`.
        shed_feature_events: events near features, dropped under `frontend.max_load`.
        shed_features: features released under `frontend.max_load`.
    """

    events: int
    hot_pixels: int
    hot_events: int
    corners: int
    tracks: int
    alive: int
    ended_untrusted: int
    ended_silent: int
    ended_border: int
    noise_events: int = 0
    untested: int = 0
    fed: int = 0
    shed_events: int = 0
    shed_feature_events: int = 0
    shed_features: int = 0


class Tracker(Protocol):
    """Follows features through packets of events."""

    def follow(self, events: RecordArray, turns: RecordArray) -> RecordArray:
        """Process a packet of events.

        Args:
            events: EVENT_DTYPE, validated by `EventValidator.validated`.
            turns: TURN_DTYPE, the roll of the image during the packet.

        Returns:
            OBSERVATION_DTYPE.
        """
        ...

    def set_outlier_share(self, share: float) -> None:
        """Set the share of the tracks (0 to 1) that the estimator rejects as outliers, from now on."""
        ...

    def limit_load(self, share: float) -> None:
        """Limit the nominal cost to this share of a processor core, from now on; 0: no limit."""
        ...

    def statistics(self) -> FrontendStatistics:
        """Counts since the start."""
        ...


def record_of(values: NamedTuple) -> RecordArray:
    """Named numbers as an array (1,) of one record.

    Kernels pass a record on as one pointer. A tuple of many numbers is split into its elements at every call,
    which takes time to compile.
    """
    kinds = {int: "<i8", float: "<f8"}
    fields = [(name, kinds[kind]) for name, kind in get_type_hints(type(values)).items()]
    return np.array([tuple(values)], dtype=np.dtype(fields, align=True))


def in_pieces(
    events: RecordArray, buffer: RecordArray, step: Callable[[RecordArray, int], tuple[int, int]]
) -> RecordArray:
    """Run a kernel with an output of fixed size over a packet, as often as its output fills up.

    Args:
        events: the packet.
        buffer: what `step` writes to.
        step: called as `step(events, start)`; returns the index of the next event to process and the number
            of records written.

    Returns:
        All records written, in order.
    """
    pieces, start = [buffer[:0].copy()], 0
    while start < events.size:
        start, written = step(events, start)
        pieces.append(buffer[:written].copy())
    return np.concatenate(pieces)
