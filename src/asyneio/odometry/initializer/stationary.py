"""Start at rest: a still IMU tells gravity's direction and the gyroscope's bias; velocity is zero.

No feature is needed: landmarks come when motion brings parallax, and scale with them, from the accelerometer.
Of the accelerometer's bias, rest shows only the part along gravity. The other two cannot be told from tilt:
both stay as uncertain as the prior on the bias leaves them, and correlated, in the window's covariance.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.linearization.zero_velocity import CREEP, TREMOR
from asyneio.estimation.problem.problem import Prior, States
from asyneio.geometry.gravity import upright
from asyneio.inertial.gravity_witness import FORCE_RATIO
from asyneio.odometry.buffer import MeasurementBuffer, around
from asyneio.odometry.initializer.checks import solution_refusal
from asyneio.odometry.initializer.first_window import Start, filled_window, first_prior
from asyneio.odometry.outliers import optimize_without_outliers
from asyneio.odometry.propagation import predict_knot
from asyneio.odometry.settings import Settings
from asyneio.odometry.stationary import Rest
from asyneio.state import DOF, VARPI, VARPI_DOT
from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray, RecordArray

#: The end of a rest is noticed late: so much of what was judged to be at rest before it [ns] is doubted.
_DOUBT_NS = 200_000_000
#: Turn rate [rad/s] and velocity [m/s] that a short rest may hide: tracks at rest for 0.2 s exclude more.
_COMMON_SIGMA = (1e-2, 1e-2)


def static_start(intake: MeasurementBuffer, settings: Settings, rest: Rest) -> Start | str:
    """A window that begins at rest, or the reason, in words, why not yet.

    While the rest goes on, a long one is enough. Once it is over, the window reaches from the rest into the
    motion, and the tracks must confirm both.
    """
    if intake.end_ns is None or min(len(intake.gyroscope), len(intake.accelerometer)) < 2:
        return "waiting for inertial samples"
    still_s = (rest.until_ns - rest.since_ns) / NS_PER_S
    if not rest.over and still_s < settings.start.min_seconds:
        return f"at rest: averaging the IMU, {still_s:.2f} s of {settings.start.min_seconds:.2f} s"
    knots_ns = _knot_times(intake, settings, rest)
    still = _at_rest(knots_ns, rest)
    if not still.any():
        return "no inertial samples that cover two knots at rest"
    try:
        states = _first_states(intake, settings, knots_ns, still)
        if not rest.over:
            window = filled_window(intake, settings, knots_ns, states, still=still)
            return Start(window, window.optimize(settings.start.optimizer))
        prior = _prior(states, knots_ns[: 1 + np.count_nonzero(still)], settings)
        window = filled_window(intake, settings, knots_ns, states, prior=prior)
        if len(window.landmarks) < settings.start.min_landmarks:
            return f"too few feature tracks: {len(window.landmarks)} of {settings.start.min_landmarks}"
        solution, outliers = optimize_without_outliers(window, settings.start.optimizer, rounds=4)
    except (EstimationError, InertialError) as error:
        return str(error)
    reason = solution_refusal(solution, settings)
    if reason:
        return reason
    intake.refuse(outliers)
    return Start(window, solution)


def _knot_times(intake: MeasurementBuffer, settings: Settings, rest: Rest) -> IntArray:
    """Knots that end with the newest packet and begin at rest; at most a window of rest."""
    assert intake.end_ns is not None
    first = max(int(intake.gyroscope["t_ns"][0]), int(intake.accelerometer["t_ns"][0]), rest.since_ns)
    first = max(first, rest.until_ns - round(settings.window_s * NS_PER_S))
    intervals = max((intake.end_ns - first) // settings.knot_interval_ns, 0)
    return intake.end_ns - settings.knot_interval_ns * np.arange(intervals, -1, -1, dtype=np.int64)


def _at_rest(knots_ns: IntArray, rest: Rest) -> BoolArray:
    """Which intervals (K-1,) between knots (K,) are at rest: of a rest that is over its last part only where
    there is no other."""
    end_ns = knots_ns[1:]
    still = end_ns <= rest.until_ns - _DOUBT_NS * rest.over
    still[:1] = end_ns[:1] <= rest.until_ns
    return np.asarray(still)


def _first_states(
    intake: MeasurementBuffer, settings: Settings, knots_ns: IntArray, still: BoolArray
) -> States:
    """At rest one pose, from there on dead reckoning."""
    resting = 1 + int(np.count_nonzero(still))
    streams = intake.gyroscope, intake.accelerometer
    turn, force = (_mean(stream, int(knots_ns[0]), int(knots_ns[resting - 1])) for stream in streams)
    ratio = float(np.linalg.norm(force) / np.linalg.norm(settings.window.gravity_w))
    if not 1.0 / FORCE_RATIO < ratio < FORCE_RATIO:
        raise EstimationError(
            f"at rest the accelerometer reads {ratio:.3g} times gravity: another unit or full-scale range"
        )
    states = _states_at_rest(turn, force, settings, resting)
    for from_ns, to_ns in pairwise(knots_ns[resting - 1 :].tolist()):
        knot = predict_knot(states, from_ns, to_ns, streams, settings.window.gravity_w)
        states = states.joined(knot)
    return states


def _prior(states: States, knots_ns: IntArray, settings: Settings) -> Prior:
    """Prior on the knots (m,) at rest: all they know, and that they do not move.

    Samples and tracks of so short a time cannot tell rest from slow uniform motion, so the velocity that all
    these knots share is less certain than that it is the same in all of them.
    """
    rest = states.chosen(slice(len(knots_ns))).copied()
    first = first_prior(rest.chosen(slice(1)), settings.start.bias_sigma)
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
    return Prior(R, R.T @ R, np.append(first.r_0, np.zeros(len(R) - len(first.r_0))), rest)


def _mean(stream: RecordArray, start_ns: int, end_ns: int) -> FloatArray:
    return np.asarray(around(stream, start_ns, end_ns)["xyz"].mean(axis=0))


def _states_at_rest(turn: FloatArray, force: FloatArray, settings: Settings, count: int) -> States:
    """One pose for all knots: gravity opposite to the mean specific force `force` (3,), which in length may
    differ from it by the accelerometer's bias; the mean rate `turn` (3,) is the gyroscope's."""
    gravity = float(np.linalg.norm(settings.window.gravity_w))
    length = float(np.linalg.norm(force))
    bias = np.concatenate([turn, force * (1.0 - gravity / length)])
    return States(
        np.tile(upright(-force), (count, 1, 1)),
        np.zeros((count, 3)),
        np.zeros((count, 2, 6)),
        np.tile(bias, (count, 1)),
    )
