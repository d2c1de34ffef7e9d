# SPDX-License-Identifier: Apache-2.0
"""Initialization in motion: motion of a span, warm-up (40), joint optimisation (39), and checks of the
result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.problem.problem import States
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.estimation.solver.covariance import relative_scale_sigma
from asyneio.geometry.gravity import upright
from asyneio.initialization.warm_up import warm_up
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.checks import joint_rejection, motion_rejection, outlier_rejection
from asyneio.odometry.initializer.first_window import FirstWindow, filled_window
from asyneio.odometry.initializer.span_motion import SpanMotion, span_motion
from asyneio.odometry.initializer.static_tracks import fit_static_tracks
from asyneio.odometry.propagation import rates_at
from asyneio.odometry.settings import Settings
from asyneio.types import FloatArray, IntArray

#: Standard deviations of the zero-mean priors of the warm-up: any velocity or acceleration of a person or
#: drone.
_WARM_UP_SIGMA = np.array([10.0, 100.0])
_NO_BIAS = np.zeros(3)


def initialize_in_motion(
    buffer: MeasurementBuffer, settings: Settings, gyroscope_bias: FloatArray = _NO_BIAS
) -> FirstWindow | str:
    """A window over all measurements of the buffer, or the reason why not yet.

    Args:
        buffer: the measurements.
        settings: of the odometry.
        gyroscope_bias: (3,) a guess [rad/s].
    """
    knots_ns = _knot_times(buffer, settings)
    reason = missing_measurements(buffer, settings)
    if knots_ns is None or reason:
        return reason
    seen = buffer.observations.between(int(knots_ns[0]) - 1, int(knots_ns[-1]))
    seen = _long_tracks(seen, settings.window.min_observations)
    tracks = len(np.unique(seen.track))
    if tracks < settings.initialization.min_landmarks:
        return f"too few feature tracks: {tracks}, {settings.initialization.min_landmarks} are required"
    try:
        motion = span_motion(buffer, settings, knots_ns, seen, gyroscope_bias)
        reason = motion_rejection(motion, settings)
        if reason:
            return reason
        states = _first_states(buffer, settings, knots_ns, motion)
        window = filled_window(buffer, _at_offset(settings, motion), knots_ns, states, motion.outliers)
        fit = fit_static_tracks(window, settings.initialization.optimizer)
    except (EstimationError, InertialError) as error:
        return str(error)
    rejected = np.concatenate([fit.removed, motion.outliers])
    reason = outlier_rejection(len(rejected), tracks) or joint_rejection(fit.solution, motion, settings)
    if reason:
        return reason
    buffer.reject(rejected)
    return FirstWindow(fit.window, fit.solution, relative_scale_sigma(fit.solution), fit.object_in_view)


def missing_measurements(buffer: MeasurementBuffer, settings: Settings) -> str:
    """What the buffer lacks for an attempt; empty if nothing."""
    knots_ns = _knot_times(buffer, settings)
    if knots_ns is None:
        return "waiting for inertial samples and feature tracks that overlap in time"
    span_s, least_s = float(knots_ns[-1] - knots_ns[0]) * 1e-9, settings.initialization.min_seconds
    return f"collecting measurements: {span_s:.2f} s of {least_s:.2f} s" if span_s < least_s else ""


def _at_offset(settings: Settings, motion: SpanMotion) -> Settings:
    """Settings of a window that begins with the camera's time offset of `motion`."""
    camera = settings.window.calibration
    if 0 not in camera.columns:
        return settings
    camera = replace(camera, time_offset=motion.adjusted.motion.time_offset)
    return replace(settings, window=replace(settings.window, calibration=camera))


def _knot_times(buffer: MeasurementBuffer, settings: Settings) -> IntArray | None:
    """Knot times from the first time that all streams cover; None where there are fewer than two."""
    if buffer.end_ns is None or min(len(buffer.gyroscope), len(buffer.accelerometer)) < 2:
        return None
    if len(buffer.observations.t_ns) == 0:
        return None
    first = max(
        int(buffer.gyroscope["t_ns"][0]),
        int(buffer.accelerometer["t_ns"][0]),
        int(buffer.observations.t_ns[0]),
    )
    # The last knot is at the end of the newest packet, so that later packets end at knots too.
    first = buffer.end_ns - (buffer.end_ns - first) // settings.knot_interval_ns * settings.knot_interval_ns
    times = np.arange(first, buffer.end_ns + 1, settings.knot_interval_ns)
    return times if len(times) >= 2 else None


def _long_tracks(seen: TrackObservations, minimum: int) -> TrackObservations:
    _, inverse, counts = np.unique(seen.track, return_inverse=True, return_counts=True)
    return seen.chosen(counts[inverse] >= minimum)


def _first_states(
    buffer: MeasurementBuffer, settings: Settings, knots_ns: IntArray, motion: SpanMotion
) -> States:
    """States of the knots: motion of the span with z up, velocities and accelerations by warm-up (40)."""
    w, found, at = settings.window, motion.adjusted.motion, motion.increments
    C_w_b0 = upright(found.gravity)
    t = ((knots_ns - knots_ns[0]) * 1e-9)[:, None]
    r = motion.displacement @ C_w_b0.T
    v = (found.velocity + found.gravity * t + at.nu) @ C_w_b0.T
    C = C_w_b0 @ at.C
    streams = (buffer.gyroscope, buffer.accelerometer)
    half = settings.knot_interval_ns // 2
    rates = np.stack(
        [
            rates_at(int(knots_ns[k]), C[k], v[k], streams, found.bias, w.gravity_w, half)
            for k in range(len(knots_ns))
        ]
    )
    dt = np.diff(knots_ns) * 1e-9
    varpi = warm_up(C, r, rates, dt, w.root_density, _WARM_UP_SIGMA, w.motion_model)
    return States(C, r, varpi, np.tile(found.bias, (len(knots_ns), 1)))
