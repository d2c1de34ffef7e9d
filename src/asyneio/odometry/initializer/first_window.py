"""The first window of a segment, however its motion was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.problem.problem import Prior, States
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.estimation.solver.optimizer import Solution
from asyneio.estimation.window import Window
from asyneio.odometry.buffer import MeasurementBuffer, around
from asyneio.odometry.settings import Settings
from asyneio.state import BIAS, DOF, PHI, RHO
from asyneio.types import BoolArray, FloatArray, IntArray

#: The frame is defined by the first knot's position and yaw: as tight as rounding allows.
_GAUGE_SIGMA = 1e-4
#: Roll and pitch are what the measurements say; the prior only keeps them from running away.
_TILT_SIGMA = 0.5
_NO_TRACKS = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class Start:
    """A started window with the solution it came from."""

    window: Window
    solution: Solution


def filled_window(
    intake: MeasurementBuffer,
    settings: Settings,
    knots_ns: IntArray,
    states: States,
    bad_tracks: IntArray = _NO_TRACKS,
    still: BoolArray | None = None,
    prior: Prior | None = None,
) -> Window:
    """A window with all knots (K), their measurements and landmarks.

    Args:
        intake: where measurements come from.
        settings: of the odometry.
        knots_ns: (K,) times of the knots.
        states: their first states.
        bad_tracks: ids of tracks to leave out.
        still: (K-1,) which intervals are at rest; None for none.
        prior: on the first knots; None where nothing is known but the biases, near zero.
    """

    def knot(k: int) -> States:
        return states.chosen(slice(k, k + 1)).copied()

    known = first_prior(knot(0), settings.start.bias_sigma) if prior is None else prior
    window = Window(settings.window, int(knots_ns[0]), knot(0), known)
    for k in range(1, len(knots_ns)):
        span = (int(knots_ns[k - 1]), int(knots_ns[k]))
        window.extend(
            span[1],
            knot(k),
            around(intake.gyroscope, *span),
            around(intake.accelerometer, *span),
            _without(intake.observations.between(*span), bad_tracks),
            still is not None and bool(still[k - 1]),
        )
    window.add_landmarks()
    return window


def _without(seen: TrackObservations, tracks: IntArray) -> TrackObservations:
    return seen.chosen(~np.isin(seen.track, tracks))


def first_prior(first: States, bias_sigma: FloatArray) -> Prior:
    """Prior on the first knot: position and yaw define the frame, tilt is free, biases are near zero.

    Args:
        first: states of that knot, K = 1.
        bias_sigma: (6,) of [b_g, b_a] around zero [rad/s, m/s^2].
    """
    R = np.zeros((12, DOF))
    tilt_yaw = np.array([_TILT_SIGMA, _TILT_SIGMA, _GAUGE_SIGMA])
    R[:3, PHI : PHI + 3] = first.C[0] / tilt_yaw[:, None]
    R[3:6, RHO : RHO + 3] = np.eye(3) / _GAUGE_SIGMA
    R[6:, BIAS:] = np.diag(1.0 / bias_sigma)
    r_0 = np.zeros(12)
    r_0[6:] = first.bias[0] / bias_sigma
    return Prior(R, R.T @ R, r_0, first)
