# SPDX-License-Identifier: Apache-2.0
"""What the event loop of the default tracker reads and writes, in one tuple."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.frontend.detection import SCRATCH
from asyneio.frontend.feature_grid import BUCKET_FEATURES, FeatureGrids
from asyneio.frontend.gradient.features import Features
from asyneio.frontend.surface import NEVER_NS, Surface
from asyneio.types import IntArray, RecordArray

#: State that is carried from packet to packet, and counts.
STATE_DTYPE = np.dtype(
    [
        ("written", "<i8"),  # observations in the output
        ("checked_ns", "<i8"),  # time of the last track management
        ("hot_ns", "<i8"),  # time of the last search for hot pixels
        ("roll_ns", "<i8"),  # time of `roll`
        ("roll", "<f8"),  # rad, of the image
        ("roll_rate", "<f8"),  # rad/s
        ("polarity_counts", "<f8", (2,)),  # off and on events
        ("polarity_weights", "<f8", (2,)),  # signed weight of an off and of an on event
        ("alive", "<i8"),  # features, growing or tracked
        ("capacity", "<i8"),  # no feature begins while `alive` has reached it
        ("allowed", "<f8"),  # the same, under a limit on the load
        ("tests", "<f8"),  # corner tests that are left
        ("load", "<f8"),  # limit on the nominal cost, share of a core; zero: no limit
        ("credit_ns", "<f8"),  # computing time that is left, by nominal costs
        ("credited_ns", "<i8"),  # time of the last addition to `credit_ns`
        ("unmeasured", "<i8"),  # events that `rate_hz` does not contain yet
        ("rate_hz", "<f8"),  # events per second, without those of hot pixels
        ("unsupported", "<i8"),  # of `unmeasured`, those without a neighbour that fired shortly before
        ("unsupported_share", "<f8"),  # running mean of their share
        ("support_ns", "<i8"),  # longest time since the event of a neighbour that supports an event
        ("filters", "<i8"),  # 1 while events without support are not fed to features
        ("stretch", "<f8"),  # factor on the windows of features
        ("hot_pixels", "<i8"),
        ("hot_events", "<i8"),
        ("noise_events", "<i8"),  # events without support that were not fed to features
        ("fed", "<i8"),  # events passed to features, counted once per feature
        ("untested", "<i8"),  # events without a test for lack of `tests`
        ("shed_events", "<i8"),  # events dropped away from all features
        ("shed_fed", "<i8"),  # events near features that had no credit, dropped or not
        ("shed_features", "<i8"),
        ("corners", "<i8"),
        ("tracks", "<i8"),
        ("untrusted", "<i8"),  # tracks ended by a quality check
        ("crowded", "<i8"),  # tracks ended beside an older one
        ("silent", "<i8"),  # tracks ended for lack of events
        ("border", "<i8"),  # tracks ended at the border of the image
        ("abandoned", "<i8"),  # features that were never tracked
    ]
)


class LoopSettings(NamedTuple):
    """Settings of Algorithm 1 for one sensor; lengths in pixels, times in nanoseconds."""

    width: int
    height: int
    silence_ns: int
    spacing_px: float
    neighbourhood_px: float
    crowding_px: float
    border_px: int
    t_min_ns: int
    t_max_ns: int
    birth_max_ns: int


class GradientArrays(NamedTuple):
    """The default tracker as its kernels see it.

    `surface`, `features` and `grids`; `loop` (1,) of LoopSettings, `settings` (1,) of GradientSettings,
    `work` (1,) WORK_DTYPE, `state` (1,) STATE_DTYPE; working memory: `nearby` (BUCKET_FEATURES,) int64, the
    slots that an event is fed to, and `corner_scratch` (SCRATCH,) int64 of a corner test; `supported_ns`
    (H,W,2), the surface of the events that the noise filter passes.
    """

    surface: Surface
    features: Features
    grids: FeatureGrids
    loop: RecordArray
    settings: RecordArray
    work: RecordArray
    state: RecordArray
    nearby: IntArray
    corner_scratch: IntArray
    supported_ns: IntArray


class Roll(NamedTuple):
    """Roll of the image [rad] and its rate [rad/s], positive from x towards y."""

    angle: float
    rate: float


def make_state(capacity: int, load: float) -> RecordArray:
    """State (1,) STATE_DTYPE before the first event; `load` as in `FrontendConfig.max_load`."""
    state = np.zeros(1, dtype=STATE_DTYPE)
    state["checked_ns"] = state["hot_ns"] = state["roll_ns"] = state["credited_ns"] = NEVER_NS
    state["polarity_weights"] = -1.0, 1.0
    state["stretch"] = 1.0
    state["capacity"] = capacity
    state["load"], state["allowed"] = load, np.inf
    return state


def make_nearby() -> IntArray:
    """Working memory for the slots that one event is fed to."""
    return np.empty(BUCKET_FEATURES, dtype=np.int64)


def make_corner_scratch() -> IntArray:
    """Working memory of a corner test."""
    return np.empty(SCRATCH, dtype=np.int64)
