"""A smooth path through recorded poses that also agrees with the IMU: weighted least squares of splines.

Position and quaternion are uniform quintic B-splines. With q(t) and p(t) of a body (the IMU) in the world,

    gyroscope      2 vec(q^-1 q') / |q|^2 + b_g        accelerometer    C(q)^T (p'' - g) + b_a
    position       p(t + d)                            orientation      q(t + d)

where d is what the clock of the IMU is ahead of that of the poses, g is gravity in the world of the poses, and
the biases b_g, b_a are piecewise linear and wander no more than the walks of the IMU's noise. Control points,
d, g and biases are found together by Gauss-Newton steps; the noise of each sensor is taken from what is left
over, because vibration makes it many times that of the data sheet. The normal equations are banded but for
d, g and the biases, which are eliminated last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.spatial.transform import Rotation, Slerp

from asyneio.errors import SimulationError
from asyneio.simulation.path_basis import ACTIVE, DEGREE, UniformKnots
from asyneio.types import NS_PER_S, FloatArray, ImuNoise, IntArray, PoseTrajectory, RecordArray

#: Spacing of the knots with an IMU: motion up to about 15 Hz is followed, what is faster is vibration.
_KNOT_S = 0.025
#: A spline needs some samples of the IMU between two knots.
_SAMPLES_PER_KNOT = 3.0
#: What a good motion-capture system is not better than: m, rad.
_LEAST_POSE_SIGMA = np.array([1e-3, 2e-3])
#: How well gravity [m/s^2] is known beforehand: it may hold an error of the accelerometer's scale.
_GRAVITY, _GRAVITY_SIGMA = 9.81, 0.05
#: How far sensors are off [rad/s, m/s^2], and how far apart two nodes of a bias are [s].
_BIAS_SIGMA, _BIAS_NODE_S = np.array([0.2, 0.5]), 10.0
#: How far clocks are off [s], and how much the length of a quaternion may wander (which does not matter).
_CLOCK_SIGMA, _LENGTH_SIGMA = 0.02, 1e-3
_ITERATIONS = 12
#: Largest change of a control point at which it is over: m, or half a rad.
_CONVERGED = 1e-5
#: Poses that are further off than this many sigmas get less weight (Huber).
_HUBER = 3.0
#: Unknowns of one control point: position, then the quaternion xyzw.
_EACH = 7
#: Unknowns besides control points and biases: d, g.
_COMMON = 4


@dataclass(frozen=True)
class PathResiduals:
    """Root mean squares of what is left over, over all axes together.

    Of gyroscope [rad/s], accelerometer [m/s^2], position [m] and orientation [rad] (per axis).
    """

    gyroscope: float
    accelerometer: float
    position: float
    orientation: float


@dataclass(frozen=True)
class PathFit:
    """What was fitted; seconds since `start_ns` (IMU clock).

    `position` [m] and `quaternion` (xyzw, of any length near one) are splines of the IMU in the world of the
    poses. `gravity` (3,) [m/s^2] is in that world; `clock_offset_s`: t_imu = t_pose + offset. Biases (K,3) are
    linear between `bias_s` (K,).
    """

    start_ns: int
    duration_s: float
    position: BSpline
    quaternion: BSpline
    gravity: FloatArray
    clock_offset_s: float
    bias_s: FloatArray
    bias_gyroscope: FloatArray
    bias_accelerometer: FloatArray
    residuals: PathResiduals


@dataclass(frozen=True)
class _Samples:
    """One sensor: seconds (N,), readings (N,k), and its standard deviations (N,)."""

    t_s: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class _State:
    """Control points (n,7), d, g, and biases (K,3) of both sensors."""

    control: FloatArray
    clock_s: float
    gravity: FloatArray
    biases: FloatArray


class _Normal:
    """Normal equations J^T J x = -J^T r: a band of control points, bordered by the other unknowns."""

    def __init__(self, count: int, others: int) -> None:
        self.band = np.zeros((ACTIVE * _EACH, count * _EACH))
        self.border = np.zeros((count * _EACH, others))
        self.corner = np.zeros((others, others))
        self.right = np.zeros(count * _EACH)
        self.right_others = np.zeros(others)

    def add(self, first: IntArray, J: FloatArray, columns: IntArray, K: FloatArray, r: FloatArray) -> None:
        """Add weighted residuals r (N,k) with Jacobians J (N,k,42) of the control points from `first` (N,)
        on, and K (N,k,c) of the other unknowns `columns` (N,c)."""
        spans, H = _sum_by(first, J)
        for a in range(ACTIVE * _EACH):
            for b in range(a + 1):
                self.band[a - b, spans * _EACH + b] += H[a, b]
        rows = first[:, None] * _EACH + np.arange(ACTIVE * _EACH)
        _scatter(self.right, (rows,), (np.swapaxes(J, 1, 2) @ r[..., None])[..., 0])
        transposed = np.swapaxes(K, 1, 2)
        _scatter(self.border, (rows[:, None, :], columns[:, :, None]), transposed @ J)
        _scatter(self.corner, (columns[:, :, None], columns[:, None, :]), transposed @ K)
        _scatter(self.right_others, (columns,), (transposed @ r[..., None])[..., 0])

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Steps of the control points, flat, and of the others."""
        factor = cholesky_banded(self.band, lower=True)
        both = cho_solve_banded((factor, True), np.column_stack([self.border, self.right]))
        reduced = self.corner - self.border.T @ both[:, :-1]
        others = np.linalg.solve(reduced, -(self.right_others - self.border.T @ both[:, -1]))
        return -both[:, -1] - both[:, :-1] @ others, others


