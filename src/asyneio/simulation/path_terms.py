# SPDX-License-Identifier: Apache-2.0
"""Residuals of a spline of position and quaternion for poses and samples, with derivatives.

Quaternions are xyzw. For unit p, vec(p^-1 q) = L(p) q = -L(q) p with L(p) = [p_w I - [p_v]x, -p_v].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.simulation.path_basis import ACTIVE, UniformKnots
from asyneio.simulation.path_normal import EACH, Terms
from asyneio.types import FloatArray, IntArray

#: Number of unknowns except control points and biases: clock offset, gravity.
COMMON = 4


@dataclass(frozen=True)
class Readings:
    """Readings (N,k) at ascending times (N,) [s]."""

    t_s: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class PathState:
    """All unknowns: control points (n,7), clock offset [s], gravity (3,), and biases (2,K,3) of gyroscope and
    accelerometer at nodes with the spacing `node_s` [s]."""

    control: FloatArray
    clock_s: float
    gravity: FloatArray
    biases: FloatArray
    node_s: float

    def stepped(self, control: FloatArray, others: FloatArray) -> PathState:
        """This state plus a step."""
        return PathState(
            self.control + control,
            self.clock_s + float(others[0]),
            self.gravity + others[1:COMMON],
            self.biases + others[COMMON:].reshape(self.biases.shape),
            self.node_s,
        )

    def bias(self, sensor: int, t_s: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Bias (N,3) of a sensor at times (N,), its unknowns (N,6), and its derivative by them (N,3,6)."""
        nodes = self.biases.shape[1]
        node = np.clip((t_s / self.node_s).astype(np.int64), 0, nodes - 2)
        share = (t_s / self.node_s - node)[:, None]
        bias = (1.0 - share) * self.biases[sensor, node] + share * self.biases[sensor, node + 1]
        begin = COMMON + 3 * (sensor * nodes + node)
        parts = [part[..., None] * np.eye(3) for part in (1.0 - share, share)]
        return bias, begin[:, None] + np.arange(6), np.concatenate(parts, axis=2)


def gyroscope_terms(knots: UniformKnots, gyroscope: Readings, state: PathState) -> Terms:
    """`2 vec(q^-1 q') / |q|^2 + b - measured` [rad/s]."""
    first, weights = knots.weights(gyroscope.t_s, 1)
    q, q1 = (_spline(weights[nu], first, state.control)[:, 3:] for nu in (0, 1))
    square = np.sum(q * q, axis=1)[:, None]
    rate = 2.0 * _vector(q, q1) / square
    bias, columns, K = state.bias(0, gyroscope.t_s)
    by_q = -2.0 * (_left(q1) / square[..., None] + rate[:, :, None] * (q / square)[:, None, :])
    by_q1 = 2.0 * _left(q) / square[..., None]
    J = np.zeros((first.size, 3, ACTIVE, EACH))
    J[..., 3:] = _by_control(by_q, weights[0]) + _by_control(by_q1, weights[1])
    return Terms(rate + bias - gyroscope.values, first, _flat(J), columns, K)


def accelerometer_terms(knots: UniformKnots, accelerometer: Readings, state: PathState) -> Terms:
    """`C(q)^T (p'' - g) + b - measured` [m/s^2]."""
    first, weights = knots.weights(accelerometer.t_s, 2)
    q = _spline(weights[0], first, state.control)[:, 3:]
    acceleration = _spline(weights[2], first, state.control)[:, :3]
    C_b_w = np.swapaxes(Rotation.from_quat(q).as_matrix(), 1, 2)
    force = np.einsum("nij,nj->ni", C_b_w, acceleration - state.gravity)
    bias, columns, by_bias = state.bias(1, accelerometer.t_s)
    J = np.zeros((first.size, 3, ACTIVE, EACH))
    J[..., :3] = _by_control(C_b_w, weights[2])
    # A rotation of the body by d changes C^T f by [C^T f]x d, and d = 2 L(q) dq / |q|^2.
    square = np.sum(q * q, axis=1)[:, None, None]
    J[..., 3:] = _by_control(_cross(force) @ (2.0 * _left(q) / square), weights[0])
    columns = np.hstack([np.tile(np.arange(1, COMMON), (first.size, 1)), columns])
    K = np.concatenate([-C_b_w, by_bias], axis=2)
    return Terms(force + bias - accelerometer.values, first, _flat(J), columns, K)


