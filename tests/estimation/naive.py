"""A slow, obvious oracle for the window: every residual stacked, dense Jacobian by central differences.

Nothing here is shared with the package: no local coordinates, no Schur complement, no closed forms of Lie
Jacobians (power series instead), no whitening tables (Cholesky of the covariance). It reads a `Problem` as
data. Every function takes any number of leading axes, so that all perturbed points are evaluated at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from asyneio.estimation.problem.problem import Camera, Inertial, Prior, Problem, States
from asyneio.trajectory.model import SE3, WNOJ
from tests.estimation.naive_increments import preintegration_residuals, propagated_poses
from tests.estimation.naive_lie import (
    exp_se3,
    exp_so3,
    log_se3,
    log_so3,
    right_jacobian,
    right_jacobian_rate,
    times,
)

Array = NDArray[np.float64]

_STEP = 2e-5
_AT_ONCE = 64


@dataclass(frozen=True)
class Point:
    """All unknowns, leading axes omitted: poses `T` (K,4,4), rates `varpi` (K,2,6), biases `bias` (K,6), of
    the camera `offset` () and `C_bc` (3,3), of the IMU `correction` (15,), bearings `kappa` (L,3) that move
    along `tangent` (L,3,2), inverse distances `rho` (L,).

    `columns` (c,) of [offset, rotation] and `imu_columns` (s,) of the correction are unknowns; `dof` of a
    landmark: 1 or 3.
    """

    T: Array
    varpi: Array
    bias: Array
    offset: Array
    C_bc: Array
    correction: Array
    kappa: Array
    rho: Array
    tangent: Array
    columns: NDArray[np.int64]
    imu_columns: NDArray[np.int64]
    dof: int

    @property
    def size(self) -> int:
        behind = len(self.columns) + len(self.imu_columns)
        return 24 * self.T.shape[-3] + behind + self.dof * self.rho.shape[-1]

    def moved(self, delta: Array) -> Point:
        """Poses and the camera's rotation on the right, everything else added; `delta` (..., size), knots
        first, then camera and IMU."""
        n, lead = 24 * self.T.shape[-3], delta.shape[:-1]
        m = n + len(self.columns)
        end = m + len(self.imu_columns)
        knots = delta[..., :n].reshape(*lead, -1, 24)
        camera = np.zeros((*lead, 4))
        camera[..., self.columns] = delta[..., n:m]
        correction = np.zeros((*lead, 15))
        correction[..., self.imu_columns] = delta[..., m:end]
        step = np.zeros((*lead, self.rho.shape[-1], 3))
        step[..., : self.dof] = delta[..., end:].reshape(*lead, -1, self.dof)
        return Point(
            self.T @ exp_se3(knots[..., :6]),
            self.varpi + knots[..., 6:18].reshape(*lead, -1, 2, 6),
            self.bias + knots[..., 18:],
            self.offset + camera[..., 0],
            self.C_bc @ exp_so3(camera[..., 1:]),
            self.correction + correction,
            self.kappa + times(self.tangent, step[..., 1:]),
            self.rho + step[..., 0],
            self.tangent,
            self.columns,
            self.imu_columns,
            self.dof,
        )


def at(states: States, problem: Problem) -> Point:
    """`states`, and everything else as in the problem."""
    landmarks, camera = problem.landmarks, problem.camera
    return Point(
        poses(states),
        states.varpi,
        states.bias,
        np.asarray(camera.time_offset),
        camera.C_bc,
        problem.imu.coordinates,
        landmarks.kappa,
        landmarks.rho,
        landmarks.tangent,
        camera.columns,
        problem.imu.columns,
        problem.model.landmark_dof,
    )


def poses(states: States) -> Array:
    T = np.tile(np.eye(4), (len(states.r), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = states.C, states.r
    return T


def local_variables(problem: Problem, point: Point) -> Array:
    """[xi_dot(t_k), xi_ddot(t_k), xi, xi_dot, xi_ddot] (..., I,5,6) of all intervals."""
    T = np.linalg.inv(point.T[..., :-1, :, :]) @ point.T[..., 1:, :, :]
    bent = _bent_variables(log_se3(T), point.varpi)
    if problem.model.motion_model.space == SE3:
        return bent
    # The position has a line of its own: its velocity and acceleration, in the axes of the first knot.
    begin, end = _linear_rates(point.varpi[..., :-1, :, :]), _linear_rates(point.varpi[..., 1:, :, :])
    line = [
        *np.moveaxis(begin, -2, 0),
        T[..., :3, 3],
        *np.moveaxis(end @ np.swapaxes(T[..., :3, :3], -1, -2), -2, 0),
    ]
    return np.concatenate([bent[..., :3], np.stack(line, axis=-2)], axis=-1)


def _linear_rates(varpi: Array) -> Array:
    """Velocity and acceleration (..., 2,3) in the axes of the body from [varpi, varpi_dot] (..., 2,6)."""
    turning = np.cross(varpi[..., 0, :3], varpi[..., 0, 3:])
    return np.stack([varpi[..., 0, 3:], varpi[..., 1, 3:] + turning], axis=-2)


def step_pose(problem: Problem, xi: Array) -> Array:
    """Pose (..., 4,4) from the first knot of an interval with local variable xi."""
    if problem.model.motion_model.space == SE3:
        return exp_se3(xi)
    T = exp_se3(np.concatenate([xi[..., :3], np.zeros_like(xi[..., 3:])], axis=-1))
    T[..., :3, 3] = xi[..., 3:]
    return T


def _bent_variables(xi: Array, varpi: Array) -> Array:
    """On SE(3), from xi and the [varpi, varpi_dot] (..., K,2,6) of all knots."""
    J = right_jacobian(xi)
    begin, end = varpi[..., :-1, :, :], varpi[..., 1:, :, :]
    xi_dot = np.linalg.solve(J, end[..., 0, :, None])[..., 0]
    rest = end[..., 1, :] - times(right_jacobian_rate(xi, xi_dot), xi_dot)
    xi_ddot = np.linalg.solve(J, rest[..., None])[..., 0]
    return np.stack([begin[..., 0, :], begin[..., 1, :], xi, xi_dot, xi_ddot], axis=-2)


def _interval_of(start: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.repeat(np.arange(len(start) - 1), np.diff(start))


def _used(samples: Inertial) -> slice:
    return slice(int(samples.start[0]), int(samples.start[-1]))


def _rows(residual: Array, axes: int) -> Array:
    """The last `axes` axes as one."""
    return residual.reshape(*residual.shape[:-axes], -1)


def motion_residuals(problem: Problem, local: Array, bias: Array) -> list[Array]:
    """White noise on jerk or acceleration, if any, and random walk of the biases, of the intervals that
    count."""
    out = []
    for i in np.flatnonzero(problem.motion):
        dt = problem.model.dt[i]
        out.append((bias[..., i + 1, :] - bias[..., i, :]) / (problem.model.bias_walk * np.sqrt(dt)))
        if not problem.model.kinematic_prior:
            continue
        varpi, varpi_dot, xi, xi_dot, xi_ddot = np.moveaxis(local[..., i, :, :], -2, 0)
        if problem.model.motion_model.prior == WNOJ:
            predicted = [dt * varpi + dt**2 / 2 * varpi_dot, varpi + dt * varpi_dot, varpi_dot]
            error = np.stack(predicted, axis=-2) - np.stack([xi, xi_dot, xi_ddot], axis=-2)
            Q = [
                [dt**5 / 20, dt**4 / 8, dt**3 / 6],
                [dt**4 / 8, dt**3 / 3, dt**2 / 2],
                [dt**3 / 6, dt**2 / 2, dt],
            ]
        else:
            error = np.stack([dt * varpi, varpi], axis=-2) - np.stack([xi, xi_dot], axis=-2)
            Q = [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]
        whitened = np.linalg.solve(np.linalg.cholesky(Q), error) / problem.model.root_density
        out.append(_rows(whitened, 2))
    return out


def _bias_at(samples: Inertial, i: NDArray[np.int64], bias: Array) -> Array:
    alpha = samples.alpha[_used(samples), None]
    return np.asarray((1.0 - alpha) * bias[..., i, :] + alpha * bias[..., i + 1, :])


def gyroscope_gain(correction: Array) -> Array:
    """Identity plus a symmetric matrix (..., 3,3), from its diagonal and its elements yz, xz, xy."""
    x, y, z, yz, xz, xy = np.moveaxis(correction[..., :6], -1, 0)
    rows = [[1.0 + x, xy, xz], [xy, 1.0 + y, yz], [xz, yz, 1.0 + z]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def accelerometer_gain(correction: Array) -> Array:
    """Identity plus any matrix (..., 3,3), from its diagonal and its elements xy, xz, yx, yz, zx, zy."""
    x, y, z, xy, xz, yx, yz, zx, zy = np.moveaxis(correction[..., 6:], -1, 0)
    rows = [[1.0 + x, xy, xz], [yx, 1.0 + y, yz], [zx, zy, 1.0 + z]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def gyroscope_residuals(problem: Problem, local: Array, point: Point) -> Array:
    samples = problem.gyroscope
    i, used = _interval_of(samples.start), _used(samples)
    gamma = samples.weights[used] @ local[..., i, :, :]
    omega = times(right_jacobian(gamma[..., 0, :]), gamma[..., 1, :])[..., :3]
    # The problem holds corrected values.
    change = gyroscope_gain(point.correction) - gyroscope_gain(problem.imu.coordinates)
    value = samples.value[used] - samples.smooth[used] @ np.swapaxes(change, -1, -2)
    error = value - omega - _bias_at(samples, i, point.bias)[..., :3]
    return _rows(_whitened(samples, error), 2)


def _whitened(samples: Inertial, error: Array) -> Array:
    """Errors (..., N,3) of all intervals, those of each by their common root."""
    start = samples.start - samples.start[0]
    out = np.empty_like(error)
    for a, b in pairwise(start):
        root = samples.root_information[samples.start[0] + a : samples.start[0] + b, : b - a]
        out[..., a:b, :] = root @ error[..., a:b, :]
    return out


def accelerometer_residuals(problem: Problem, local: Array, point: Point) -> Array:
    samples = problem.accelerometer
    i, used = _interval_of(samples.start), _used(samples)
    gamma = samples.weights[used] @ local[..., i, :, :]
    xi, xi_dot, xi_ddot = np.moveaxis(gamma, -2, 0)
    C = (point.T[..., i, :, :] @ exp_se3(xi))[..., :3, :3]
    if problem.model.motion_model.space == SE3:
        J = right_jacobian(xi)
        varpi = times(J, xi_dot)
        varpi_dot = times(J, xi_ddot) + times(right_jacobian_rate(xi, xi_dot), xi_dot)
        moving = varpi_dot[..., 3:] + np.cross(varpi[..., :3], varpi[..., 3:])
    else:
        moving = times(np.swapaxes(exp_se3(xi)[..., :3, :3], -1, -2), xi_ddot[..., 3:])
    force = moving - problem.model.gravity_w @ C
    change = accelerometer_gain(point.correction) - accelerometer_gain(problem.imu.coordinates)
    value = samples.value[used] - samples.smooth[used] @ np.swapaxes(change, -1, -2)
    error = value - force - _bias_at(samples, i, point.bias)[..., 3:]
    return _rows(_whitened(samples, error), 2)


def conditional_weights(tau: Array, dt: Array, prior: int) -> Array:
    """(..., M,5): mean of xi at `tau` (..., M) given both ends of intervals `dt` (M,), from Phi and Q.

    In units of the interval: quantities [xi, dt xi_dot, dt^2 xi_ddot].
    """
    s = tau / dt
    size = 3 if prior == WNOJ else 2

    def transition(s: Array) -> Array:
        powers = [np.ones_like(s), s, s**2 / 2]
        zero = np.zeros_like(s)
        rows = [[powers[b - a] if b >= a else zero for b in range(size)] for a in range(size)]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def covariance(s: Array) -> Array:
        a, b = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
        p, q = size - 1 - a, size - 1 - b  # integrals of white noise between it and each quantity
        factor = np.vectorize(math.factorial)(p) * np.vectorize(math.factorial)(q) * (p + q + 1)
        return np.asarray(s[..., None, None] ** (p + q + 1) / factor)

    one = np.ones_like(s)
    psi = covariance(s) @ np.swapaxes(transition(1 - s), -1, -2) @ np.linalg.inv(covariance(np.ones(1)))
    begin = transition(s) - psi @ transition(one)
    out = np.zeros((*s.shape, 5))
    out[..., : size - 1], out[..., 2 : 2 + size] = begin[..., 0, 1:], psi[..., 0, :]
    return out * np.stack([dt, dt**2, np.ones_like(dt), dt, dt**2], axis=-1)


def projections(problem: Problem, local: Array, point: Point) -> Array:
    """Landmarks in the cameras that observed them, times inverse distance: (..., M,3)."""
    visual, model = problem.visual, problem.model
    i, j = _interval_of(visual.start), visual.landmark
    T_bc = np.zeros((*point.C_bc.shape[:-2], 4, 4))
    T_bc[..., :3, :3], T_bc[..., :3, 3], T_bc[..., 3, 3] = point.C_bc, model.r_bc, 1.0
    T_bc = T_bc[..., None, :, :]
    T_w_a = point.T[..., problem.landmarks.anchor[j], :, :] @ T_bc
    if len(problem.propagated.tau):
        shift = point.offset - problem.camera.time_offset
        T_w_b = propagated_poses(problem, i, point.T, point.varpi, point.bias, shift)
    else:
        tau = visual.tau + point.offset[..., None]
        weights = conditional_weights(tau, model.dt[i], model.motion_model.prior)
        xi = (weights[..., None, :] @ local[..., i, :, :])[..., 0, :]
        T_w_b = point.T[..., i, :, :] @ step_pose(problem, xi)
    homogeneous = np.concatenate([point.kappa[..., j, :], point.rho[..., j, None]], axis=-1)
    return times(np.linalg.inv(T_w_b @ T_bc) @ T_w_a, homogeneous)[..., :3]


def reprojection_residuals(problem: Problem, local: Array, point: Point) -> Array:
    """Whitened, (..., M,2)."""
    h = projections(problem, local, point)
    return times(problem.visual.root_information, h[..., :2] / h[..., 2:] - problem.visual.xy)


def rest_residuals(problem: Problem, point: Point) -> Array:
    """Whitened, (..., 18 n), of the n intervals at rest: what moved, in the first body's axes, and rates."""
    i = np.flatnonzero(problem.zero_velocity.present)
    begin, end = point.T[..., i, :, :], point.T[..., i + 1, :, :]
    back = np.swapaxes(begin[..., :3, :3], -1, -2)
    turned = log_so3(back @ end[..., :3, :3])
    gone = times(back, end[..., :3, 3] - begin[..., :3, 3])
    rates = [point.varpi[..., k, 0, :] for k in (i, i + 1)]
    return _rows(
        np.concatenate([turned, gone, *rates], axis=-1) * problem.zero_velocity.root_information[i], 2
    )


