"""The default tracker as an object: holds the state, feeds the kernel, keeps the sensor's own figures."""

from __future__ import annotations

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend import gradient_kernel as kernel
from asyneio.frontend.features import make_features
from asyneio.frontend.gradient_feature import GradientSettings
from asyneio.frontend.patch import make_workspace
from asyneio.frontend.registration import make_registration
from asyneio.frontend.statistics import FrontendStatistics
from asyneio.frontend.surface import HotPixels, make_surface
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, RecordArray

#: An edge that crosses a pixel again after this long counts as new (Li et al. 2019).
_SILENCE_NS = 50_000_000
#: A corner that has not moved far enough by then is given up.
_BIRTH_MAX_NS = 250_000_000
_CROWDING_PX = 5.0
_BORDER_PX = 6
#: Sample of events over which the thresholds for on and off are balanced.
_BALANCE_EVENTS = 20_000


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
        self._loop = kernel.LoopSettings(
            silence_ns=_SILENCE_NS,
            spacing_px=config.spacing_px,
            crowding_px=_CROWDING_PX,
            border_px=_BORDER_PX,
            t_min_ns=round(config.min_interval_s * NS_PER_S),
            t_max_ns=round(config.max_silence_s * NS_PER_S),
            birth_max_ns=_BIRTH_MAX_NS,
            max_features=config.max_features,
        )
        self._surface = make_surface(width, height)
        self._hot = HotPixels(self._surface)
        self.features = make_features(config.max_features)
        self._registration = make_registration(width, height, config.max_features)
        self._work = make_workspace(self.settings.mask_sigma_px)
        self._weight = np.array([0.0, 0.0, 1.0, 1.0])
        self._roll = np.zeros(3)
        self._counters = np.zeros(kernel.COUNTERS, dtype=np.int64)
        self._buffer = np.zeros(4 * kernel.MAX_UPDATES, dtype=OBSERVATION_DTYPE)
        self._events = 0

    def process(self, events: RecordArray, roll_rate: float = 0.0) -> RecordArray:
        """Observations that a non-empty packet leads to; `roll_rate` of the image in it [rad/s], x towards y."""
        first_ns = int(events["t_ns"][0])
        self._hot.refresh(first_ns)
        self._roll[1] += self._roll[2] * (first_ns - self._roll[0]) * 1e-9 if self._events else 0.0
        self._roll[0], self._roll[2] = first_ns, roll_rate
        pieces, start = [], 0
        while start < events.size:
            start, written = kernel.process_events(
                events,
                start,
                self._surface,
                self.features,
                self._registration,
                self._loop,
                self.settings,
                self._work,
                self._weight,
                self._roll,
                self._counters,
                self._buffer,
            )
            pieces.append(self._buffer[:written].copy())
        self._events += events.size
        self._balance()
        return np.concatenate(pieces)

    def statistics(self) -> FrontendStatistics:
        """Counts since the start."""
        c = self._counters
        return FrontendStatistics(
            events=self._events,
            hot_pixels=self._hot.masked,
            hot_events=int(c[kernel.HOT]),
            corners=int(c[kernel.CORNERS]),
            tracks=int(c[kernel.NEXT_ID]),
            alive=int(np.count_nonzero(self.features.state == 2)),
            ended_untrusted=int(c[kernel.UNTRUSTED] + c[kernel.CROWDED]),
            ended_silent=int(c[kernel.SILENT]),
            ended_border=int(c[kernel.BORDER]),
        )

    def _balance(self) -> None:
        """On and off thresholds of a sensor differ; over time both polarities carry the same change of brightness."""
        off, on = self._weight[:2]
        if off + on > _BALANCE_EVENTS:
            ratio = np.clip(np.sqrt(max(off, 1.0) / max(on, 1.0)), 0.5, 2.0)
            self._weight[:] = 0.5 * off, 0.5 * on, 1.0 / ratio, ratio