def _scatter(target: FloatArray, index: tuple[IntArray, ...], values: FloatArray) -> None:
    """Add values to the places of an array, which may come more than once."""
    flat = np.ravel_multi_index(np.broadcast_arrays(*index), target.shape)
    target += np.bincount(flat.ravel(), values.ravel(), target.size).reshape(target.shape)


def _sum_by(first: IntArray, J: FloatArray) -> tuple[IntArray, FloatArray]:
    """Distinct `first` (S,) of an ascending (N,), and sums (42,42,S) of J^T J over all of J (N,k,42) of each."""
    begins = np.flatnonzero(np.diff(first, prepend=-1))
    counts = np.diff(begins, append=first.size)
    # As many rows for each as the fullest needs: one product of matrices does all.
    rows = np.zeros((begins.size, int(counts.max()), *J.shape[1:]))
    rows[np.repeat(np.arange(begins.size), counts), np.arange(first.size) - np.repeat(begins, counts)] = J
    rows = rows.reshape(begins.size, -1, J.shape[2])
    return first[begins], np.ascontiguousarray(np.moveaxis(np.swapaxes(rows, 1, 2) @ rows, 0, 2))


def fit_path(
    poses: PoseTrajectory, gyroscope: RecordArray, accelerometer: RecordArray, noise: ImuNoise
) -> PathFit:
    """Fit a path to poses of an IMU and to its samples, over the time that all of them cover.

    Args:
        poses: of the IMU, in a world with z up, in about the clock of the IMU.
        gyroscope: [rad/s], INERTIAL_DTYPE.
        accelerometer: [m/s^2], INERTIAL_DTYPE.
        noise: by the data sheet; its walks bound how biases wander.

    Raises:
        SimulationError: poses and samples have no time in common, or do not agree.
    """
    problem = _Problem.of(poses, gyroscope, accelerometer, noise)
    state = problem.start()
    sigma = problem.first_sigma()
    for _ in range(_ITERATIONS):
        before, state = state, problem.step(state, sigma)
        sigma = problem.sigma_of(state)
        if np.abs(state.control - before.control).max() < _CONVERGED:
            break
    return problem.result(state)


