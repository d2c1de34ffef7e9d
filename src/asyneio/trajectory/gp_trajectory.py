# SPDX-License-Identifier: Apache-2.0
"""Continuous-time trajectory: state and covariance at any instant between its knots.

| symbol    | meaning                                      | shape   | unit, frame            |
|-----------|----------------------------------------------|---------|------------------------|
| T_w_b     | pose, maps body to world coordinates         | (4,4)   | m                      |
| varpi     | generalised velocity [omega, nu]             | (6,)    | rad/s, m/s in the body |
| varpi_dot | its derivative in time; none under WNOA      | (6,)    | body                   |
| gamma     | [xi, xi_dot, xi_ddot] around the knot before | (18,)   | tangent space of T_k   |
| P         | joint covariance of the two knots' errors    | (36,36) | body of each knot      |

The state at t is a function of the two knots around it, through gamma (20), so its covariance is

    J P J^T + G (K x Q_c) G^T,

J its exact Jacobian with respect to the knots, G that with respect to gamma, and K the covariance that the
motion prior leaves between two perfectly known knots (docs/derivations/motion-prior.md).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from asyneio.errors import TrajectoryError
from asyneio.jit import njit
from asyneio.state import DOF, KINEMATIC_DOF, KINEMATIC_LOCAL_DOF
from asyneio.trajectory.interpolation import (
    interval_chain,
    interval_local,
    query_pose,
    query_pose_jacobian,
    query_rates,
    query_rates_jacobian,
)
from asyneio.trajectory.model import WNOJ_SE3, MotionModel
from asyneio.trajectory.motion_prior import conditional_covariance, interpolation_weights_many
from asyneio.types import FloatArray, IntArray

#: How far from orthonormal a knot's rotation may be.
_ORTHONORMAL = 1e-6

#: Joint covariance (48,48) of knots k and k+1, each [eps, varpi, varpi_dot, b_g, b_a], for the index k.
JointCovariance = Callable[[int], FloatArray]


class GPTrajectory:
    """Trajectory through knots under a motion prior (13), queried at int64 nanoseconds.

    Every query takes one time or an array (N,) of them, in any order; results have no leading axis for a
    single time. Every query raises TrajectoryError for a time outside the knots or not an integer.
    Two neighbouring knots must be less than half a turn apart, where the logarithm of a rotation is unique.

    Laws (tested): at a knot every query returns the knot; the derivative in time of the pose is the
    generalised velocity, that of the generalised velocity the generalised acceleration, exactly (8), (9).

    Under white noise on acceleration the knots have no varpi_dot: the values passed are ignored, and
    accelerations are the derivative of the interpolated velocity. They jump at the knots, where a query
    returns the value of the following interval.
    """

    def __init__(
        self,
        t_ns: IntArray,
        C: FloatArray,
        r: FloatArray,
        varpi: FloatArray,
        root_density: FloatArray,
        bias: FloatArray | None = None,
        joint_covariance: JointCovariance | None = None,
        motion_model: MotionModel = WNOJ_SE3,
    ) -> None:
        """Take a copy of the knots.

        Args:
            t_ns: times (K,) [ns], ascending, K >= 2.
            C: rotations (K,3,3), body to world.
            r: positions (K,3) in the world [m].
            varpi: (K,2,6), [varpi, varpi_dot] in the body.
            root_density: (6,) square root of the prior's power spectral density, rad/s^3/sqrt(Hz) for the
                first three axes and m/s^3/sqrt(Hz) for the others; of acceleration under WNOA,
                rad/s^2/sqrt(Hz) and m/s^2/sqrt(Hz).
            bias: (K,6) [b_g, b_a] [rad/s, m/s^2].
            joint_covariance: covariance of neighbouring knots; needed by `covariance` only.
            motion_model: the prior and its space.

        Raises:
            TrajectoryError: a shape, a time or a value is not as above.
        """
        self._t_ns = _checked_knot_times(t_ns)
        knots = len(self._t_ns)
        self._C = _checked("C", C, (knots, 3, 3))
        self._r = _checked("r", r, (knots, 3))
        self._varpi = _checked("varpi", varpi, (knots, 2, 6))
        self._root_density = _checked("root_density", root_density, (6,))
        self._bias = None if bias is None else _checked("bias", bias, (knots, 6))
        self._joint_covariance = joint_covariance
        self._prior, self._space = motion_model
        _check_rotations(self._C)
        if self._root_density.min() <= 0.0:
            raise TrajectoryError(
                f"root_density is {self._root_density.tolist()}; expected six positive numbers"
            )
        self._dt = np.diff(self._t_ns) * 1e-9
        self._local = np.empty((len(self._dt), 5, 6))
        _all_local(self._C, self._r, self._varpi, self._space, self._local)

    @property
    def t_ns(self) -> IntArray:
        """Times (K,) of the knots [ns]."""
        return self._t_ns.copy()

    def pose(self, t_ns: IntArray | int) -> FloatArray:
        """Poses `T_w_b` (N,4,4) or (4,4) (58)."""
        times, scalar = self._checked_times(t_ns)
        C, r = self._poses(times)
        out = np.zeros((len(times), 4, 4))
        out[:, :3, :3], out[:, :3, 3], out[:, 3, 3] = C, r, 1.0
        return _unwrapped(out, scalar)

    def generalized_velocity(self, t_ns: IntArray | int) -> FloatArray:
        """`[omega, nu]` (N,6) or (6,) in the body [rad/s, m/s] (8)."""
        times, scalar = self._checked_times(t_ns)
        return _unwrapped(self._rates(times)[:, 0], scalar)

    def generalized_acceleration(self, t_ns: IntArray | int) -> FloatArray:
        """`[omega_dot, nu_dot]` (N,6) or (6,) in the body [rad/s^2, m/s^2], the exact form of (71)."""
        times, scalar = self._checked_times(t_ns)
        return _unwrapped(self._rates(times)[:, 1], scalar)

    def angular_velocity(self, t_ns: IntArray | int) -> FloatArray:
        """Angular velocity (N,3) or (3,) with respect to the world, in the body [rad/s]."""
        return self.generalized_velocity(t_ns)[..., :3]

    def velocity(self, t_ns: IntArray | int) -> FloatArray:
        """Velocity `C nu` (N,3) or (3,) of the body's origin in the world [m/s]."""
        times, scalar = self._checked_times(t_ns)
        C, _ = self._poses(times)
        return _unwrapped(np.einsum("nij,nj->ni", C, self._rates(times)[:, 0, 3:]), scalar)

    def acceleration(self, t_ns: IntArray | int) -> FloatArray:
        """Acceleration `C (nu_dot + omega x nu)` (N,3) or (3,) in the world, without gravity [m/s^2] (5)."""
        times, scalar = self._checked_times(t_ns)
        C, _ = self._poses(times)
        rates = self._rates(times)
        in_body = rates[:, 1, 3:] + np.cross(rates[:, 0, :3], rates[:, 0, 3:])
        return _unwrapped(np.einsum("nij,nj->ni", C, in_body), scalar)

    def bias(self, t_ns: IntArray | int) -> FloatArray:
        """Biases `[b_g, b_a]` (N,6) or (6,) [rad/s, m/s^2], linear between the knots.

        Raises:
            TrajectoryError: there are no biases, or a time is outside the knots.
        """
        if self._bias is None:
            raise TrajectoryError(
                "this trajectory was built without biases; expected `bias` (K,6) beside the knots"
            )
        times, scalar = self._checked_times(t_ns)
        k, tau = self._interval(times)
        alpha = (tau / self._dt[k])[:, None]
        return _unwrapped((1.0 - alpha) * self._bias[k] + alpha * self._bias[k + 1], scalar)

    def covariance(self, t_ns: IntArray | int) -> FloatArray:
        """Covariance (N,18,18) or (18,18) of the errors [eps, varpi, varpi_dot]; at a knot, that of the knot.

        eps perturbs the pose on the right, in the body (43); units are those of the state. Under white noise
        on acceleration varpi_dot is the derivative of the interpolated velocity, and its covariance comes
        from the errors of the knots alone: under the prior the acceleration itself has no finite variance.

        Raises:
            TrajectoryError: there is no source of joint covariances, it returns an unusable matrix, or a
                time is outside the knots.
        """
        times, scalar = self._checked_times(t_ns)
        k, tau = self._interval(times)
        weights = self._weights(k, tau)
        out = np.empty((len(times), KINEMATIC_DOF, KINEMATIC_DOF))
        for interval in np.unique(k):
            chosen = np.flatnonzero(k == interval)
            chain = np.empty((KINEMATIC_LOCAL_DOF, KINEMATIC_LOCAL_DOF))
            pair = slice(interval, interval + 2)
            C, r, varpi = self._C[pair], self._r[pair], self._varpi[pair]
            interval_chain(C[0], r[0], varpi[0], C[1], r[1], varpi[1], self._space, chain)
            _posterior(
                self._local[interval],
                chain,
                self._kinematic_covariance(int(interval)),
                self._root_density,
                weights[chosen],
                tau[chosen],
                self._dt[interval],
                (self._prior, self._space),
                chosen,
                out,
            )
        return _unwrapped(out, scalar)

    def _kinematic_covariance(self, interval: int) -> FloatArray:
        """Joint covariance (36,36) of the two knots without their biases."""
        if self._joint_covariance is None:
            raise TrajectoryError(
                "this trajectory was built without covariances; expected `joint_covariance`"
            )
        joint = np.asarray(self._joint_covariance(interval), dtype=np.float64)
        if joint.shape != (2 * DOF, 2 * DOF) or not np.isfinite(joint).all():
            raise TrajectoryError(
                f"the joint covariance of knots {interval} and {interval + 1} has shape {joint.shape} and "
                f"{np.count_nonzero(~np.isfinite(joint))} entries that are not finite; expected a finite "
                f"({2 * DOF},{2 * DOF}) matrix"
            )
        kept = np.concatenate([np.arange(KINEMATIC_DOF), DOF + np.arange(KINEMATIC_DOF)])
        return np.ascontiguousarray(joint[np.ix_(kept, kept)])

    def _checked_times(self, t_ns: IntArray | int) -> tuple[IntArray, bool]:
        """Times as (N,) int64, and whether it was a single one."""
        times = np.asarray(t_ns)
        if times.ndim > 1 or times.dtype.kind not in "iu":
            raise TrajectoryError(
                f"found query times of type {times.dtype} and shape {times.shape}; "
                "expected int64 nanoseconds, a single time or (N,)"
            )
        flat = np.atleast_1d(times).astype(np.int64)
        first, last = int(self._t_ns[0]), int(self._t_ns[-1])
        if len(flat) and not first <= flat.min() <= flat.max() <= last:
            raise TrajectoryError(
                f"found query times {flat.min()} .. {flat.max()} ns; "
                f"expected times within the knots, {first} .. {last} ns"
            )
        return flat, times.ndim == 0

    def _interval(self, times: IntArray) -> tuple[IntArray, FloatArray]:
        """Index (N,) of the knot before, and seconds (N,) after it; the last knot ends the last interval."""
        k: IntArray = np.minimum(np.searchsorted(self._t_ns, times, side="right") - 1, len(self._dt) - 1)
        return k, np.asarray((times - self._t_ns[k]) * 1e-9, dtype=np.float64)

    def _weights(self, k: IntArray, tau: FloatArray) -> FloatArray:
        weights = np.empty((len(k), 3, 5))
        interpolation_weights_many(tau, self._dt[k], self._prior, weights)
        return weights

    def _poses(self, times: IntArray) -> tuple[FloatArray, FloatArray]:
        k, tau = self._interval(times)
        C, r = np.empty((len(k), 3, 3)), np.empty((len(k), 3))
        _query_poses(self._C, self._r, self._local, k, self._weights(k, tau), self._space, C, r)
        return C, r

    def _rates(self, times: IntArray) -> FloatArray:
        """[varpi, varpi_dot] (N,2,6)."""
        k, tau = self._interval(times)
        out = np.empty((len(k), 2, 6))
        _query_rates(self._local, k, self._weights(k, tau), self._space, out)
        return out


