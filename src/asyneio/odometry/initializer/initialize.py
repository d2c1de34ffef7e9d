"""An attempt to start a segment, in the way that what is known allows."""

from __future__ import annotations

import numpy as np

from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.consensus import contradicting_tracks
from asyneio.odometry.initializer.first_window import Start
from asyneio.odometry.initializer.in_motion import try_start
from asyneio.odometry.initializer.known_state import known_start
from asyneio.odometry.initializer.stationary import static_start
from asyneio.odometry.settings import Settings
from asyneio.odometry.stationary import Rest
from asyneio.types import InitialState

#: Attempts to start are this far apart; each sees more motion than the last.
RETRY_NS = 250_000_000


def attempt_start(
    intake: MeasurementBuffer, settings: Settings, rest: Rest | None, first: InitialState | None
) -> Start | str:
    """From a known state, from rest or in motion: a window, or the reason, in words, why not yet.

    In motion, tracks that contradict the motion of most of them are refused first. What began at rest tells
    more than motion alone, and is tried before it.

    Raises:
        EstimationError: `first` cannot be used.
    """
    if first is not None:
        return known_start(intake, settings, first)
    if rest is not None and not rest.over:
        return static_start(intake, settings, rest)
    w = settings.window
    gravity = float(np.linalg.norm(w.gravity_w))
    intake.refuse(
        contradicting_tracks(intake, w.T_b_c, gravity, w.bearing_sigma, float(settings.start.bias_sigma[0]))
    )
    started = "no rest" if rest is None else static_start(intake, settings, rest)
    return try_start(intake, settings) if isinstance(started, str) else started
