# SPDX-License-Identifier: Apache-2.0
"""The trajectory of a window without a kinematic prior: every knot propagated by its increments (29)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import TrajectoryError
from asyneio.estimation.problem.problem import States
from asyneio.factors.preintegration import Increment, Knot, propagated_pose, propagated_pose_jacobian
from asyneio.inertial.increments import Preintegration
from asyneio.state import BIAS, DOF, EPS, NU
from asyneio.types import FloatArray, IntArray

#: Step [s] of the differences that give a rate: increments are smooth, and exact to rounding.
_RATE_STEP_S = 1e-3


def rate_at_end(preintegration: Preintegration, bias: FloatArray) -> FloatArray:
    """Angular velocity (3,) in the body at the end of an interval [rad/s], from the increments.

    `bias` (6,): present biases. The differences are one-sided and of second order.
    """
    step = min(_RATE_STEP_S, 0.25 * preintegration.duration)
    times = preintegration.duration - step * np.array([2.0, 1.0, 0.0])
    C = preintegration.at(np.maximum(times, 0.0)).C
    turns = Rotation.from_matrix(C[:-1].transpose(0, 2, 1) @ C[1:]).as_rotvec()
    rate = (1.5 * turns[1] - 0.5 * turns[0]) / step
    return np.asarray(rate - (bias[:3] - preintegration.bias[:3]))


class PropagatedTrajectory:
    """Poses, velocities and their covariance at any int64 nanosecond between the first and last knot.

    The state at a time follows from the knot before it and the increments alone: at the end of an interval it
    agrees with the next knot up to the residual of (30). Every query takes times (N,) and raises
    TrajectoryError for a time outside the knots.
    """

    def __init__(
        self,
        t_ns: IntArray,
        states: States,
        preintegrations: Sequence[Preintegration],
        gravity_w: FloatArray,
        covariance: Callable[[int], FloatArray],
        inflation: float,
    ) -> None:
        """A trajectory through K knots.

        Args:
            t_ns: (K,) times of the knots.
            states: of the knots.
            preintegrations: increments of the K-1 intervals.
            gravity_w: (3,) [m/s^2].
            covariance: gives the covariance (24,24) of the errors of knot k.
            inflation: factor on the noise of the samples.
        """
        self._t_ns = t_ns.copy()
        self._states = states.copied()
        self._preintegrations = list(preintegrations)
        self._gravity_w = gravity_w
        self._covariance = covariance
        self._inflation = inflation

    def pose(self, t_ns: IntArray) -> FloatArray:
        """Poses `T_w_b` (N,4,4)."""
        out = np.tile(np.eye(4), (len(t_ns), 1, 1))
        for n, (k, increment) in enumerate(self._increments(t_ns)):
            C, r = np.empty((3, 3)), np.empty(3)
            propagated_pose(self._knot(k), increment, self._gravity_w, C, r)
            out[n, :3, :3], out[n, :3, 3] = C, r
        return out

    def velocity(self, t_ns: IntArray) -> FloatArray:
        """Velocity (N,3) of the body's origin in the world [m/s]."""
        out = np.empty((len(t_ns), 3))
        for n, (k, at) in enumerate(self._increments(t_ns)):
            C, _, nu, bias = self._knot(k)
            out[n] = C @ (nu + at.nu + at.d_bias[3:6] @ (bias - at.bias)) + self._gravity_w * at.dt
        return out

    def covariance(self, t_ns: IntArray) -> FloatArray:
        """Covariance (N,6,6) of the pose errors eps, on the right, in the body (43).

        The propagated covariance of the knot, plus that of the increments. The next knot is not used, so just
        before it the result is larger than the covariance of that knot.
        """
        out = np.empty((len(t_ns), 6, 6))
        d_eps, d_nu, d_bias = np.empty((6, 6)), np.empty((6, 3)), np.empty((6, 6))
        for n, (k, increment) in enumerate(self._increments(t_ns)):
            propagated_pose_jacobian(self._knot(k), increment, d_eps, d_nu, d_bias)
            J = np.zeros((6, DOF))
            J[:, EPS : EPS + 6], J[:, NU : NU + 3], J[:, BIAS:] = d_eps, d_nu, d_bias
            # [phi, r] of the increments; r is in the frame of the knot, the error in that of the query.
            noise = self._inflation**2 * self._preintegrations[k].covariance(increment.dt)
            to_query = np.zeros((6, 9))
            to_query[:3, :3], to_query[3:, 6:] = np.eye(3), increment.C.T
            out[n] = J @ self._covariance(k) @ J.T + to_query @ noise @ to_query.T
        return out

    def _knot(self, k: int) -> Knot:
        s = self._states
        return Knot(s.C[k], s.r[k], s.varpi[k, 0, 3:], s.bias[k])

    def _increments(self, t_ns: IntArray) -> list[tuple[int, Increment]]:
        """For every time, the index of the knot before it and the increment since that knot."""
        times = np.asarray(t_ns, dtype=np.int64)
        first, last = int(self._t_ns[0]), int(self._t_ns[-1])
        if len(times) and not first <= times.min() <= times.max() <= last:
            raise TrajectoryError(
                f"found times {times.min()} .. {times.max()} ns; "
                f"expected times within the knots, {first} .. {last} ns"
            )
        found = []
        for time in times:
            k = min(int(np.searchsorted(self._t_ns, time, side="right")) - 1, len(self._t_ns) - 2)
            rule = self._preintegrations[k]
            tau = min(float(time - self._t_ns[k]) * 1e-9, rule.duration)
            C, nu, r, d_bias = (part[0] for part in rule.at(np.array([tau])))
            found.append((k, Increment(C, nu, r, d_bias, rule.bias, tau)))
        return found