@dataclass(frozen=True)
class _Problem:
    start_ns: int
    knots: UniformKnots
    poses: _Samples
    gyroscope: _Samples
    accelerometer: _Samples
    bias_s: FloatArray
    noise: ImuNoise

    @classmethod
    def of(
        cls, poses: PoseTrajectory, gyroscope: RecordArray, accelerometer: RecordArray, noise: ImuNoise
    ) -> _Problem:
        stamps = poses.t_ns, gyroscope["t_ns"], accelerometer["t_ns"]
        start_ns = max(int(t_ns[0]) for t_ns in stamps)
        duration_s = (min(int(t_ns[-1]) for t_ns in stamps) - start_ns) / NS_PER_S
        if not duration_s > 1.0:
            raise SimulationError("no overlap")
        slowest_s = max(float(np.median(np.diff(t_ns))) for t_ns in stamps[1:]) / NS_PER_S
        step_s = max(_KNOT_S, _SAMPLES_PER_KNOT * slowest_s)
        knots = UniformKnots(step_s, int(np.ceil(duration_s / step_s)))
        quaternion = poses.quaternion / np.linalg.norm(poses.quaternion, axis=1, keepdims=True)
        pose = np.hstack([poses.position, quaternion])
        nodes = int(np.ceil(duration_s / _BIAS_NODE_S)) + 1
        inside = [(t >= start_ns) & (t <= start_ns + duration_s * NS_PER_S) for t in stamps]
        samples = [
            _Samples((t[use] - start_ns) / NS_PER_S, values[use])
            for t, values, use in zip(
                stamps, (pose, gyroscope["xyz"], accelerometer["xyz"]), inside, strict=True
            )
        ]
        return cls(start_ns, knots, *samples, np.arange(nodes) * _BIAS_NODE_S, noise)

    def start(self) -> _State:
        """Control points on the poses, as they would be if all were a straight line between them."""
        t_s = np.clip(self.knots.centres_s, self.poses.t_s[0], self.poses.t_s[-1])
        control = np.empty((t_s.size, _EACH))
        for axis in range(3):
            control[:, axis] = np.interp(t_s, self.poses.t_s, self.poses.values[:, axis])
        quaternion = Slerp(self.poses.t_s, Rotation.from_quat(self.poses.values[:, 3:]))(t_s).as_quat()
        flips = np.concatenate([[1.0], np.sign(np.sum(quaternion[1:] * quaternion[:-1], axis=1))])
        control[:, 3:] = quaternion * np.cumprod(flips)[:, None]
        gravity = np.array([0.0, 0.0, -_GRAVITY])
        return _State(control, 0.0, gravity, np.zeros((2, self.bias_s.size, 3)))

    def first_sigma(self) -> FloatArray:
        """Standard deviations of gyroscope, accelerometer, position, orientation, to begin with."""
        return np.array([*5.0 * self.sheet(), *3.0 * _LEAST_POSE_SIGMA])

    def sheet(self) -> FloatArray:
        """Standard deviations of a sample of gyroscope and accelerometer by the data sheet."""
        rates = [1.0 / float(np.median(np.diff(s.t_s))) for s in (self.gyroscope, self.accelerometer)]
        return np.array([self.noise.gyroscope_density, self.noise.accelerometer_density]) * np.sqrt(rates)

    # Residuals -------------------------------------------------------------------------------------

    def gyroscope_terms(self, state: _State) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
        t_s = self.gyroscope.t_s
        first, weights = self.knots.weights(t_s, 1)
        q, q1 = (_spline(weights[nu], first, state.control)[:, 3:] for nu in (0, 1))
        square = np.sum(q * q, axis=1)[:, None]
        rate = 2.0 * _vector_of(q, q1) / square
        bias, columns, share = self._bias(t_s, state, 0)
        by_q = -2.0 * _left(q1) / square[..., None] - 2.0 * rate[:, :, None] * (q / square)[:, None, :]
        by_q1 = 2.0 * _left(q) / square[..., None]
        J = np.zeros((t_s.size, 3, ACTIVE, _EACH))
        J[..., 3:] = _times(by_q, weights[0]) + _times(by_q1, weights[1])
        return first, J.reshape(t_s.size, 3, -1), columns, share, rate + bias - self.gyroscope.values

    def accelerometer_terms(
        self, state: _State
    ) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
        t_s = self.accelerometer.t_s
        first, weights = self.knots.weights(t_s, 2)
        q = _spline(weights[0], first, state.control)[:, 3:]
        acceleration = _spline(weights[2], first, state.control)[:, :3]
        C_b_w = np.swapaxes(Rotation.from_quat(q).as_matrix(), 1, 2)
        force = np.einsum("nij,nj->ni", C_b_w, acceleration - state.gravity)
        bias, columns, share = self._bias(t_s, state, 1)
        J = np.zeros((t_s.size, 3, ACTIVE, _EACH))
        J[..., :3] = _times(C_b_w, weights[2])
        square = np.sum(q * q, axis=1)[:, None, None]
        J[..., 3:] = _times(_cross(force) @ (2.0 * _left(q) / square), weights[0])
        columns = np.hstack([np.tile(np.arange(1, _COMMON), (t_s.size, 1)), columns])
        K = np.concatenate([-C_b_w, share], axis=2)
        return first, J.reshape(t_s.size, 3, -1), columns, K, force + bias - self.accelerometer.values

    def pose_terms(self, state: _State) -> tuple[IntArray, FloatArray, IntArray, FloatArray, FloatArray]:
        """Position first, then orientation, in (N,6)."""
        t_s = np.clip(self.poses.t_s + state.clock_s, 0.0, self.knots.intervals * self.knots.step_s)
        first, weights = self.knots.weights(t_s, 1)
        at, rate = (_spline(weights[nu], first, state.control) for nu in (0, 1))
        measured = self.poses.values[:, 3:]
        length = np.linalg.norm(at[:, 3:], axis=1)[:, None]
        sign = np.sign(np.sum(measured * at[:, 3:], axis=1))[:, None]
        turn = 2.0 * sign / length
        J = np.zeros((t_s.size, 6, ACTIVE, _EACH))
        J[:, :3, :, :3] = _times(np.tile(np.eye(3), (t_s.size, 1, 1)), weights[0])
        J[:, 3:, :, 3:] = _times(turn[..., None] * _left(measured), weights[0])
        orientation = turn * _vector_of(measured, at[:, 3:])
        K = np.concatenate([rate[:, :3], turn * _vector_of(measured, rate[:, 3:])], axis=1)[..., None]
        r = np.concatenate([at[:, :3] - self.poses.values[:, :3], orientation], axis=1)
        columns = np.zeros((t_s.size, 1), dtype=np.int64)
        return first, J.reshape(t_s.size, 6, -1), columns, K, r

    def _bias(self, t_s: FloatArray, state: _State, sensor: int) -> tuple[FloatArray, IntArray, FloatArray]:
        """Bias (N,3) of a sensor, its six columns (N,6), and its derivative by them (N,3,6)."""
        node = np.clip((t_s / _BIAS_NODE_S).astype(np.int64), 0, self.bias_s.size - 2)
        share = (t_s / _BIAS_NODE_S - node)[:, None]
        bias = (1.0 - share) * state.biases[sensor, node] + share * state.biases[sensor, node + 1]
        begin = _COMMON + 3 * (sensor * self.bias_s.size + node)
        D = np.concatenate(
            [(1.0 - share)[..., None] * np.eye(3), share[..., None] * np.eye(3)], axis=2
        )
        return bias, begin[:, None] + np.arange(6), D

    # Steps -----------------------------------------------------------------------------------------

    def step(self, state: _State, sigma: FloatArray) -> _State:
        normal = _Normal(self.knots.count, _COMMON + state.biases.size)
        for terms, one in ((self.gyroscope_terms, sigma[0]), (self.accelerometer_terms, sigma[1])):
            first, J, columns, K, r = terms(state)
            normal.add(first, J / one, columns, K / one, r / one)
        first, J, columns, K, r = self.pose_terms(state)
        scale = 1.0 / np.repeat(sigma[2:], 3) * _huber_root(r, sigma[2:])
        normal.add(first, J * scale[..., None], columns, K * scale[..., None], r * scale)
        self._add_lengths(normal, state)
        self._add_priors(normal, state)
        control, others = normal.solve()
        return _State(
            state.control + control.reshape(-1, _EACH),
            state.clock_s + float(others[0]),
            state.gravity + others[1:_COMMON],
            state.biases + others[_COMMON:].reshape(state.biases.shape),
        )

    def _add_lengths(self, normal: _Normal, state: _State) -> None:
        """Quaternions of length one, twice an interval: without it their length would be free."""
        t_s = (np.arange(2 * self.knots.intervals) + 0.5) * 0.5 * self.knots.step_s
        first, weights = self.knots.weights(t_s, 0)
        q = _spline(weights[0], first, state.control)[:, 3:]
        J = np.zeros((t_s.size, 1, ACTIVE, _EACH))
        J[..., 3:] = _times(2.0 * q[:, None, :], weights[0])
        r = np.sum(q * q, axis=1)[:, None] - 1.0
        none = np.zeros((t_s.size, 0), dtype=np.int64)
        J = J.reshape(t_s.size, 1, -1) / _LENGTH_SIGMA
        normal.add(first, J, none, np.zeros((t_s.size, 1, 0)), r / _LENGTH_SIGMA)
        # Next to nothing, for control points that nothing else determines.
        normal.band[0] += 1e-6

    def _add_priors(self, normal: _Normal, state: _State) -> None:
        size = _COMMON + state.biases.size
        rows, values = [np.eye(size)[0] / _CLOCK_SIGMA], [state.clock_s / _CLOCK_SIGMA]
        norm = float(np.linalg.norm(state.gravity))
        row = np.zeros(size)
        row[1:_COMMON] = state.gravity / norm / _GRAVITY_SIGMA
        rows.append(row)
        values.append((norm - _GRAVITY) / _GRAVITY_SIGMA)
        walks = self.noise.gyroscope_walk, self.noise.accelerometer_walk
        flat = state.biases.reshape(2, -1)
        for sensor in range(2):
            begin = _COMMON + sensor * flat.shape[1]
            wander = max(walks[sensor], 1e-9) * np.sqrt(_BIAS_NODE_S)
            for index in range(flat.shape[1]):
                row = np.zeros(size)
                row[begin + index] = 1.0 / _BIAS_SIGMA[sensor]
                rows.append(row)
                values.append(flat[sensor, index] / _BIAS_SIGMA[sensor])
                if index >= 3:
                    row = np.zeros(size)
                    row[begin + index], row[begin + index - 3] = 1.0 / wander, -1.0 / wander
                    rows.append(row)
                    values.append((flat[sensor, index] - flat[sensor, index - 3]) / wander)
        A, r = np.array(rows), np.array(values)
        normal.corner += A.T @ A
        normal.right_others += A.T @ r

    def sigma_of(self, state: _State) -> FloatArray:
        """What is left over of each kind, not less than what the sensor cannot be better than."""
        left = self.left_over(state)
        spread = [1.4826 * float(np.median(np.abs(r))) for r in left[2:]]
        found = np.array([float(np.sqrt(np.mean(r**2))) for r in left[:2]] + spread)
        return np.maximum(found, [*self.sheet(), *_LEAST_POSE_SIGMA])

    def left_over(self, state: _State) -> list[FloatArray]:
        poses = self.pose_terms(state)[-1]
        gyroscope, accelerometer = self.gyroscope_terms(state)[-1], self.accelerometer_terms(state)[-1]
        return [gyroscope, accelerometer, poses[:, :3], poses[:, 3:]]

    def result(self, state: _State) -> PathFit:
        rms = [float(np.sqrt(np.mean(r**2))) for r in self.left_over(state)]
        knots = self.knots.knots
        return PathFit(
            self.start_ns,
            min(float(s.t_s[-1]) for s in (self.poses, self.gyroscope, self.accelerometer)),
            BSpline(knots, state.control[:, :3], DEGREE),
            BSpline(knots, state.control[:, 3:], DEGREE),
            state.gravity,
            state.clock_s,
            self.bias_s,
            state.biases[0],
            state.biases[1],
            PathResiduals(*rms),
        )


