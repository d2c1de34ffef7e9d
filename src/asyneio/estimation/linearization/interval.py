# SPDX-License-Identifier: Apache-2.0
"""Sums over the factors inside each interval, in the interval's local coordinates (48).

Each kernel is a top-level stage of `linear_system.linearize`, because shallow call trees compile in seconds
and deep ones in minutes. `H` (I,48,48) and `b` (I,48) are accumulated in place; residuals are evaluated at
`local`, Jacobians at `local_lin` (they differ for frozen knots). Every stage returns its cost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.estimation.linearization.corrections import CorrectionSums, add_correction
from asyneio.estimation.problem.problem import Inertial, Model, Problem, States
from asyneio.factors.bias import bias_factor
from asyneio.factors.gp_inertial import (
    accelerometer_jacobian,
    accelerometer_residual,
    gyroscope_jacobian,
    gyroscope_residual,
)
from asyneio.factors.gp_prior import gp_prior_coefficients, gp_prior_factor
from asyneio.factors.local_frame import local_to_knots
from asyneio.jit import njit
from asyneio.state import BIAS_0, BIAS_1, LOCAL_DOF, XI_DOT_0
from asyneio.trajectory.interpolation import interval_local
from asyneio.types import BoolArray, FloatArray


class InertialSums(NamedTuple):
    """What the samples of a sensor are added to, I intervals."""

    H: FloatArray  # (I,48,48) local coordinates of the intervals
    b: FloatArray  # (I,48)
    correction: CorrectionSums  # scale factors and misalignment of the sensor


@njit(cache=True, nogil=True)
def interval_locals(states: States, space: int, out: FloatArray) -> None:
    """End quantities `out` (I,5,6) of all intervals."""
    for i in range(out.shape[0]):
        interval_local(
            states.C[i],
            states.r[i],
            states.varpi[i],
            states.C[i + 1],
            states.r[i + 1],
            states.varpi[i + 1],
            space,
            out[i],
        )


@njit(cache=True, nogil=True)
def interval_chains(states: States, needed: BoolArray, space: int, out: FloatArray) -> None:
    """`local_to_knots` of the needed intervals: `out` (I,48,48)."""
    for i in range(out.shape[0]):
        if needed[i]:
            local_to_knots(
                states.C[i],
                states.r[i],
                states.varpi[i],
                states.C[i + 1],
                states.r[i + 1],
                states.varpi[i + 1],
                space,
                out[i],
            )


@njit(cache=True, nogil=True)
def motion_terms(
    problem: Problem, local: FloatArray, with_jacobian: bool, H: FloatArray, b: FloatArray
) -> float:
    """Motion prior (16), if any, and bias walk (24) of the intervals in `problem.motion`: linear in the
    local coordinates."""
    model, bias = problem.model, problem.states.bias
    coefficients = np.empty((3, 5))
    residual = np.empty((3, 6))
    bias_residual = np.empty(6)
    cost = 0.0
    for i in range(local.shape[0]):
        if not problem.motion[i]:
            continue
        bias_factor(bias[i], bias[i + 1], model.bias_walk, model.dt[i], bias_residual)
        for j in range(6):
            cost += 0.5 * bias_residual[j] ** 2
        if with_jacobian:
            _add_bias(bias_residual, model, i, H[i], b[i])
        if not model.kinematic_prior:
            continue
        gp_prior_coefficients(model.dt[i], model.motion_model.prior, coefficients)
        gp_prior_factor(local[i], coefficients, model.root_density, residual)
        for j in range(6):
            for a in range(3):
                cost += 0.5 * residual[a, j] ** 2
        if with_jacobian:
            _add_gp_prior(coefficients, residual, model.root_density, H[i], b[i])
    return cost


@njit(cache=True, nogil=True)
def _add_gp_prior(
    coefficients: FloatArray, residual: FloatArray, root_density: FloatArray, H: FloatArray, b: FloatArray
) -> None:
    for p in range(5):
        for j in range(6):
            for a in range(3):
                b[XI_DOT_0 + 6 * p + j] += coefficients[a, p] * residual[a, j] / root_density[j]
        for q in range(5):
            s = 0.0
            for a in range(3):
                s += coefficients[a, p] * coefficients[a, q]
            for j in range(6):
                H[XI_DOT_0 + 6 * p + j, XI_DOT_0 + 6 * q + j] += s / root_density[j] ** 2


@njit(cache=True, nogil=True)
def _add_bias(residual: FloatArray, model: Model, i: int, H: FloatArray, b: FloatArray) -> None:
    for j in range(6):
        w = 1.0 / (model.bias_walk[j] * np.sqrt(model.dt[i]))
        H[BIAS_0 + j, BIAS_0 + j] += w * w
        H[BIAS_1 + j, BIAS_1 + j] += w * w
        H[BIAS_0 + j, BIAS_1 + j] -= w * w
        H[BIAS_1 + j, BIAS_0 + j] -= w * w
        b[BIAS_0 + j] -= w * residual[j]
        b[BIAS_1 + j] += w * residual[j]


@njit(cache=True, nogil=True)
def gyroscope_terms(
    samples: Inertial,
    bias: FloatArray,
    local: FloatArray,
    local_lin: FloatArray,
    with_jacobian: bool,
    sums: InertialSums,
) -> float:
    """Gyroscope samples (21); `bias` (K,6)."""
    most = samples.root_information.shape[1]
    residual = np.empty((most, 3))
    jacobian = np.empty((most, 3, LOCAL_DOF))
    cost = 0.0
    for i in range(local.shape[0]):
        begin, end = samples.start[i], samples.start[i + 1]
        for n in range(begin, end):
            weights, alpha = samples.weights[n], samples.alpha[n]
            gyroscope_residual(
                samples.value[n], local[i], weights, bias[i : i + 2], alpha, residual[n - begin]
            )
            if with_jacobian:
                gyroscope_jacobian(local_lin[i], weights, alpha, jacobian[n - begin])
        root = samples.root_information[begin:end]
        cost += whiten(root, residual, jacobian, with_jacobian)
        if with_jacobian:
            _add_samples(residual[: end - begin], jacobian, i, sums)
            add_correction(root, samples.smooth[begin:end], residual, jacobian, i, sums.correction)
    return cost


@njit(cache=True, nogil=True)
def accelerometer_terms(
    samples: Inertial,
    states: States,
    linearization: States,
    gravity_w: FloatArray,
    space: int,
    local: FloatArray,
    local_lin: FloatArray,
    with_jacobian: bool,
    sums: InertialSums,
) -> float:
    """Accelerometer samples (21)."""
    most = samples.root_information.shape[1]
    residual = np.empty((most, 3))
    jacobian = np.empty((most, 3, LOCAL_DOF))
    cost = 0.0
    for i in range(local.shape[0]):
        begin, end = samples.start[i], samples.start[i + 1]
        for n in range(begin, end):
            weights, alpha = samples.weights[n], samples.alpha[n]
            accelerometer_residual(
                samples.value[n],
                states.C[i],
                local[i],
                weights,
                states.bias[i : i + 2],
                alpha,
                gravity_w,
                space,
                residual[n - begin],
            )
            if with_jacobian:
                accelerometer_jacobian(
                    linearization.C[i], local_lin[i], weights, alpha, gravity_w, space, jacobian[n - begin]
                )
        root = samples.root_information[begin:end]
        cost += whiten(root, residual, jacobian, with_jacobian)
        if with_jacobian:
            _add_samples(residual[: end - begin], jacobian, i, sums)
            add_correction(root, samples.smooth[begin:end], residual, jacobian, i, sums.correction)
    return cost


@njit(cache=True, nogil=True)
def _add_samples(residual: FloatArray, jacobian: FloatArray, i: int, sums: InertialSums) -> None:
    for n in range(residual.shape[0]):
        _accumulate(jacobian[n], residual[n], sums.H[i], sums.b[i])


@njit(cache=True, nogil=True)
def whiten(root: FloatArray, residual: FloatArray, jacobian: FloatArray, with_jacobian: bool) -> float:
    """Whiten the samples of one interval in place by their `root` (n,n), lower triangular; returns the cost.

    `residual` (n,3), `jacobian` (n,3,48). The last row first, because each needs the rows before it.
    """
    cost = 0.0
    for n in range(root.shape[0] - 1, -1, -1):
        for a in range(3):
            s = 0.0
            for m in range(n + 1):
                s += root[n, m] * residual[m, a]
            residual[n, a] = s
            cost += 0.5 * s * s
            if with_jacobian:
                for p in range(LOCAL_DOF):
                    jacobian[n, a, p] *= root[n, n]
                for m in range(n):
                    for p in range(LOCAL_DOF):
                        jacobian[n, a, p] += root[n, m] * jacobian[m, a, p]
    return cost


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _accumulate(jacobian: FloatArray, residual: FloatArray, H: FloatArray, b: FloatArray) -> None:
    """`H += J^T J`, `b += J^T r` for J (3,48)."""
    for p in range(LOCAL_DOF):
        j0, j1, j2 = jacobian[0, p], jacobian[1, p], jacobian[2, p]
        if j0 == 0.0 and j1 == 0.0 and j2 == 0.0:
            continue
        b[p] += j0 * residual[0] + j1 * residual[1] + j2 * residual[2]
        for q in range(LOCAL_DOF):
            H[p, q] += j0 * jacobian[0, q] + j1 * jacobian[1, q] + j2 * jacobian[2, q]
