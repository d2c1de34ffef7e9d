# SPDX-License-Identifier: Apache-2.0
"""The first window of a segment, whichever method found its motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.problem.problem import Prior, States
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.estimation.solver.optimizer import Solution
from asyneio.estimation.window import Window
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.settings import Settings
from asyneio.state import BIAS, DOF, PHI, RHO
from asyneio.types import BoolArray, FloatArray, IntArray

#: The first knot's position and yaw define the world frame: as small as rounding allows.
_GAUGE_SIGMA = 1e-4
#: The measurements determine roll and pitch; the prior only prevents divergence.
_TILT_SIGMA = 0.5
_NO_TRACKS = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class FirstWindow:
    """The first window and the solution of its joint optimisation.

    `scale_sigma`: relative standard deviation of its scale, 0 where the first state was known, stationary or
    given. `object_in_view`: many tracks contradict the solution.
    """

    window: Window
    solution: Solution
    scale_sigma: float = 0.0
    object_in_view: bool = False


def filled_window(
    buffer: MeasurementBuffer,
    settings: Settings,
    knots_ns: IntArray,
    states: States,
    outliers: IntArray = _NO_TRACKS,
    stationary: BoolArray | None = None,
    prior: Prior | None = None,
) -> Window:
    """A window with K knots, their measurements and landmarks.

    Args:
        buffer: the measurements.
        settings: of the odometry.
        knots_ns: (K,) times of the knots.
        states: initial guess of the knots.
        outliers: ids of the tracks to leave out.
        stationary: (K-1,) which intervals are stationary; None for none.
        prior: on the first knots; None for the prior of `first_prior`.
    """

    def knot(k: int) -> States:
        """The states of knot `k` alone, as a copy."""
        return states.chosen(slice(k, k + 1)).copied()

    known = first_prior(knot(0), settings.initialization.bias_sigma) if prior is None else prior
    window = Window(settings.window, int(knots_ns[0]), knot(0), known)
    for k in range(1, len(knots_ns)):
        interval = buffer.interval(int(knots_ns[k - 1]), int(knots_ns[k]))
        observations = _without(interval.observations, outliers)
        zero_velocity = stationary is not None and bool(stationary[k - 1])
        window.extend(interval.end_ns, knot(k), *interval.streams, observations, zero_velocity)
    window.add_landmarks()
    return window


def _without(seen: TrackObservations, tracks: IntArray) -> TrackObservations:
    return seen.chosen(~np.isin(seen.track, tracks))


def first_prior(first: States, bias_sigma: FloatArray) -> Prior:
    """Prior on the first knot: position and yaw define the world frame, tilt is free, biases are near zero.

    Args:
        first: states of the first knot, K = 1.
        bias_sigma: (6,) standard deviations of [b_g, b_a] around zero [rad/s, m/s^2].
    """
    R = np.zeros((12, DOF))
    tilt_yaw = np.array([_TILT_SIGMA, _TILT_SIGMA, _GAUGE_SIGMA])
    R[:3, PHI : PHI + 3] = first.C[0] / tilt_yaw[:, None]
    R[3:6, RHO : RHO + 3] = np.eye(3) / _GAUGE_SIGMA
    R[6:, BIAS:] = np.diag(1.0 / bias_sigma)
    r_0 = np.zeros(12)
    r_0[6:] = first.bias[0] / bias_sigma
    return Prior(R, R.T @ R, r_0, first)