def _huber_root(r: FloatArray, sigma: FloatArray) -> FloatArray:
    """Square roots (N,6) of Huber's weights of positions and orientations (N,6)."""
    size = np.column_stack([np.linalg.norm(r[:, :3], axis=1), np.linalg.norm(r[:, 3:], axis=1)]) / sigma
    return np.repeat(np.sqrt(_HUBER / np.maximum(size, _HUBER)), 3, axis=1)


def _spline(weights: FloatArray, first: IntArray, control: FloatArray) -> FloatArray:
    """Values (N,7) with weights (N,6) of the control points from `first` (N,) on."""
    return np.einsum("nm,nmk->nk", weights, control[first[:, None] + np.arange(ACTIVE)])


def _times(D: FloatArray, weights: FloatArray) -> FloatArray:
    """Derivatives (N,k,6,c) by control points, of D (N,k,c) by what they sum up to with weights (N,6)."""
    return D[:, :, None, :] * weights[:, None, :, None]


def _left(p: FloatArray) -> FloatArray:
    """Matrices (N,3,4) with L(p) q = vec(p^-1 q) for quaternions xyzw (N,4) of length one."""
    return np.concatenate([p[:, 3, None, None] * np.eye(3) - _cross(p), -p[:, :3, None]], axis=2)


def _vector_of(p: FloatArray, q: FloatArray) -> FloatArray:
    return np.einsum("nij,nj->ni", _left(p), q)


def _cross(v: FloatArray) -> FloatArray:
    """Matrices (N,3,3) of the cross product with the first three of v (N,k)."""
    x, y, z = v[:, 0], v[:, 1], v[:, 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
