"""An attempt to start a segment, in the way that what is known allows."""

from __future__ import annotations

import numpy as np

from asyneio.odometry.first_window import Start
from asyneio.odometry.intake import Intake
from asyneio.odometry.known_start import known_start
from asyneio.odometry.screen import contradicting_tracks
from asyneio.odometry.settings import Settings
from asyneio.odometry.start import try_start
from asyneio.odometry.static_start import static_start
from asyneio.types import FirstState

#: Attempts to start are this far apart; each sees more motion than the last.
RETRY_NS = 250_000_000


def attempt_start(
    intake: Intake, settings: Settings, resting_since_ns: int | None, first: FirstState | None
) -> Start | str:
    """From a known state, at rest or in motion: a window, or the reason, in words, why not yet.

    Tracks that contradict the motion of most of them are refused before a start in motion is tried.

    Raises:
        EstimationError: `first` cannot be used.
    """
    if first is not None:
        return known_start(intake, settings, first)
    if resting_since_ns is not None:
        return static_start(intake, settings, resting_since_ns)
    w = settings.window
    gravity = float(np.linalg.norm(w.gravity_w))
    intake.refuse(contradicting_tracks(intake, w.T_b_c, gravity, w.bearing_sigma))
    return try_start(intake, settings)
