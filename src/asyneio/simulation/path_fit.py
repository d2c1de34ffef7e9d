# SPDX-License-Identifier: Apache-2.0
"""Fit a smooth path to recorded poses and IMU samples by weighted least squares on splines.

Position and quaternion are uniform quintic B-splines. With q(t) and p(t) of a body (the IMU) in the world,

    gyroscope      2 vec(q^-1 q') / |q|^2 + b_g        accelerometer    C(q)^T (p'' - g) + b_a
    position       p(t + d)                            orientation      q(t + d)

where d is the time by which the IMU clock is ahead of that of the poses, and g is gravity in the world of the
poses. The biases b_g, b_a are piecewise linear, with changes limited by the random walks of the IMU. Control
points, d, g and biases are estimated jointly by Gauss-Newton steps. The noise of each sensor is estimated
from the residuals, because vibration makes it many times that of the data sheet. Motion faster than the knot
spacing is not fitted: the vibration of a rotor moves a rig by micrometres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation, Slerp

from asyneio.errors import SimulationError
from asyneio.simulation.path_agreement import check_left_over, check_rates, common_span_ns
from asyneio.simulation.path_basis import DEGREE, UniformKnots
from asyneio.simulation.path_normal import EACH, NormalEquations, Terms
from asyneio.simulation.path_terms import (
    COMMON,
    PathState,
    Readings,
    accelerometer_terms,
    gyroscope_terms,
    length_terms,
    pose_terms,
)
from asyneio.types import NS_PER_S, FloatArray, ImuNoise, PoseTrajectory, RecordArray

#: Spacing of the knots [s], for motion up to about 15 Hz; without an IMU, up to about 4 Hz.
_KNOT_S, _KNOT_OF_POSES_S = 0.025, 0.1
#: Minimum number of IMU samples between two knots.
_SAMPLES_PER_KNOT = 3.0
#: Longest gap between two poses that the IMU bridges [s].
_LONGEST_GAP_S = 1.0
#: Minimum standard deviations of poses by motion capture: m, rad.
_LEAST_POSE_SIGMA = (1e-3, 2e-3)
#: Prior standard deviation of gravity [m/s^2], which absorbs an error of the accelerometer's scale.
_GRAVITY, _GRAVITY_SIGMA = 9.81, 0.05
#: Prior standard deviations of biases [rad/s, m/s^2]; minimum spacing [s] and maximum number of bias nodes.
_BIAS_SIGMA, _NODE_S, _MOST_NODES = (0.2, 0.5), 10.0, 30
#: Prior standard deviations of the clock offset after coarse alignment [s], and of the squared quaternion
#: norm.
_CLOCK_SIGMA, _LENGTH_SIGMA = 0.02, 1e-3
_ITERATIONS = 12
#: Largest change of a control point at convergence: m, or half a rad.
_CONVERGED = 1e-5
#: Residuals of poses beyond this number of sigmas get less weight (Huber).
_HUBER = 3.0
#: Readings processed at a time; bounds the memory.
_PIECE = 20_000


@dataclass(frozen=True)
class PathResiduals:
    """Root mean squares of the residuals over all axes.

    For gyroscope [rad/s], accelerometer [m/s^2], position [m] and orientation [rad]; for the first two also
    as multiples of a sample's sigma by the data sheet. NaN without an IMU.
    """

    gyroscope: float
    accelerometer: float
    position: float
    orientation: float
    gyroscope_sigmas: float
    accelerometer_sigmas: float


@dataclass(frozen=True)
class PathFit:
    """Result of a fit; times in seconds since `start_ns` (IMU clock).

    `position` [m] and `quaternion` (xyzw, of any length near one) are splines of the IMU in the world of the
    poses. `gravity` (3,) [m/s^2] is in that world; `clock_offset_s`: t_imu = t_pose + offset. Biases (K,3)
    are linear between `bias_s` (K,).
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


def fit_path(
    poses: PoseTrajectory,
    gyroscope: RecordArray | None,
    accelerometer: RecordArray | None,
    noise: ImuNoise,
) -> PathFit:
    """Fit a path to poses of an IMU and to its samples, over the time that all of them cover.

    Args:
        poses: poses of the IMU, approximately in its clock.
        gyroscope: [rad/s], INERTIAL_DTYPE; None to fit the poses alone, with z up.
        accelerometer: [m/s^2], INERTIAL_DTYPE; None with `gyroscope` None.
        noise: noise by the data sheet; its walks limit the changes of the biases.

    Raises:
        SimulationError: poses and samples do not overlap or do not agree, or the gaps are too long.
    """
    problem = _problem_of(poses, gyroscope, accelerometer, noise)
    state, sigma = problem.start(), problem.first_sigma()
    for _ in range(_ITERATIONS):
        before, state = state, problem.step(state, sigma)
        sigma = problem.sigma_of(state)
        if np.abs(state.control - before.control).max() < _CONVERGED:
            break
    return problem.result(state)


