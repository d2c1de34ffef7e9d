# SPDX-License-Identifier: Apache-2.0
"""Scale factors and misalignment of the inertial sensors (`inertial_calibration`) in the normal equations:
sums over the factors (21)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.estimation.linearization.interval import whiten
from asyneio.estimation.problem.inertial_calibration import DIRECTIONS, GYROSCOPE_DOF
from asyneio.estimation.problem.problem import Inertial, Problem, States
from asyneio.factors.gp_inertial import (
    accelerometer_jacobian,
    accelerometer_residual,
    gyroscope_jacobian,
    gyroscope_residual,
)
from asyneio.state import DOF, LOCAL_DOF
from asyneio.types import FloatArray


def add_correction_terms(
    problem: Problem,
    local: FloatArray,
    local_lin: FloatArray,
    chain: FloatArray,
    H: FloatArray,
    b: FloatArray,
) -> None:
    """Add rows and columns of the IMU's coordinates, the last ones of `H` (24K+c+s,24K+c+s), `b` (24K+c+s,).

    `local`, `local_lin` (I,5,6) are the intervals' local coordinates, of the states and of the linearisation
    point; `chain` (I,48,48) transforms from them to the knots.
    """
    states, linearization, model = problem.states, problem.linearization, problem.model
    columns = problem.imu.columns
    split = int(np.searchsorted(columns, GYROSCOPE_DOF))
    begin = len(b) - len(columns)
    for mine, at in ((columns[:split], begin), (columns[split:], begin + split)):
        size = len(mine)
        if size == 0:
            continue
        directions = np.ascontiguousarray(DIRECTIONS[mine])
        border = np.zeros((len(local), LOCAL_DOF, size))
        own, slope = np.zeros((size, size)), np.zeros(size)
        sums = CorrectionSums(directions, border, own, slope)
        if mine[0] < GYROSCOPE_DOF:
            gyroscope_correction(problem.gyroscope, states.bias, local, local_lin, sums)
        else:
            fields = (model.gravity_w, model.motion_model.space, local, local_lin)
            accelerometer_correction(problem.accelerometer, states, linearization, *fields, sums)
        end = at + size
        H[at:end, at:end] += own
        b[at:end] += slope
        for i, moved in enumerate(chain.transpose(0, 2, 1) @ border):
            first, last = DOF * i, DOF * (i + 2)
            H[first:last, at:end] += moved
            H[at:end, first:last] += moved.T


class CorrectionSums(NamedTuple):
    """Normal equations of the s coordinates of one sensor, and their directions."""

    directions: FloatArray  # (s,3,3) what a unit of each coordinate adds to E
    border: FloatArray  # (I,48,s) local coordinates of the intervals against them
    H: FloatArray  # (s,s)
    b: FloatArray  # (s,)


@njit(cache=True, nogil=True)
def gyroscope_correction(
    samples: Inertial, bias: FloatArray, local: FloatArray, local_lin: FloatArray, sums: CorrectionSums
) -> None:
    """Add all samples of the gyroscope to `sums`; `bias` (K,6)."""
    most = samples.root_information.shape[1]
    residual = np.empty((most, 3))
    jacobian = np.empty((most, 3, LOCAL_DOF))
    for i in range(local.shape[0]):
        begin, end = samples.start[i], samples.start[i + 1]
        for n in range(begin, end):
            value, weights, alpha, k = samples.value[n], samples.weights[n], samples.alpha[n], n - begin
            gyroscope_residual(value, local[i], weights, bias[i : i + 2], alpha, residual[k])
            gyroscope_jacobian(local_lin[i], weights, alpha, jacobian[k])
        root = samples.root_information[begin:end]
        whiten(root, residual, jacobian, True)
        _accumulate(root, samples.smooth[begin:end], residual, jacobian, i, sums)


@njit(cache=True, nogil=True)
def accelerometer_correction(
    samples: Inertial,
    states: States,
    linearization: States,
    gravity_w: FloatArray,
    space: int,
    local: FloatArray,
    local_lin: FloatArray,
    sums: CorrectionSums,
) -> None:
    """Add all samples of the accelerometer to `sums`."""
    most = samples.root_information.shape[1]
    residual = np.empty((most, 3))
    jacobian = np.empty((most, 3, LOCAL_DOF))
    for i in range(local.shape[0]):
        begin, end = samples.start[i], samples.start[i + 1]
        biases = states.bias[i : i + 2]
        C, C_lin = states.C[i], linearization.C[i]
        for n in range(begin, end):
            value, weights, alpha, k = samples.value[n], samples.weights[n], samples.alpha[n], n - begin
            accelerometer_residual(value, C, local[i], weights, biases, alpha, gravity_w, space, residual[k])
            accelerometer_jacobian(C_lin, local_lin[i], weights, alpha, gravity_w, space, jacobian[k])
        root = samples.root_information[begin:end]
        whiten(root, residual, jacobian, True)
        _accumulate(root, samples.smooth[begin:end], residual, jacobian, i, sums)


@njit(cache=True, nogil=True)
def _accumulate(
    root: FloatArray,
    smooth: FloatArray,
    residual: FloatArray,
    jacobian: FloatArray,
    i: int,
    sums: CorrectionSums,
) -> None:
    """Add interval i: `residual` (n,3) and `jacobian` (n,3,48) are whitened, `smooth` (n,3) is not."""
    directions, border, H, b = sums.directions, sums.border[i], sums.H, sums.b
    size = directions.shape[0]
    white = np.empty(3)
    row = np.empty((3, size))
    for n in range(root.shape[0]):
        for a in range(3):
            white[a] = 0.0
            for m in range(n + 1):
                white[a] += root[n, m] * smooth[m, a]
        for p in range(size):
            for a in range(3):
                row[a, p] = -(
                    directions[p, a, 0] * white[0]
                    + directions[p, a, 1] * white[1]
                    + directions[p, a, 2] * white[2]
                )
        for a in range(3):
            for p in range(size):
                v = row[a, p]
                if v == 0.0:
                    continue
                b[p] += v * residual[n, a]
                for q in range(size):
                    H[p, q] += v * row[a, q]
                for k in range(LOCAL_DOF):
                    border[k, p] += jacobian[n, a, k] * v
