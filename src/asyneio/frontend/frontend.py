# SPDX-License-Identifier: Apache-2.0
"""The front end: packets of events in, feature observations out."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.errors import RecordingError
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.frontend.haste.tracker import HasteTracker
from asyneio.frontend.tracker import NO_ROLL, TURN_DTYPE, FrontendStatistics, Tracker
from asyneio.frontend.validation import EventValidator, check_config, check_gyroscope, checked_size
from asyneio.types import INERTIAL_DTYPE, OBSERVATION_DTYPE, EventRecording, IntArray, RecordArray

#: The roll rate is constant over this time.
_ROLL_STEP_NS = 4_000_000
#: Largest rate [rad/s] of a gyroscope; a sample above it, or one that is not finite, is corrupt.
_MOST_ROLL = 1e3


_TRACKERS: dict[str, type[GradientTracker] | type[HasteTracker]] = {
    "gradient": GradientTracker,
    "haste": HasteTracker,
}


class Frontend:
    """Follows features through a stream of events (Algorithm 1 of the paper).

    Args:
        config: the section `frontend`.
        width: of the sensor [px].
        height: of the sensor [px].

    Raises:
        ConfigError: `config` is not a FrontendConfig.
        RecordingError: a size that is no integer, or that no sensor has.
    """

    def __init__(self, config: FrontendConfig, width: int, height: int) -> None:
        check_config(config)
        width, height = checked_size(width, height)
        self._border = EventValidator(width, height)
        self._tracker: Tracker = _TRACKERS[config.tracker](config, width, height)
        self._roll_rate = 0.0

    def process(self, events: RecordArray, gyroscope: RecordArray | None = None) -> RecordArray:
        """Process a packet of events.

        Args:
            events: EVENT_DTYPE, ascending, later than all before, inside the sensor.
            gyroscope: INERTIAL_DTYPE of the same time, **in the camera frame and the camera clock** (see
                `gyroscope_in_camera`); patches are rotated by the roll of the camera. None: no rotation.

        Returns:
            OBSERVATION_DTYPE in the clock of the events, in order of emission. An observation carries the
            time of its position, which is somewhat earlier than the event that triggered it.

        Raises:
            RecordingError: not an array of events; an event outside the sensor; a polarity other than 0 and
                1; times that descend or precede an earlier packet; samples of another type. The whole packet
                is rejected.
        """
        if gyroscope is not None:
            check_gyroscope(gyroscope)
        events = self._border.validated(events)
        if events.size == 0:
            return np.empty(0, dtype=OBSERVATION_DTYPE)
        turns = NO_ROLL if gyroscope is None else self._turns(events["t_ns"], gyroscope)
        return self._tracker.follow(events, turns)

    def set_outlier_share(self, share: float) -> None:
        """Raise the capacity to compensate for tracks that the estimator rejects as outliers.

        The default tracker raises its capacity so that `max_features` inliers remain, up to twice
        `max_features`; the baseline does not.

        Args:
            share: of the tracks that are outliers, 0 to 1.

        Raises:
            RecordingError: not a share.
        """
        if not 0.0 <= share <= 1.0:
            raise RecordingError(f"found {share} for the share of outlier tracks, expected 0 to 1")
        self._tracker.set_outlier_share(share)

    def limit_load(self, share: float) -> None:
        """Change `frontend.max_load` from now on: for live use, where a wall clock shows the real load.

        Args:
            share: nominal cost per event time, in processor cores; 0: no limit.

        Raises:
            RecordingError: negative or not finite.
        """
        if not 0.0 <= share < math.inf:
            raise RecordingError(
                f"found {share} for the share of a processor core, expected a positive number, or 0 for no "
                "limit"
            )
        self._tracker.limit_load(share)

    def statistics(self) -> FrontendStatistics:
        """Counts since the start."""
        return self._tracker.statistics()

    def _turns(self, t_ns: IntArray, gyroscope: RecordArray) -> RecordArray:
        """Roll of the image during a packet: TURN_DTYPE."""
        found = [
            (begin, self._roll_rate_in(gyroscope, start_ns, start_ns + _ROLL_STEP_NS))
            for begin, start_ns in _steps(t_ns)
        ]
        return np.array(found, dtype=TURN_DTYPE)

    def _roll_rate_in(self, gyroscope: RecordArray, start_ns: int, end_ns: int) -> float:
        """Roll rate of the image [rad/s], opposite to the camera's; without samples, the previous one."""
        a, b = np.searchsorted(gyroscope["t_ns"], [start_ns, end_ns])
        rates = gyroscope["xyz"][a:b, 2]
        rates = rates[np.abs(rates) < _MOST_ROLL]
        if rates.size:
            self._roll_rate = -float(rates.mean())
        return self._roll_rate


def gyroscope_in_camera(recording: EventRecording) -> RecordArray:
    """Gyroscope samples (INERTIAL_DTYPE) in the camera frame and clock; empty without a calibration."""
    calibration = recording.calibration
    if calibration is None:
        return np.empty(0, dtype=INERTIAL_DTYPE)
    turned = recording.gyroscope.copy()
    turned["t_ns"] -= calibration.timeshift_ns
    turned["xyz"] = recording.gyroscope["xyz"] @ calibration.T_b_c[:3, :3]
    return turned


def _steps(t_ns: IntArray) -> Iterator[tuple[int, int]]:
    """Spans of a packet with a constant roll rate: index of the first event, start [ns]."""
    begin = 0
    while begin < t_ns.size:
        # Spans begin on a grid that starts with the packet; spans without events are skipped.
        start_ns = int(t_ns[begin]) - int(t_ns[begin] - t_ns[0]) % _ROLL_STEP_NS
        yield begin, start_ns
        begin = int(np.searchsorted(t_ns, start_ns + _ROLL_STEP_NS))
