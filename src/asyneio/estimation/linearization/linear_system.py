# SPDX-License-Identifier: Apache-2.0
"""Linearisation of the window (39): normal equations of the knots and of the calibration of camera and IMU;
landmarks are kept separate for their Schur complement (`elimination.py`).

Jacobians are evaluated at `problem.linearization`, residuals at `problem.states`: the two differ for knots
that the marginal prior has frozen (first-estimates Jacobians).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.estimation.linearization.corrections import (
    NO_CORRECTION_SUMS,
    CorrectionSums,
    correction_sums,
    move_correction,
)
from asyneio.estimation.linearization.couplings import Couplings
from asyneio.estimation.linearization.interval import (
    InertialSums,
    accelerometer_terms,
    gyroscope_terms,
    interval_chains,
    interval_locals,
    motion_terms,
)
from asyneio.estimation.linearization.preintegrated import preintegration_terms
from asyneio.estimation.linearization.propagated import propagated_terms
from asyneio.estimation.linearization.visual import visual_terms
from asyneio.estimation.linearization.visual_sums import NO_SUMS, VisualSums, empty_sums
from asyneio.estimation.linearization.zero_velocity import zero_velocity_terms
from asyneio.estimation.problem.problem import Problem
from asyneio.jit import njit
from asyneio.state import BIAS, BIAS_0, BIAS_1, DOF, EPS, KINEMATIC_DOF, LOCAL_DOF, VARPI, XI, XI_DDOT_0
from asyneio.types import BoolArray, FloatArray


class LinearSystem(NamedTuple):
    """Normal equations. `H` (24K+c+s,24K+c+s) symmetric, `b` (24K+c+s,) gradient: K knots, then the c
    coordinates of the camera and the s of the IMU that are estimated.

    Landmarks: `W` coupling with the coordinates `Model.landmark_columns` of the knots, `H_l` (L,3,3), `b_l`
    (L,3), `W_camera` (L,dof,c) coupling with the camera. `cost` is the total, `visual_cost` that of the
    observations, `squared` (M,) the squared norms of their whitened residuals, infinite behind the camera;
    `rejected` of them had no influence.
    """

    H: FloatArray
    b: FloatArray
    W: Couplings
    H_l: FloatArray
    b_l: FloatArray
    W_camera: FloatArray
    cost: float
    visual_cost: float
    rejected: int
    squared: FloatArray


def linearize(problem: Problem) -> LinearSystem:
    """Normal equations of all factors except the marginal prior, which the caller adds."""
    knots = len(problem.states.r)
    local, local_lin = _locals(problem)
    needed = _needed(problem)
    chain = np.zeros((knots - 1, LOCAL_DOF, LOCAL_DOF))
    interval_chains(problem.linearization, needed, problem.model.motion_model.space, chain)
    H_local, b_local = np.zeros((knots - 1, LOCAL_DOF, LOCAL_DOF)), np.zeros((knots - 1, LOCAL_DOF))
    sums = empty_sums(problem)
    size = DOF * knots + len(problem.camera.columns) + len(problem.imu.columns)
    H, b = np.zeros((size, size)), np.zeros(size)
    by_interval, by_knot = (H_local, b_local), (H, b)
    squared = np.empty(len(problem.visual.tau))
    corrections = correction_sums(problem.imu.columns, knots - 1)
    cost, visual_cost, rejected = _terms(
        problem, local, local_lin, chain, True, by_interval, by_knot, sums, corrections, squared
    )
    _move_to_knots(needed, chain, H_local, b_local, sums, H, b)
    begin = size - len(problem.imu.columns)
    for correction in corrections:
        move_correction(correction, chain, begin, H, b)
        begin += len(correction.b)
    return LinearSystem(H, b, sums.W, sums.H_l, sums.b_l, sums.W_camera, cost, visual_cost, rejected, squared)


def evaluate_cost(problem: Problem) -> float:
    """Cost of all factors except the marginal prior."""
    return evaluate(problem)[0]


def evaluate(problem: Problem) -> tuple[float, FloatArray]:
    """Cost of all factors except the marginal prior, and the observations' `LinearSystem.squared`."""
    squared = np.empty(len(problem.visual.tau))
    local = np.empty((len(problem.states.r) - 1, 5, 6))
    interval_locals(problem.states, problem.model.motion_model.space, local)
    by_interval = (np.zeros((0, LOCAL_DOF, LOCAL_DOF)), np.zeros((0, LOCAL_DOF)))
    by_knot = (np.zeros((0, 0)), np.zeros(0))
    chain, corrections = by_interval[0], (NO_CORRECTION_SUMS, NO_CORRECTION_SUMS)
    cost, *_ = _terms(
        problem, local, local, chain, False, by_interval, by_knot, NO_SUMS, corrections, squared
    )
    return cost, squared