@dataclass(frozen=True)
class _Problem:
    """All readings, in seconds since the start; `sensors` are gyroscope and accelerometer, or empty.

    The clock of the poses is shifted by `lag_s` in advance.
    """

    start_ns: int
    duration_s: float
    knots: UniformKnots
    poses: Readings
    sensors: tuple[Readings, ...]
    lag_s: float
    noise: ImuNoise

    def start(self) -> PathState:
        """Initial control points, by linear interpolation of the poses."""
        at_s = self.poses.t_s
        t_s = np.clip(self.knots.centres_s, at_s[0], at_s[-1])
        control = np.empty((t_s.size, EACH))
        for axis in range(3):
            control[:, axis] = np.interp(t_s, at_s, self.poses.values[:, axis])
        turns = Slerp(at_s, Rotation.from_quat(self.poses.values[:, 3:]))
        quaternion = turns(t_s).as_quat()
        # q and -q are the same orientation; a spline needs a continuous sign.
        flips = np.sign(np.sum(quaternion[1:] * quaternion[:-1], axis=1))
        control[:, 3:] = quaternion * np.cumprod([1.0, *flips])[:, None]
        gravity = np.array([0.0, 0.0, -_GRAVITY])
        if self.sensors:
            force = self.sensors[1]
            upwards = turns(np.clip(force.t_s, at_s[0], at_s[-1])).apply(force.values).mean(axis=0)
            gravity = -_GRAVITY * upwards / np.linalg.norm(upwards)
        node_s = max(_NODE_S, self.duration_s / _MOST_NODES)
        nodes = int(np.ceil(self.duration_s / node_s)) + 1
        return PathState(control, 0.0, gravity, np.zeros((2, nodes, 3)), node_s)

    def sheet(self) -> FloatArray:
        """Standard deviations of a sample of each sensor by the data sheet."""
        densities = self.noise.gyroscope_density, self.noise.accelerometer_density
        steps = [float(np.median(np.diff(sensor.t_s))) for sensor in self.sensors]
        return np.array([d / np.sqrt(step) for d, step in zip(densities, steps, strict=False)])

    def first_sigma(self) -> FloatArray:
        """Initial standard deviations of the sensors, of position and of orientation."""
        return np.array([*5.0 * self.sheet(), *3.0 * np.array(_LEAST_POSE_SIGMA)])

    def sigma_of(self, state: PathState) -> FloatArray:
        """Standard deviations of the residuals, with lower limits."""
        *sensors, position, orientation = self.left_over(state)
        # The median for poses, because of outliers.
        spread = [1.4826 * float(np.median(np.abs(r))) for r in (position, orientation)]
        found = [*(float(np.sqrt(np.mean(r**2))) for r in sensors), *spread]
        return np.maximum(found, [*self.sheet(), *_LEAST_POSE_SIGMA])

    def left_over(self, state: PathState) -> list[FloatArray]:
        """Residuals (N,3) of the sensors, of position and of orientation."""
        kinds = (*range(len(self.sensors)), -1)
        parts = [np.concatenate([terms.r for terms in self.terms(kind, state)]) for kind in kinds]
        return [*parts[:-1], parts[-1][:, :3], parts[-1][:, 3:]]

    def terms(self, kind: int, state: PathState) -> Iterator[Terms]:
        """Residuals of the gyroscope (0), of the accelerometer (1) or of the poses (-1), in chunks."""
        readings = self.poses if kind < 0 else self.sensors[kind]
        make = (gyroscope_terms, accelerometer_terms, pose_terms)[kind]
        for begin in range(0, readings.t_s.size, _PIECE):
            piece = slice(begin, begin + _PIECE)
            yield make(self.knots, Readings(readings.t_s[piece], readings.values[piece]), state)

    def step(self, state: PathState, sigma: FloatArray) -> PathState:
        """The state after one Gauss-Newton step."""
        normal = NormalEquations(self.knots.count, COMMON + state.biases.size)
        for kind in range(len(self.sensors)):
            for terms in self.terms(kind, state):
                normal.add(terms.weighted(1.0 / sigma[kind]))
        for terms in self.terms(-1, state):
            normal.add(terms.weighted(_huber_root(terms.r, sigma[-2:]) / np.repeat(sigma[-2:], 3)))
        normal.add(length_terms(self.knots, state).weighted(1.0 / _LENGTH_SIGMA))
        self._add_priors(normal, state)
        return state.stepped(*normal.solve())

    def _add_priors(self, normal: NormalEquations, state: PathState) -> None:
        norm = float(np.linalg.norm(state.gravity))
        walks = np.maximum([self.noise.gyroscope_walk, self.noise.accelerometer_walk], 1e-9)
        nodes = state.biases.shape[1]
        column = COMMON + np.arange(state.biases.size).reshape(state.biases.shape)
        sigma = np.broadcast_to(np.array(_BIAS_SIGMA)[:, None, None], column.shape)
        wander = np.broadcast_to((walks * np.sqrt(state.node_s))[:, None, None], column[:, 1:].shape)
        _add_prior(normal, np.array([[0]]), [1.0], [state.clock_s], _CLOCK_SIGMA)
        _add_prior(normal, np.array([[1, 2, 3]]), state.gravity / norm, [norm - _GRAVITY], _GRAVITY_SIGMA)
        # The direction of gravity is free, unless there is no accelerometer.
        _add_prior(normal, np.arange(1, COMMON)[:, None], [1.0], np.zeros(3), 1e3)
        _add_prior(normal, column.reshape(-1, 1), [1.0], state.biases.ravel(), sigma.ravel())
        if nodes > 1:
            pairs = np.stack([column[:, :-1], column[:, 1:]], axis=-1).reshape(-1, 2)
            steps = np.diff(state.biases, axis=1).ravel()
            _add_prior(normal, pairs, [-1.0, 1.0], steps, wander.ravel())

    def result(self, state: PathState) -> PathFit:
        """The fitted path, with its residuals. Raises SimulationError: they are too large."""
        rms = [float(np.sqrt(np.mean(r**2))) for r in self.left_over(state)]
        sensors = rms[:-2] or [float("nan")] * 2
        sigmas = (np.array(rms[:-2]) / self.sheet()).tolist() or sensors
        residuals = PathResiduals(*sensors, *rms[-2:], *sigmas)
        check_left_over(*sensors, *rms[-2:])
        knots = self.knots.knots
        nodes = state.biases.shape[1]
        return PathFit(
            self.start_ns,
            self.duration_s,
            BSpline(knots, state.control[:, :3], DEGREE),
            BSpline(knots, state.control[:, 3:], DEGREE),
            state.gravity,
            self.lag_s + state.clock_s,
            np.asarray(np.arange(nodes) * state.node_s, dtype=np.float64),
            state.biases[0],
            state.biases[1],
            residuals,
        )


