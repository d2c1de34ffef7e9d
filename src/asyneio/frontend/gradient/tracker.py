"""The default tracker as an object: holds the state and feeds the kernel."""

from __future__ import annotations

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend.border import EventBorder
from asyneio.frontend.extents import neighbourhood_px, spacing_px
from asyneio.frontend.feature_grid import make_tables
from asyneio.frontend.gradient.budget import THINNING
from asyneio.frontend.gradient.feature import GradientSettings
from asyneio.frontend.gradient.features import TRACKING, make_features
from asyneio.frontend.gradient.kernel import process_events
from asyneio.frontend.gradient.patch import make_workspace
from asyneio.frontend.gradient.track_management import LoopSettings, make_state
from asyneio.frontend.pieces import in_pieces
from asyneio.frontend.record import record_of
from asyneio.frontend.statistics import FrontendStatistics
from asyneio.frontend.surface import make_surface
from asyneio.frontend.turns import TURN_DTYPE
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, RecordArray

#: An edge that crosses a pixel again after this long counts as new (Li et al. 2019).
_SILENCE_NS = 50_000_000
#: A corner that has not moved far enough by then is given up.
_BIRTH_MAX_NS = 250_000_000
_CROWDING_PX = 5.0
_BORDER_PX = 6
#: At most so many times `max_features` are followed, however many of them nobody can use.
_MOST = 2
#: Observations that one pass of the kernel can return.
_BUFFER = 16_384


class GradientTracker:
    """Gradient templates registered against motion-compensated patches of events.

    Args:
        config: the section `frontend`.
        width, height: of the sensor [px].
        settings: of the tracker itself.
    """

    def __init__(
        self, config: FrontendConfig, width: int, height: int, settings: GradientSettings | None = None
    ) -> None:
        self.settings = settings or GradientSettings()
        loop = LoopSettings(
            silence_ns=_SILENCE_NS,
            spacing_px=spacing_px(config.spacing, width),
            neighbourhood_px=neighbourhood_px(width),
            crowding_px=_CROWDING_PX,
            border_px=_BORDER_PX,
            t_min_ns=round(config.min_interval_s * NS_PER_S),
            t_max_ns=round(config.max_silence_s * NS_PER_S),
            birth_max_ns=_BIRTH_MAX_NS,
        )
        self._loop, self._settings = record_of(loop), record_of(self.settings)
        self._wanted = config.max_features
        capacity = _MOST * config.max_features
        self.features = make_features(capacity)
        self._border = EventBorder(width, height)
        self._surface = make_surface(width, height)
        self._tables = make_tables(width, height, capacity, self.settings.feed_radius_px, loop.spacing_px)
        self._work = make_workspace(self.settings.mask_sigma_px)
        self._state = make_state(config.max_features, config.max_load)
        self._buffer = np.zeros(_BUFFER, dtype=OBSERVATION_DTYPE)
        self._events = 0

    def process(self, events: RecordArray, roll_rate: float = 0.0) -> RecordArray:
        """Observations that a packet leads to; `roll_rate` of the image in it [rad/s], x towards y.

        Raises:
            RecordingError: events that do not fit, see `EventBorder.admitted`.
        """
        events = self._border.admitted(events)
        return self.follow(events, np.array([(0, roll_rate)], dtype=TURN_DTYPE))

    def follow(self, events: RecordArray, turns: RecordArray) -> RecordArray:
        """Observations that a packet as `EventBorder.admitted` returns it leads to; `turns` TURN_DTYPE."""
        self._events += events.size
        return in_pieces(events, self._buffer, lambda part, start: self._step(part, start, turns))

    def set_outlier_share(self, unused: float) -> None:
        """Follow as many more features as leave `max_features` where that share of all is of no use."""
        places = self._wanted / max(1.0 - unused, 1.0 / _MOST)
        self._state[0]["places"] = min(round(places), _MOST * self._wanted)

    def limit_load(self, share: float) -> None:
        """From now on, use so much of a processor core by nominal costs; zero: any."""
        self._state[0]["load"] = share
        if share == 0.0:
            self._state[0]["allowed"] = np.inf

    def statistics(self) -> FrontendStatistics:
        """Counts since the start."""
        state = self._state[0]
        return FrontendStatistics(
            events=self._events,
            hot_pixels=int(state["hot_pixels"]),
            hot_events=int(state["hot_events"]),
            corners=int(state["corners"]),
            tracks=int(state["tracks"]),
            alive=int(np.count_nonzero(self.features.records["state"] == TRACKING)),
            ended_untrusted=int(state["untrusted"] + state["crowded"]),
            ended_silent=int(state["silent"]),
            ended_border=int(state["border"]),
            untested=int(state["untested"]),
            fed=int(state["fed"]),
            shed_events=int(state["shed_events"]),
            shed_feature_events=int(state["shed_fed"] - state["shed_fed"] // THINNING),
            shed_features=int(state["shed_features"]),
        )

    def _step(self, events: RecordArray, start: int, turns: RecordArray) -> tuple[int, int]:
        return process_events(
            events,
            start,
            turns,
            self._surface,
            self.features,
            self._tables,
            self._loop,
            self._settings,
            self._work,
            self._state,
            self._buffer,
        )