def _terms(
    problem: Problem,
    local: FloatArray,
    local_lin: FloatArray,
    chain: FloatArray,
    with_jacobian: bool,
    by_interval: tuple[FloatArray, FloatArray],
    by_knot: tuple[FloatArray, FloatArray],
    sums: VisualSums,
    corrections: tuple[CorrectionSums, CorrectionSums],
    squared: FloatArray,
) -> tuple[float, float, int]:
    """Terms of the cost (39): the total, that of the observations, number of observations without influence.

    Adds to the sums in the intervals' local coordinates and to those in the knots' coordinates.
    """
    states = problem.states
    H, b = by_interval
    cost = motion_terms(problem, local, with_jacobian, H, b)
    gyroscope, accelerometer = (InertialSums(H, b, correction) for correction in corrections)
    cost += gyroscope_terms(problem.gyroscope, states.bias, local, local_lin, with_jacobian, gyroscope)
    cost += accelerometer_terms(
        problem.accelerometer,
        states,
        problem.linearization,
        problem.model.gravity_w,
        problem.model.motion_model.space,
        local,
        local_lin,
        with_jacobian,
        accelerometer,
    )
    if len(problem.preintegrated.present):
        cost += preintegration_terms(problem, with_jacobian, *by_knot)
    if len(problem.zero_velocity.present):
        cost += zero_velocity_terms(problem, with_jacobian, *by_knot)
    if len(problem.propagated.tau):
        visual, rejected = propagated_terms(problem, with_jacobian, *by_knot, sums, squared)
    else:
        visual, rejected = visual_terms(problem, local, local_lin, chain, with_jacobian, H, b, sums, squared)
    return float(cost + visual), float(visual), int(rejected)


def _locals(problem: Problem) -> tuple[FloatArray, FloatArray]:
    local = np.empty((len(problem.states.r) - 1, 5, 6))
    space = problem.model.motion_model.space
    interval_locals(problem.states, space, local)
    if problem.frozen == 0:
        return local, local
    local_lin = np.empty_like(local)
    interval_locals(problem.linearization, space, local_lin)
    return local, local_lin


def _needed(problem: Problem) -> BoolArray:
    """Intervals that contain any factor."""
    counts = sum(np.diff(m.start) for m in (problem.gyroscope, problem.accelerometer, problem.visual))
    return np.asarray(problem.motion | (counts > 0))