def prior_residuals(prior: Prior, point: Point) -> Array:
    lin, m = prior.linearization, len(prior.linearization.r)
    pose = log_se3(np.linalg.inv(poses(lin)) @ point.T[..., :m, :, :])
    rates = _rows(point.varpi[..., :m, :, :] - lin.varpi, 2)
    delta = _rows(np.concatenate([pose, rates, point.bias[..., :m, :] - lin.bias], axis=-1), 2)
    if prior.camera is not None:
        delta = np.concatenate([delta, camera_error(point, prior.camera)], axis=-1)
    if prior.imu is not None:
        changed = (point.correction - prior.imu.coordinates)[..., point.imu_columns]
        delta = np.concatenate([delta, changed], axis=-1)
    return times(prior.R, delta) + prior.r_0


def camera_error(point: Point, linearization: Camera) -> Array:
    """(..., c) of what is estimated of the camera."""
    turn = log_so3(linearization.C_bc.T @ point.C_bc)
    offset = point.offset - linearization.time_offset
    return np.asarray(np.concatenate([offset[..., None], turn], axis=-1)[..., point.columns])


def residuals(problem: Problem, prior: Prior | None, point: Point, weights: Array | None = None) -> Array:
    """All rows; `weights` (M,) are robust weights of the observations, whose rows come last."""
    local = local_variables(problem, point)
    visual = reprojection_residuals(problem, local, point)
    if weights is not None:
        visual = visual * np.sqrt(weights)[:, None]
    rows = [
        *motion_residuals(problem, local, point.bias),
        gyroscope_residuals(problem, local, point),
        accelerometer_residuals(problem, local, point),
        _rows(visual, 2),
    ]
    if problem.preintegrated.present.any():
        rows.insert(0, preintegration_residuals(problem, point.T, point.varpi, point.bias))
    if problem.zero_velocity.present.any():
        rows.insert(0, rest_residuals(problem, point))
    if prior is not None:
        rows.insert(0, prior_residuals(prior, point))
    return np.concatenate(rows, axis=-1)