def _checked_knot_times(t_ns: IntArray) -> IntArray:
    times = np.asarray(t_ns)
    if times.ndim != 1 or len(times) < 2 or times.dtype.kind not in "iu":
        raise TrajectoryError(
            f"knot times have type {times.dtype} and shape {times.shape}; "
            "expected int64 nanoseconds (K,), K >= 2"
        )
    times = times.astype(np.int64)
    steps = np.diff(times)
    if steps.min() <= 0:
        k = int(np.argmin(steps))
        raise TrajectoryError(
            f"knot {k + 1} at {times[k + 1]} ns does not come after knot {k} at {times[k]} ns; "
            "expected ascending times"
        )
    return times


def _checked(name: str, value: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """A contiguous copy of the right shape with finite numbers only."""
    array = np.array(value, dtype=np.float64, order="C")
    if array.shape != shape:
        raise TrajectoryError(f"{name} has shape {array.shape}; expected {shape}")
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        raise TrajectoryError(f"{name}{where} is {array[tuple(where)]}; expected finite numbers")
    return array


def _check_rotations(C: FloatArray) -> None:
    error = np.abs(C @ C.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = (error > _ORTHONORMAL) | (np.linalg.det(C) < 0.0)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise TrajectoryError(
            f"C[{k}] is off orthonormality by {error[k]:.1e} with determinant {np.linalg.det(C[k]):+.3f}; "
            f"expected a rotation to within {_ORTHONORMAL:.0e}"
        )


def _unwrapped(result: FloatArray, scalar: bool) -> FloatArray:
    return result[0] if scalar else result


@njit(cache=True, nogil=True)
def _all_local(C: FloatArray, r: FloatArray, varpi: FloatArray, space: int, out: FloatArray) -> None:
    """`interval_local` of every interval: `out` (K-1,5,6)."""
    for k in range(out.shape[0]):
        interval_local(C[k], r[k], varpi[k], C[k + 1], r[k + 1], varpi[k + 1], space, out[k])


@njit(cache=True, nogil=True)
def _query_poses(
    C: FloatArray,
    r: FloatArray,
    local: FloatArray,
    k: IntArray,
    weights: FloatArray,
    space: int,
    C_out: FloatArray,
    r_out: FloatArray,
) -> None:
    for n in range(k.shape[0]):
        query_pose(C[k[n]], r[k[n]], local[k[n]], weights[n, 0], space, C_out[n], r_out[n])


@njit(cache=True, nogil=True)
def _query_rates(local: FloatArray, k: IntArray, weights: FloatArray, space: int, out: FloatArray) -> None:
    for n in range(k.shape[0]):
        query_rates(local[k[n]], weights[n], space, out[n])


@njit(cache=True, nogil=True)
def _posterior(
    local: FloatArray,
    chain: FloatArray,
    P: FloatArray,
    root_density: FloatArray,
    weights: FloatArray,
    tau: FloatArray,
    dt: float,
    motion_model: tuple[int, int],
    index: IntArray,
    out: FloatArray,
) -> None:
    """`out[index]` (N,18,18) for the times of one interval: J P J^T + G (K x Q_c) G^T."""
    to_local = np.zeros((KINEMATIC_DOF, KINEMATIC_LOCAL_DOF))
    G = np.zeros((KINEMATIC_DOF, KINEMATIC_DOF))
    K = np.empty((3, 3))
    spread = np.empty((KINEMATIC_DOF, KINEMATIC_DOF))
    prior, space = motion_model
    for n in range(index.shape[0]):
        _state_jacobians(local, weights[n], space, G, to_local)
        conditional_covariance(tau[n], dt, prior, K)
        for i in range(KINEMATIC_DOF):
            for a in range(3):
                for m in range(6):
                    s = 0.0
                    for c in range(3):
                        s += G[i, 6 * c + m] * K[c, a]
                    spread[i, 6 * a + m] = s * root_density[m] * root_density[m]
        J = np.dot(to_local, chain)
        both = np.dot(J, np.dot(P, J.T)) + np.dot(spread, G.T)
        out[index[n]] = 0.5 * (both + both.T)


@njit(cache=True, nogil=True)
def _state_jacobians(
    local: FloatArray, weights: FloatArray, space: int, G: FloatArray, to_local: FloatArray
) -> None:
    """Derivatives of [eps, varpi, varpi_dot] at a query time, exact (62)-(63), (68)-(74):

    `G` (18,18) with respect to gamma, `to_local` (18,36) to the interval's local coordinates.
    """
    unused = np.empty((2, 6))
    d_eps = np.empty((6, 6))
    d_xi = np.empty((6, 6))
    query_pose_jacobian(local, weights[0], space, d_eps, d_xi)
    query_rates_jacobian(local, weights, space, unused, G[6:])
    G[:6] = 0.0
    G[:6, :6] = d_xi
    to_local[:] = 0.0
    to_local[:6, :6] = d_eps
    for i in range(KINEMATIC_DOF):
        for b in range(5):
            for j in range(6):
                s = 0.0
                for a in range(3):
                    s += G[i, 6 * a + j] * weights[a, b]
                to_local[i, 6 + 6 * b + j] = s
