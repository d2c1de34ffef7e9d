# SPDX-License-Identifier: Apache-2.0
"""One attempt to initialize a segment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.consensus import TrackConsensus
from asyneio.odometry.initializer.first_window import FirstWindow
from asyneio.odometry.initializer.in_motion import initialize_in_motion, missing_measurements
from asyneio.odometry.initializer.known_state import initialize_from_state
from asyneio.odometry.initializer.stationary import initialize_stationary
from asyneio.odometry.settings import Settings
from asyneio.odometry.stationary import StationaryPhase
from asyneio.types import InitialState

#: Time between two attempts [ns]; each covers more motion than the one before.
_RETRY_NS = 250_000_000
#: An attempt in motion takes up to a second of processor time. After each of this number of them the time
#: between attempts grows, up to the second number of times: otherwise a scene in which none succeeds would
#: keep a processor busy, and a live run would fall behind.
_ATTEMPTS, _LONGEST_RETRY = 4, 3


class Waiting(NamedTuple):
    """Why there is no first window yet, and whether finding out took an attempt in motion."""

    reason: str
    attempted: bool = False


def retry_ns(attempts: int) -> int:
    """Time until the next attempt [ns], after a number of attempts in motion."""
    return _RETRY_NS * min(1 + attempts // _ATTEMPTS, _LONGEST_RETRY)


def initialize(
    buffer: MeasurementBuffer,
    settings: Settings,
    phase: StationaryPhase | None,
    first: InitialState | None,
    consensus: TrackConsensus,
) -> FirstWindow | Waiting:
    """The first window, from a known state, stationary or in motion, or the reason why not yet.

    In motion, tracks that contradict the motion of the majority are rejected first. A stationary phase before
    the motion adds information, so an initialization that uses it is tried before one from motion alone.

    Args:
        buffer: measurements of the segment.
        settings: of the odometry.
        phase: the newest stationary phase, None before the first.
        first: a known state, None where there is none.
        consensus: of the segment's tracks, which this attempt updates.

    Raises:
        EstimationError: `first` cannot be used.
    """
    if first is not None:
        known = initialize_from_state(buffer, settings, first)
        return Waiting(known) if isinstance(known, str) else known
    if phase is not None and not phase.ended:
        resting = initialize_stationary(buffer, settings, phase)
        return Waiting(resting) if isinstance(resting, str) else resting
    if phase is None:
        missing = missing_measurements(buffer, settings)
        if missing:
            return Waiting(missing)  # before the consensus, which takes a fifth of an attempt
    w = settings.window
    gravity = float(np.linalg.norm(w.gravity_w))
    gyroscope_sigma = float(settings.initialization.bias_sigma[0])
    buffer.reject(consensus.update(buffer, w.T_b_c, gravity, w.bearing_sigma, gyroscope_sigma))
    found = "no stationary phase" if phase is None else initialize_stationary(buffer, settings, phase)
    if isinstance(found, str):
        found = initialize_in_motion(buffer, settings, consensus.gyroscope_bias)
    return Waiting(found, attempted=True) if isinstance(found, str) else found