def jacobian(problem: Problem, prior: Prior | None, point: Point, weights: Array | None = None) -> Array:
    steps = _STEP * np.eye(point.size)
    columns = []
    for some in np.array_split(steps, math.ceil(point.size / _AT_ONCE)):
        ahead, behind = (residuals(problem, prior, point.moved(s * some), weights) for s in (1.0, -1.0))
        columns.append((ahead - behind) / (2.0 * _STEP))
    return np.concatenate(columns).T


@dataclass(frozen=True)
class Normal:
    """Dense normal equations `H`, gradient `b`, and the cost; knots (24 K) first, then the coordinates of
    camera and IMU (`behind`), then landmarks."""

    H: Array
    b: Array
    cost: float
    knots: int
    behind: int = 0

    def damped(self, damping: Array) -> Normal:
        """With information `damping` (dof,) on the diagonal of every landmark."""
        H, n = self.H.copy(), 24 * self.knots + self.behind
        H[n:, n:] += np.diag(np.tile(damping, (len(H) - n) // len(damping)))
        return Normal(H, self.b, self.cost, self.knots, self.behind)

    def reduced(self) -> tuple[Array, Array]:
        """Schur complement of the landmarks."""
        return schur(self.H, self.b, 24 * self.knots + self.behind)


def schur(H: Array, b: Array, n: int) -> tuple[Array, Array]:
    """Information and gradient that the rest leaves for the first n unknowns."""
    if n == len(H):
        return H, b
    gain = np.linalg.solve(H[n:, n:], H[n:, :n])
    return H[:n, :n] - H[:n, n:] @ gain, b[:n] - gain.T @ b[n:]


def normal_equations(problem: Problem, prior: Prior | None = None, weights: Array | None = None) -> Normal:
    """Jacobian at the linearisation point, residual at the states."""
    r = residuals(problem, prior, at(problem.states, problem), weights)
    J = jacobian(problem, prior, at(problem.linearization, problem), weights)
    behind = len(problem.camera.columns) + len(problem.imu.columns)
    return Normal(J.T @ J, J.T @ r, 0.5 * float(r @ r), len(problem.states.r), behind)


def unknowns(problem: Problem) -> NDArray[np.int64]:
    """Indices of what may move: the active coordinates of every knot, those of camera and IMU, then the
    landmarks."""
    knots, model = len(problem.states.r), problem.model
    of_knots = [24 * k + c for k in range(knots) for c in model.active]
    behind = len(problem.camera.columns) + len(problem.imu.columns)
    landmarks = model.landmark_dof * len(problem.landmarks.rho)
    return np.r_[of_knots, 24 * knots + np.arange(behind + landmarks)]


def gauss_newton(problem: Problem, prior: Prior, iterations: int) -> tuple[Point, float]:
    """Minimum of the whole problem in all unknowns at once, and its cost."""
    point = at(problem.states, problem)
    free = unknowns(problem)
    for _ in range(iterations):
        J, r = jacobian(problem, prior, point)[:, free], residuals(problem, prior, point)
        scale = 1.0 / np.linalg.norm(J, axis=0)
        Q, R = np.linalg.qr(J * scale)
        step = np.zeros(point.size)
        step[free] = -scale * np.linalg.solve(R, Q.T @ r)
        point = point.moved(step)
    r = residuals(problem, prior, point)
    return point, 0.5 * float(r @ r)


def global_motions(states: States) -> Array:
    """What nothing in a window observes, as motions of its knots (24 K, 4): translations, then yaw."""
    C, r = states.C, states.r
    up = np.array([0.0, 0.0, 1.0])
    out = np.zeros((len(r), 24, 4))
    out[:, 3:6, :3] = np.swapaxes(C, 1, 2)
    out[:, :3, 3] = up @ C
    out[:, 3:6, 3] = np.einsum("kji,kj->ki", C, np.cross(up, r))
    return out.reshape(-1, 4)


def scaled(H: Array, reference: Array) -> Array:
    """`H` in units of the standard deviations in `reference`: entries of all blocks become comparable."""
    root = np.sqrt(reference.diagonal())
    root = np.where(root > 0.0, root, 1.0)
    return H / np.outer(root, root)
