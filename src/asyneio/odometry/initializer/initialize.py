# SPDX-License-Identifier: Apache-2.0
"""One attempt to initialize a segment."""

from __future__ import annotations

import numpy as np

from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.consensus import outlier_tracks
from asyneio.odometry.initializer.first_window import FirstWindow
from asyneio.odometry.initializer.in_motion import initialize_in_motion, missing_measurements
from asyneio.odometry.initializer.known_state import initialize_from_state
from asyneio.odometry.initializer.stationary import initialize_stationary
from asyneio.odometry.settings import Settings
from asyneio.odometry.stationary import StationaryPhase
from asyneio.types import InitialState

#: Time between two attempts [ns]; each covers more motion than the one before.
RETRY_NS = 250_000_000


def initialize(
    buffer: MeasurementBuffer, settings: Settings, phase: StationaryPhase | None, first: InitialState | None
) -> FirstWindow | str:
    """The first window, from a known state, stationary or in motion, or the reason why not yet.

    In motion, tracks that contradict the motion of the majority are rejected first. A stationary phase before
    the motion adds information, so an initialization that uses it is tried before one from motion alone.

    Args:
        buffer: measurements of the segment.
        settings: of the odometry.
        phase: the newest stationary phase, None before the first.
        first: a known state, None where there is none.

    Raises:
        EstimationError: `first` cannot be used.
    """
    if first is not None:
        return initialize_from_state(buffer, settings, first)
    if phase is not None and not phase.ended:
        return initialize_stationary(buffer, settings, phase)
    if phase is None:
        missing = missing_measurements(buffer, settings)
        if missing:
            return missing  # before the consensus, which takes a third of an attempt
    w = settings.window
    gravity = float(np.linalg.norm(w.gravity_w))
    buffer.reject(
        outlier_tracks(
            buffer, w.T_b_c, gravity, w.bearing_sigma, float(settings.initialization.bias_sigma[0])
        )
    )
    found = "no stationary phase" if phase is None else initialize_stationary(buffer, settings, phase)
    return initialize_in_motion(buffer, settings) if isinstance(found, str) else found
