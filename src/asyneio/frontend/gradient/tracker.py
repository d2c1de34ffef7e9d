# SPDX-License-Identifier: Apache-2.0
"""The default tracker as an object: holds the state and calls the kernel."""

from __future__ import annotations

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend.extents import neighbourhood_px, spacing_px
from asyneio.frontend.feature_grid import make_grids
from asyneio.frontend.gradient.budget import THINNING
from asyneio.frontend.gradient.feature import GradientSettings
from asyneio.frontend.gradient.features import make_features
from asyneio.frontend.gradient.kernel import process_events
from asyneio.frontend.gradient.patch import make_workspace
from asyneio.frontend.gradient.state import (
    GradientArrays,
    LoopSettings,
    make_corner_scratch,
    make_nearby,
    make_state,
)
from asyneio.frontend.surface import make_surface
from asyneio.frontend.tracker import TRACKING, TURN_DTYPE, FrontendStatistics, in_pieces, record_of
from asyneio.frontend.validation import EventValidator
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, RecordArray

#: An edge that crosses a pixel again after this time counts as new (Li et al., IROS 2019).
_SILENCE_NS = 50_000_000
#: A feature that has not moved far enough by this age is released.
_BIRTH_MAX_NS = 250_000_000
_CROWDING_PX = 5.0
_BORDER_PX = 6
#: Largest capacity, as a multiple of `max_features`, however many tracks are outliers.
_MOST = 2
#: Observations that one call of the kernel can return.
_BUFFER = 16_384


class GradientTracker:
    """Matches motion-compensated patches of events against learned gradient templates.

    Args:
        config: the section `frontend`.
        width, height: of the sensor [px].
        settings: of the tracker itself.
    """

    def __init__(
        self, config: FrontendConfig, width: int, height: int, settings: GradientSettings | None = None
    ) -> None:
        self._validator = EventValidator(width, height)
        self.settings = settings or GradientSettings()
        loop = LoopSettings(
            width=width,
            height=height,
            silence_ns=_SILENCE_NS,
            spacing_px=spacing_px(config.spacing, width),
            neighbourhood_px=neighbourhood_px(width),
            crowding_px=_CROWDING_PX,
            border_px=_BORDER_PX,
            t_min_ns=round(config.min_interval_s * NS_PER_S),
            t_max_ns=round(config.max_silence_s * NS_PER_S),
            birth_max_ns=_BIRTH_MAX_NS,
        )
        self._max_features = config.max_features
        slots = _MOST * config.max_features
        surface = make_surface(width, height)
        self.arrays = GradientArrays(
            surface=surface,
            features=make_features(slots),
            grids=make_grids(width, height, slots, self.settings.feed_radius_px, loop.spacing_px),
            loop=record_of(loop),
            settings=record_of(self.settings),
            work=make_workspace(self.settings.mask_sigma_px),
            state=make_state(config.max_features, config.max_load),
            nearby=make_nearby(),
            corner_scratch=make_corner_scratch(),
            supported_ns=surface.latest_ns.copy(),
        )
        self._buffer = np.zeros(_BUFFER, dtype=OBSERVATION_DTYPE)
        self._events = 0

    def process(self, events: RecordArray, roll_rate: float = 0.0) -> RecordArray:
        """Process a packet of events during which the image rolls at `roll_rate` [rad/s], from x towards y.

        Args:
            events: EVENT_DTYPE, ascending, later than all before.
            roll_rate: of the image [rad/s].

        Returns:
            OBSERVATION_DTYPE, in order of emission.

        Raises:
            RecordingError: invalid events, see `EventValidator.validated`.
        """
        events = self._validator.validated(events)
        return self.follow(events, np.array([(0, roll_rate)], dtype=TURN_DTYPE))

    def follow(self, events: RecordArray, turns: RecordArray) -> RecordArray:
        """As `Tracker.follow`."""
        self._events += events.size
        return in_pieces(events, self._buffer, lambda part, start: self._step(part, start, turns))

    def set_outlier_share(self, share: float) -> None:
        """Raise the capacity so that `max_features` inliers remain, up to twice `max_features`."""
        capacity = self._max_features / max(1.0 - share, 1.0 / _MOST)
        self.arrays.state[0]["capacity"] = min(round(capacity), _MOST * self._max_features)

    def limit_load(self, share: float) -> None:
        """Limit the nominal cost to this share of a processor core, from now on; 0: no limit."""
        state = self.arrays.state[0]
        state["load"] = share
        if share == 0.0:
            state["allowed"] = np.inf

    def statistics(self) -> FrontendStatistics:
        """Counts since the start."""
        state = self.arrays.state[0]
        return FrontendStatistics(
            events=self._events,
            hot_pixels=int(state["hot_pixels"]),
            hot_events=int(state["hot_events"]),
            corners=int(state["corners"]),
            tracks=int(state["tracks"]),
            alive=int(np.count_nonzero(self.arrays.features.records["state"] == TRACKING)),
            ended_untrusted=int(state["untrusted"] + state["crowded"]),
            ended_silent=int(state["silent"]),
            ended_border=int(state["border"]),
            noise_events=int(state["noise_events"]),
            untested=int(state["untested"]),
            fed=int(state["fed"]),
            shed_events=int(state["shed_events"]),
            shed_feature_events=int(state["shed_fed"] - state["shed_fed"] // THINNING),
            shed_features=int(state["shed_features"]),
        )

    def _step(self, events: RecordArray, start: int, turns: RecordArray) -> tuple[int, int]:
        following = process_events(events, start, turns, self.arrays, self._buffer)
        return following, int(self.arrays.state[0]["written"])
