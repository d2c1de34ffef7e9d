"""An attempt to start a segment, in the way that what is known allows."""

from __future__ import annotations

import numpy as np

from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.consensus import outlier_tracks
from asyneio.odometry.initializer.first_window import FirstWindow
from asyneio.odometry.initializer.in_motion import initialize_in_motion
from asyneio.odometry.initializer.known_state import initialize_from_state
from asyneio.odometry.initializer.stationary import initialize_stationary
from asyneio.odometry.settings import Settings
from asyneio.odometry.stationary import StationaryPhase
from asyneio.types import InitialState

#: Attempts to start are this far apart; each sees more motion than the last.
RETRY_NS = 250_000_000


def initialize(
    buffer: MeasurementBuffer, settings: Settings, phase: StationaryPhase | None, first: InitialState | None
) -> FirstWindow | str:
    """From a known state, from rest or in motion: a window, or the reason, in words, why not yet.

    In motion, tracks that contradict the motion of most of them are refused first. What began at rest tells
    more than motion alone, and is tried before it.

    Raises:
        EstimationError: `first` cannot be used.
    """
    if first is not None:
        return initialize_from_state(buffer, settings, first)
    if phase is not None and not phase.ended:
        return initialize_stationary(buffer, settings, phase)
    w = settings.window
    gravity = float(np.linalg.norm(w.gravity_w))
    buffer.reject(
        outlier_tracks(
            buffer, w.T_b_c, gravity, w.bearing_sigma, float(settings.initialization.bias_sigma[0])
        )
    )
    started = "no rest" if phase is None else initialize_stationary(buffer, settings, phase)
    return initialize_in_motion(buffer, settings) if isinstance(started, str) else started
