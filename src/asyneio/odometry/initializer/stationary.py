# SPDX-License-Identifier: Apache-2.0
"""Stationary initialization: a stationary IMU shows the direction of gravity and the gyroscope's bias.

No feature is required: landmarks are initialized when motion causes parallax, and the accelerometer then
gives scale. A stationary accelerometer shows only the component of its bias along gravity. The other two
components cannot be distinguished from tilt: in the covariance of the window they are correlated with it and
remain as uncertain as their prior.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.linearization.zero_velocity import CREEP, TREMOR
from asyneio.estimation.problem.problem import Prior, States
from asyneio.geometry.gravity import upright
from asyneio.inertial.gravity_witness import FORCE_RATIO
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.checks import solution_rejection
from asyneio.odometry.initializer.first_window import FirstWindow, filled_window, first_prior
from asyneio.odometry.initializer.static_tracks import fit_static_tracks
from asyneio.odometry.intervals import around
from asyneio.odometry.propagation import predict_knot
from asyneio.odometry.settings import Settings
from asyneio.odometry.stationary import StationaryPhase
from asyneio.state import DOF, VARPI, VARPI_DOT
from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray, RecordArray

#: The end of a stationary phase is detected late: this duration before it [ns] does not count as stationary.
_UNCERTAIN_NS = 200_000_000
#: Standard deviations of the angular rate [rad/s] and velocity [m/s] in a short stationary phase: tracks that
#: do not move for 0.2 s exclude larger ones.
_COMMON_SIGMA = (1e-2, 1e-2)


def initialize_stationary(
    buffer: MeasurementBuffer, settings: Settings, phase: StationaryPhase
) -> FirstWindow | str:
    """A window that begins in a stationary phase, or the reason why not yet.

    While the phase continues, it suffices that it is long. Once it has ended, the window covers its end and
    the motion after it, and the tracks must agree with both.
    """
    if buffer.end_ns is None or min(len(buffer.gyroscope), len(buffer.accelerometer)) < 2:
        return "waiting for inertial samples"
    duration_s = (phase.end_ns - phase.start_ns) / NS_PER_S
    if not phase.ended and duration_s < settings.initialization.min_seconds:
        needed_s = settings.initialization.min_seconds
        return f"stationary: averaging inertial samples, {duration_s:.2f} s of {needed_s:.2f} s"
    knots_ns = _knot_times(buffer, settings, phase)
    stationary = _stationary_intervals(knots_ns, phase)
    if not stationary.any():
        return "the inertial samples cover fewer than two knots of the stationary phase"
    try:
        states = _first_states(buffer, settings, knots_ns, stationary)
        if not phase.ended:
            window = filled_window(buffer, settings, knots_ns, states, stationary=stationary)
            return FirstWindow(window, window.optimize(settings.initialization.optimizer))
        prior = _prior(states, knots_ns[: 1 + np.count_nonzero(stationary)], settings)
        window = filled_window(buffer, settings, knots_ns, states, prior=prior)
        if len(window.landmarks) < settings.initialization.min_landmarks:
            needed = settings.initialization.min_landmarks
            return f"too few feature tracks: {len(window.landmarks)}, {needed} are required"
        fit = fit_static_tracks(window, settings.initialization.optimizer)
    except (EstimationError, InertialError) as error:
        return str(error)
    reason = solution_rejection(fit.solution, settings)
    if reason:
        return reason
    buffer.reject(fit.removed)
    return FirstWindow(fit.window, fit.solution, object_in_view=fit.object_in_view)


def _knot_times(buffer: MeasurementBuffer, settings: Settings, phase: StationaryPhase) -> IntArray:
    """Knots from the stationary phase, at most a window's length before its end, to the end of the newest
    packet."""
    assert buffer.end_ns is not None
    first = max(int(buffer.gyroscope["t_ns"][0]), int(buffer.accelerometer["t_ns"][0]), phase.start_ns)
    first = max(first, phase.end_ns - round(settings.window_s * NS_PER_S))
    intervals = max((buffer.end_ns - first) // settings.knot_interval_ns, 0)
    return buffer.end_ns - settings.knot_interval_ns * np.arange(intervals, -1, -1, dtype=np.int64)


def _stationary_intervals(knots_ns: IntArray, phase: StationaryPhase) -> BoolArray:
    """Which intervals (K-1,) between knots (K,) are stationary. The last part of a phase that has ended
    counts only in the first interval."""
    end_ns = knots_ns[1:]
    stationary = end_ns <= phase.end_ns - _UNCERTAIN_NS * phase.ended
    stationary[:1] = end_ns[:1] <= phase.end_ns
    return np.asarray(stationary)


def _first_states(
    buffer: MeasurementBuffer, settings: Settings, knots_ns: IntArray, stationary: BoolArray
) -> States:
    """One pose for all knots of the stationary phase, dead reckoning after it."""
    count = 1 + int(np.count_nonzero(stationary))
    streams = buffer.gyroscope, buffer.accelerometer
    omega, force = (_mean(stream, int(knots_ns[0]), int(knots_ns[count - 1])) for stream in streams)
    ratio = float(np.linalg.norm(force) / np.linalg.norm(settings.window.gravity_w))
    if not 1.0 / FORCE_RATIO < ratio < FORCE_RATIO:
        raise EstimationError(
            f"the stationary accelerometer reads {ratio:.3g} times gravity; "
            "check its unit and full-scale range"
        )
    states = _stationary_states(omega, force, settings, count)
    for from_ns, to_ns in pairwise(knots_ns[count - 1 :].tolist()):
        knot = predict_knot(states, from_ns, to_ns, streams, settings.window.gravity_w)
        states = states.joined(knot)
    return states


def _prior(states: States, knots_ns: IntArray, settings: Settings) -> Prior:
    """Prior on the knots (m,) of a stationary phase: that of the first knot, and zero velocity.

    A short phase of samples and tracks does not exclude slow uniform motion. The common velocity of these
    knots therefore has a larger standard deviation than the differences between them.
    """
    mean = States(*(a[: len(knots_ns)].copy() for a in states))
    first = first_prior(States(*(a[:1] for a in mean)), settings.initialization.bias_sigma)
    size = DOF * len(knots_ns)
    rows = [np.pad(first.R, [(0, 0), (0, size - DOF)]), np.zeros((6, size))]
    rows[1][:, VARPI:VARPI_DOT] = np.diag(1.0 / np.repeat(_COMMON_SIGMA, 3))
    for k, dt in enumerate(np.diff(knots_ns) * 1e-9):
        change = np.zeros((12, size))
        begin = DOF * k
        before = change[:, begin : begin + VARPI_DOT]
        after = change[:, begin + DOF : begin + DOF + VARPI_DOT]
        tremor, creep = np.sqrt(2.0) * np.repeat(TREMOR, 3), np.sqrt(dt) * np.repeat(CREEP, 3)
        after[:6, VARPI:], before[:6, VARPI:] = np.diag(1.0 / tremor), np.diag(-1.0 / tremor)
        after[6:, :VARPI], before[6:, :VARPI] = np.diag(1.0 / creep), np.diag(-1.0 / creep)
        after[6:, VARPI:] = before[6:, VARPI:] = np.diag(-0.5 * dt / creep)
        rows.append(change)
    R = np.concatenate(rows)
    return Prior(R, R.T @ R, np.append(first.r_0, np.zeros(len(R) - len(first.r_0))), mean)


def _mean(stream: RecordArray, start_ns: int, end_ns: int) -> FloatArray:
    return np.asarray(around(stream, start_ns, end_ns)["xyz"].mean(axis=0))


def _stationary_states(omega: FloatArray, force: FloatArray, settings: Settings, count: int) -> States:
    """One pose for `count` knots, with gravity opposite to the mean specific force `force` (3,).

    The accelerometer's bias explains the difference in magnitude; the gyroscope's bias is the mean angular
    rate `omega` (3,).
    """
    gravity = float(np.linalg.norm(settings.window.gravity_w))
    length = float(np.linalg.norm(force))
    bias = np.concatenate([omega, force * (1.0 - gravity / length)])
    return States(
        np.tile(upright(-force), (count, 1, 1)),
        np.zeros((count, 3)),
        np.zeros((count, 2, 6)),
        np.tile(bias, (count, 1)),
    )