def _problem_of(
    poses: PoseTrajectory, gyroscope: RecordArray | None, accelerometer: RecordArray | None, noise: ImuNoise
) -> _Problem:
    streams = [] if gyroscope is None or accelerometer is None else [gyroscope, accelerometer]
    start_ns, end_ns = common_span_ns(poses, streams)
    lag_s = check_rates(poses, gyroscope) if gyroscope is not None and streams else 0.0
    if lag_s:
        poses = replace(poses, t_ns=poses.t_ns + round(lag_s * NS_PER_S))
        start_ns, end_ns = common_span_ns(poses, streams)
    duration_s = (end_ns - start_ns) / NS_PER_S
    slowest_s = max((float(np.median(np.diff(s["t_ns"]))) / NS_PER_S for s in streams), default=0.0)
    step_s = max(_KNOT_S, _SAMPLES_PER_KNOT * slowest_s) if streams else _KNOT_OF_POSES_S
    knots = UniformKnots(step_s, int(np.ceil(duration_s / step_s)))
    quaternion = poses.quaternion / np.linalg.norm(poses.quaternion, axis=1, keepdims=True)
    both = Readings((poses.t_ns - start_ns) / NS_PER_S, np.hstack([poses.position, quaternion]))
    readings = [both, *(Readings((s["t_ns"] - start_ns) / NS_PER_S, s["xyz"]) for s in streams)]
    # A change of the clock offset might move poses at the ends out of the spline.
    used, *sensors = (
        _within(one, margin_s, duration_s - margin_s)
        for one, margin_s in zip(readings, (_CLOCK_SIGMA, 0.0, 0.0), strict=False)
    )
    gap_s = float(np.diff(used.t_s, prepend=0.0, append=duration_s).max())
    longest_s = _LONGEST_GAP_S if streams else 0.5 * step_s + 1e-3
    if gap_s > longest_s:
        raise SimulationError(
            f"the poses have a gap of {gap_s:.3f} s; expected at most {longest_s:.2f} s between poses "
            f"{'with' if streams else 'without'} samples of an IMU: use another part or another file"
        )
    return _Problem(start_ns, duration_s, knots, used, tuple(sensors), lag_s, noise)


def _within(readings: Readings, begin_s: float, end_s: float) -> Readings:
    use = (readings.t_s >= begin_s) & (readings.t_s <= end_s)
    return Readings(readings.t_s[use], readings.values[use])


def _add_prior(
    normal: NormalEquations,
    columns: np.ndarray,
    slope: FloatArray | list[float],
    r: FloatArray | list[float],
    sigma: FloatArray | float,
) -> None:
    """Residuals (N,) whose derivatives by unknowns `columns` (N,c) are `slope` (c,), over sigma (N,)."""
    root = 1.0 / np.broadcast_to(sigma, len(r))
    normal.add_others(columns, root[:, None, None] * np.asarray(slope), (root * np.asarray(r))[:, None])


def _huber_root(r: FloatArray, sigma: FloatArray) -> FloatArray:
    """Square roots (N,6) of Huber's weights of positions and orientations (N,6)."""
    size = np.column_stack([np.linalg.norm(r[:, :3], axis=1), np.linalg.norm(r[:, 3:], axis=1)]) / sigma
    return np.repeat(np.sqrt(_HUBER / np.maximum(size, _HUBER)), 3, axis=1)