# The loops over the non-zero blocks of the chain are written out: four levels, no temporary matrix.
@njit(cache=True, nogil=True)
def _move_to_knots(  # noqa: C901
    needed: BoolArray,
    chain: FloatArray,
    H_local: FloatArray,
    b_local: FloatArray,
    sums: VisualSums,
    H: FloatArray,
    b: FloatArray,
) -> None:
    """Add the sums of all intervals, anchors and the camera to the knots' coordinates."""
    camera = sums.b_camera.shape[0]
    at = DOF * sums.H_pose.shape[0]
    moved = np.empty((LOCAL_DOF, LOCAL_DOF))
    border = np.empty((LOCAL_DOF, camera))
    half = np.empty((LOCAL_DOF, LOCAL_DOF))
    cross = np.empty((LOCAL_DOF, 6))
    for k in range(sums.H_pose.shape[0]):
        for i in range(6):
            b[DOF * k + i] += sums.b_pose[k, i]
            for j in range(6):
                H[DOF * k + i, DOF * k + j] += sums.H_pose[k, i, j]
    for c in range(camera):
        b[at + c] += sums.b_camera[c]
        for d in range(camera):
            H[at + c, at + d] += sums.H_camera[c, d]
        for k in range(sums.pose_camera.shape[0]):
            for p in range(6):
                H[DOF * k + p, at + c] += sums.pose_camera[k, p, c]
                H[at + c, DOF * k + p] += sums.pose_camera[k, p, c]
    for i in range(needed.shape[0]):
        if not needed[i]:
            continue
        o = DOF * i
        C = chain[i]
        _right_times_chain(H_local[i], C, half)
        _chain_transposed_times(C, half, moved)
        for p in range(48):
            for q in range(48):
                H[o + p, o + q] += moved[p, q]
            s = 0.0
            for q in range(48):
                s += C[q, p] * b_local[i, q]
            b[o + p] += s
        if camera > 0:
            _chain_transposed_times(C, sums.local_camera[i], border)
            for p in range(48):
                for c in range(camera):
                    H[o + p, at + c] += border[p, c]
                    H[at + c, o + p] += border[p, c]
        for a in range(sums.touched.shape[1]):
            if not sums.touched[i, a]:
                continue
            _chain_transposed_times(C, sums.H_anchor[i, a], cross)
            for p in range(48):
                for q in range(6):
                    H[o + p, DOF * a + q] += cross[p, q]
                    H[DOF * a + q, o + p] += cross[p, q]


# Blocks of the chain, d (local coordinates) / d (knots k and k + 1), that are not zero. It is the identity
# from the first knot's own coordinates and from the biases of both knots. The rows of xi, xi_dot and xi_ddot
# depend on the pose of the first knot and on the second knot. On SO(3) x R^3 the acceleration at the first
# knot depends on its velocity too.
_ROWS = (XI, BIAS_0)
_FIRST_POSE = (EPS, VARPI)
_SECOND_KNOT = (DOF, DOF + KINEMATIC_DOF)
_ACCELERATION_ROWS = (XI_DDOT_0 + 3, XI)
_FIRST_VELOCITY = (VARPI, VARPI + 6)
#: First and last row, then first and last column, of each block.
_BLOCKS = (
    (_ACCELERATION_ROWS, _FIRST_VELOCITY),
    (_ROWS, _FIRST_POSE),
    (_ROWS, _SECOND_KNOT),
)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _right_times_chain(H: FloatArray, chain: FloatArray, out: FloatArray) -> None:
    """`out = H chain` (48,48)."""
    for p in range(LOCAL_DOF):
        for q in range(LOCAL_DOF):
            out[p, q] = 0.0
        for q in range(KINEMATIC_DOF):
            out[p, q] = H[p, q]
        for q in range(6):
            out[p, BIAS + q] = H[p, BIAS_0 + q]
            out[p, DOF + BIAS + q] = H[p, BIAS_1 + q]
        for rows, columns in _BLOCKS:
            for m in range(rows[0], rows[1]):
                v = H[p, m]
                for q in range(columns[0], columns[1]):
                    out[p, q] += v * chain[m, q]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _chain_transposed_times(chain: FloatArray, X: FloatArray, out: FloatArray) -> None:
    """`out = chain^T X` for X (48,n), or (36,n) where the rows of the biases are zero."""
    n = X.shape[1]
    for p in range(LOCAL_DOF):
        for q in range(n):
            out[p, q] = X[p, q] if p < KINEMATIC_DOF else 0.0
    if X.shape[0] == LOCAL_DOF:
        for p in range(6):
            for q in range(n):
                out[BIAS + p, q] = X[BIAS_0 + p, q]
                out[DOF + BIAS + p, q] = X[BIAS_1 + p, q]
    for rows, columns in _BLOCKS:
        for m in range(rows[0], rows[1]):
            for p in range(columns[0], columns[1]):
                v = chain[m, p]
                if v == 0.0:
                    continue
                for q in range(n):
                    out[p, q] += v * X[m, q]