def pose_terms(knots: UniformKnots, poses: Readings, state: PathState) -> Terms:
    """Position [m] and orientation [rad] of the spline at the timestamps plus the clock offset, minus those
    of the poses (values (N,7): position, unit quaternion)."""
    t_s = np.clip(poses.t_s + state.clock_s, 0.0, knots.intervals * knots.step_s)
    first, weights = knots.weights(t_s, 1)
    at, rate = (_spline(weights[nu], first, state.control) for nu in (0, 1))
    measured = poses.values[:, 3:]
    # q and -q are the same orientation.
    sign = np.sign(np.sum(measured * at[:, 3:], axis=1))[:, None]
    square = np.sum(at[:, 3:] ** 2, axis=1)[:, None]
    turn = 2.0 * sign / np.sqrt(square)
    orientation = turn * _vector(measured, at[:, 3:])
    by_q = turn[..., None] * _left(measured) - orientation[:, :, None] * (at[:, 3:] / square)[:, None, :]
    J = np.zeros((first.size, 6, ACTIVE, EACH))
    J[:, :3, :, :3] = _by_control(np.tile(np.eye(3), (first.size, 1, 1)), weights[0])
    J[:, 3:, :, 3:] = _by_control(by_q, weights[0])
    r = np.hstack([at[:, :3] - poses.values[:, :3], orientation])
    K = np.hstack([rate[:, :3], np.einsum("nij,nj->ni", by_q, rate[:, 3:])])[..., None]
    return Terms(r, first, _flat(J), np.zeros((first.size, 1), dtype=np.int64), K)


def length_terms(knots: UniformKnots, state: PathState) -> Terms:
    """`|q|^2 - 1`, twice per interval, because the norm of the quaternion is not measured."""
    t_s = np.asarray((np.arange(2 * knots.intervals) + 0.5) * 0.5 * knots.step_s, dtype=np.float64)
    first, weights = knots.weights(t_s, 0)
    q = _spline(weights[0], first, state.control)[:, 3:]
    J = np.zeros((first.size, 1, ACTIVE, EACH))
    J[..., 3:] = _by_control(2.0 * q[:, None, :], weights[0])
    none = np.zeros((first.size, 0), dtype=np.int64)
    r = np.sum(q * q, axis=1)[:, None] - 1.0
    return Terms(r, first, _flat(J), none, np.zeros((first.size, 1, 0)))


def _spline(weights: FloatArray, first: IntArray, control: FloatArray) -> FloatArray:
    """Values (N,7) with weights (N,6) of the control points from `first` (N,) on."""
    return np.einsum("nm,nmk->nk", weights, control[first[:, None] + np.arange(ACTIVE)])


def _by_control(D: FloatArray, weights: FloatArray) -> FloatArray:
    """Derivatives (N,k,6,c) by control points, given D (N,k,c) by their sum with weights (N,6)."""
    return D[:, :, None, :] * weights[:, None, :, None]


def _flat(J: FloatArray) -> FloatArray:
    return J.reshape(J.shape[0], J.shape[1], ACTIVE * EACH)


def _left(p: FloatArray) -> FloatArray:
    """L(p) (N,3,4) of quaternions (N,4)."""
    return np.concatenate([p[:, 3, None, None] * np.eye(3) - _cross(p), -p[:, :3, None]], axis=2)


def _vector(p: FloatArray, q: FloatArray) -> FloatArray:
    """vec(p^-1 q) (N,3) of quaternions (N,4)."""
    return np.einsum("nij,nj->ni", _left(p), q)


def _cross(v: FloatArray) -> FloatArray:
    """Matrices (N,3,3) of the cross product with the first three of v (N,k)."""
    x, y, z = v[:, 0], v[:, 1], v[:, 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
