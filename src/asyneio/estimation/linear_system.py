"""Linearisation of the window (39): normal equations of the knots, landmarks kept apart for their Schur complement.

Per interval all measurements are accumulated in the interval's local coordinates (48), where a reprojection
touches the trajectory only through one 2x6 matrix and five scalar weights; one product with
`local_to_knots` then moves the sum to the knots. Jacobians are taken at `problem.linearization`, residuals at
`problem.states`: the two differ for knots that the marginal prior has frozen (first-estimates Jacobians).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.estimation.problem import Inertial, Landmarks, Model, Problem, States
from asyneio.factors.bias import bias_factor
from asyneio.factors.gp_inertial import (
    accelerometer_jacobian,
    accelerometer_residual,
    gyroscope_jacobian,
    gyroscope_residual,
)
from asyneio.factors.gp_prior import gp_prior_coefficients, gp_prior_factor
from asyneio.factors.local_frame import local_to_knots
from asyneio.factors.reprojection import landmark_direction, reprojection_jacobian, reprojection_residual
from asyneio.factors.robust import huber
from asyneio.geometry.linalg import matmul
from asyneio.trajectory.interpolation import interval_local, query_pose, query_pose_jacobian
from asyneio.types import BoolArray, FloatArray


class LinearSystem(NamedTuple):
    """Normal equations. `H` (24K,24K) symmetric, `b` (24K,) gradient; landmarks: `W` (L,dof,K,18) coupling,

    `H_l` (L,3,3), `b_l` (L,3). `cost` (2,): total, and that of the observations alone; `rejected` (1,) counts
    observations without influence (behind the camera or beyond the gate).
    """

    H: FloatArray
    b: FloatArray
    W: FloatArray
    H_l: FloatArray
    b_l: FloatArray
    cost: FloatArray
    rejected: FloatArray


def allocate(problem: Problem) -> LinearSystem:
    """Zeroed buffers of the right size."""
    knots, landmarks = len(problem.states.r), len(problem.landmarks.rho)
    dof = problem.model.landmark_dof
    return LinearSystem(
        np.zeros((24 * knots, 24 * knots)),
        np.zeros(24 * knots),
        np.zeros((landmarks, dof, knots, 18)),
        np.zeros((landmarks, 3, 3)),
        np.zeros((landmarks, 3)),
        np.zeros(2),
        np.zeros(1),
    )


def linearize(problem: Problem) -> LinearSystem:
    """Normal equations of all factors except the marginal prior, which the caller adds."""
    system = allocate(problem)
    _linearize(problem, system, True)
    return system


def evaluate_cost(problem: Problem) -> float:
    """Cost of all factors except the marginal prior."""
    system = LinearSystem(
        np.zeros((1, 1)),
        np.zeros(1),
        np.zeros((1, 1, 1, 1)),
        np.zeros((1, 3, 3)),
        np.zeros((1, 3)),
        np.zeros(2),
        np.zeros(1),
    )
    _linearize(problem, system, False)
    return float(system.cost[0])


@njit(cache=True)
def _linearize(problem: Problem, system: LinearSystem, with_jacobian: bool) -> None:
    states, linearization, model = problem.states, problem.linearization, problem.model
    knots = states.r.shape[0]
    local = np.empty((5, 6))
    local_lin = np.empty((5, 6))
    chain = np.empty((48, 48))
    H = np.empty((48, 48))
    b = np.empty(48)
    H_anchor = np.zeros((knots, 36, 6))
    touched = np.zeros(knots, dtype=np.bool_)
    for i in range(knots - 1):
        _local(states, i, local)
        if with_jacobian:
            H[:] = 0.0
            b[:] = 0.0
            if i < problem.frozen:
                _local(linearization, i, local_lin)
            else:
                local_lin[:] = local
            local_to_knots(
                linearization.C[i],
                linearization.r[i],
                linearization.C[i + 1],
                linearization.r[i + 1],
                linearization.varpi[i + 1],
                chain,
            )
        cost = 0.0
        if problem.motion[i]:
            cost += _motion_terms(states, model, i, local, with_jacobian, H, b)
        cost += _inertial_terms(
            problem.gyroscope, True, states, linearization, model, i, local, local_lin, with_jacobian, H, b
        )
        cost += _inertial_terms(
            problem.accelerometer, False, states, linearization, model, i, local, local_lin, with_jacobian, H, b
        )
        visual_cost = _visual_terms(problem, i, local, local_lin, chain, with_jacobian, H, b, H_anchor, touched, system)
        system.cost[0] += cost + visual_cost
        system.cost[1] += visual_cost
        if with_jacobian:
            _add_interval(i, chain, H, b, H_anchor, touched, system)


@njit(cache=True)
def _local(states: States, i: int, out: FloatArray) -> None:
    interval_local(
        states.C[i],
        states.r[i],
        states.varpi[i],
        states.C[i + 1],
        states.r[i + 1],
        states.varpi[i + 1],
        out,
    )


@njit(cache=True)
def _motion_terms(
    states: States, model: Model, i: int, local: FloatArray, with_jacobian: bool, H: FloatArray, b: FloatArray
) -> float:
    """WNOJ prior (16) and bias walk (24): both linear in the local coordinates."""
    coefficients = np.empty((3, 5))
    residual = np.empty((3, 6))
    bias_residual = np.empty(6)
    gp_prior_coefficients(model.dt[i], coefficients)
    gp_prior_factor(local, coefficients, model.root_density, residual)
    bias_factor(states.bias[i], states.bias[i + 1], model.bias_walk, model.dt[i], bias_residual)
    cost = 0.0
    for j in range(6):
        cost += 0.5 * bias_residual[j] ** 2
        for a in range(3):
            cost += 0.5 * residual[a, j] ** 2
    if not with_jacobian:
        return cost
    for p in range(5):
        for j in range(6):
            for a in range(3):
                b[6 + 6 * p + j] += coefficients[a, p] * residual[a, j] / model.root_density[j]
            for q in range(5):
                s = 0.0
                for a in range(3):
                    s += coefficients[a, p] * coefficients[a, q]
                H[6 + 6 * p + j, 6 + 6 * q + j] += s / model.root_density[j] ** 2
    for j in range(6):
        w = 1.0 / (model.bias_walk[j] * np.sqrt(model.dt[i]))
        H[36 + j, 36 + j] += w * w
        H[42 + j, 42 + j] += w * w
        H[36 + j, 42 + j] -= w * w
        H[42 + j, 36 + j] -= w * w
        b[36 + j] -= w * bias_residual[j]
        b[42 + j] += w * bias_residual[j]
    return cost


@njit(cache=True)
def _inertial_terms(
    samples: Inertial,
    is_gyroscope: bool,
    states: States,
    linearization: States,
    model: Model,
    i: int,
    local: FloatArray,
    local_lin: FloatArray,
    with_jacobian: bool,
    H: FloatArray,
    b: FloatArray,
) -> float:
    """Gyroscope or accelerometer samples of interval i (21)-(23)."""
    residual = np.empty(3)
    jacobian = np.empty((3, 48))
    bias = states.bias[i : i + 2]
    cost = 0.0
    for n in range(samples.start[i], samples.start[i + 1]):
        weights, alpha, value = samples.weights[n], samples.alpha[n], samples.value[n]
        if is_gyroscope:
            gyroscope_residual(value, local, weights, bias, alpha, residual)
        else:
            accelerometer_residual(
                value, states.C[i], local, weights, bias, alpha, model.gravity_w, residual
            )
        info = samples.root_information[n] ** 2
        cost += 0.5 * info * (residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
        if with_jacobian:
            if is_gyroscope:
                gyroscope_jacobian(local_lin, weights, alpha, jacobian)
            else:
                accelerometer_jacobian(
                    linearization.C[i], local_lin, weights, alpha, model.gravity_w, jacobian
                )
            _accumulate(jacobian, residual, info, H, b)
    return cost


@njit(cache=True)
def _accumulate(jacobian: FloatArray, residual: FloatArray, info: float, H: FloatArray, b: FloatArray) -> None:
    """`H += info J^T J`, `b += info J^T r` for J (3,48)."""
    for p in range(48):
        j0, j1, j2 = info * jacobian[0, p], info * jacobian[1, p], info * jacobian[2, p]
        if j0 == 0.0 and j1 == 0.0 and j2 == 0.0:
            continue
        b[p] += j0 * residual[0] + j1 * residual[1] + j2 * residual[2]
        for q in range(48):
            H[p, q] += j0 * jacobian[0, q] + j1 * jacobian[1, q] + j2 * jacobian[2, q]


@njit(cache=True)
def _visual_terms(
    problem: Problem,
    i: int,
    local: FloatArray,
    local_lin: FloatArray,
    chain: FloatArray,
    with_jacobian: bool,
    H: FloatArray,
    b: FloatArray,
    H_anchor: FloatArray,
    touched: BoolArray,
    system: LinearSystem,
) -> float:
    """Observations of interval i (34)-(38): residual at the states, Jacobian at the linearisation point."""
    visual, landmarks, model = problem.visual, problem.landmarks, problem.model
    states, linearization = problem.states, problem.linearization
    C, r, C_lin, r_lin = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    x_a, x_b, h, residual = np.empty(3), np.empty(3), np.empty(3), np.empty(2)
    d_anchor, d_pose, d_landmark = np.empty((2, 6)), np.empty((2, 6)), np.empty((2, 3))
    d_eps, d_xi = np.empty((6, 6)), np.empty((6, 6))
    E, B = np.empty((2, 6)), np.empty((2, 6))
    coupling = np.zeros((3, 36))
    cost = 0.0
    last = visual.start[i + 1] - 1
    for n in range(visual.start[i], visual.start[i + 1]):
        j = visual.landmark[n]
        a = landmarks.anchor[j]
        weights, root = visual.weights[n], visual.root_information[n]
        query_pose(states.C[i], states.r[i], local, weights, C, r)
        landmark_direction(
            states.C[a], states.r[a], C, r, model.C_bc, model.r_bc, landmarks.kappa[j], landmarks.rho[j], x_a, x_b, h
        )
        visible = reprojection_residual(h, visual.xy[n], root, residual)
        squared = residual[0] ** 2 + residual[1] ** 2 if visible else np.inf
        rho_cost, robust_weight = huber(squared, model.robust_scale, model.gate)
        cost += rho_cost
        if not with_jacobian:
            continue
        if robust_weight > 0.0 and (i < problem.frozen or a < problem.frozen):
            query_pose(linearization.C[i], linearization.r[i], local_lin, weights, C_lin, r_lin)
            landmark_direction(
                linearization.C[a],
                linearization.r[a],
                C_lin,
                r_lin,
                model.C_bc,
                model.r_bc,
                landmarks.kappa[j],
                landmarks.rho[j],
                x_a,
                x_b,
                h,
            )
        else:
            C_lin[:] = C
            r_lin[:] = r
        usable = robust_weight > 0.0 and reprojection_jacobian(
            linearization.C[a],
            linearization.r[a],
            C_lin,
            r_lin,
            model.C_bc,
            model.r_bc,
            landmarks.rho[j],
            landmarks.tangent[j],
            x_a,
            x_b,
            h,
            root,
            d_anchor,
            d_pose,
            d_landmark,
        )
        if usable:
            query_pose_jacobian(local_lin, weights, d_eps, d_xi)
            matmul(d_pose, d_eps, E)
            matmul(d_pose, d_xi, B)
            touched[a] = True
            _add_trajectory(E, B, weights, residual, robust_weight, H, b)
            _add_anchor(E, B, weights, residual, robust_weight, d_anchor, a, H_anchor[a], system)
            _add_landmark(
                E, B, weights, residual, robust_weight, d_anchor, d_landmark, j, a, model.landmark_dof, coupling, system
            )
        else:
            system.rejected[0] += 1.0
        if n == last or visual.landmark[n + 1] != j:
            _flush_coupling(coupling, chain, model.landmark_dof, system.W[j], i)
    return cost


@njit(cache=True)
def _add_trajectory(
    E: FloatArray, B: FloatArray, weights: FloatArray, residual: FloatArray, w: float, H: FloatArray, b: FloatArray
) -> None:
    """One observation on the local coordinates: blocks eps_k (E) and weights[p] B."""
    for i in range(6):
        e0, e1 = w * E[0, i], w * E[1, i]
        f0, f1 = w * B[0, i], w * B[1, i]
        b[i] += e0 * residual[0] + e1 * residual[1]
        g = f0 * residual[0] + f1 * residual[1]
        for p in range(5):
            b[6 + 6 * p + i] += weights[p] * g
        for j in range(6):
            H[i, j] += e0 * E[0, j] + e1 * E[1, j]
            cross = e0 * B[0, j] + e1 * B[1, j]
            square = f0 * B[0, j] + f1 * B[1, j]
            for p in range(5):
                wp = weights[p]
                H[i, 6 + 6 * p + j] += wp * cross
                H[6 + 6 * p + j, i] += wp * cross
                for q in range(5):
                    H[6 + 6 * p + i, 6 + 6 * q + j] += wp * weights[q] * square


@njit(cache=True)
def _add_anchor(
    E: FloatArray,
    B: FloatArray,
    weights: FloatArray,
    residual: FloatArray,
    w: float,
    d_anchor: FloatArray,
    a: int,
    H_a: FloatArray,
    system: LinearSystem,
) -> None:
    """One observation on its anchor pose and the coupling of anchor and local coordinates `H_a` (36,6)."""
    o = 24 * a
    for j in range(6):
        a0, a1 = w * d_anchor[0, j], w * d_anchor[1, j]
        system.b[o + j] += a0 * residual[0] + a1 * residual[1]
        for i in range(6):
            system.H[o + i, o + j] += d_anchor[0, i] * a0 + d_anchor[1, i] * a1
            H_a[i, j] += E[0, i] * a0 + E[1, i] * a1
            cross = B[0, i] * a0 + B[1, i] * a1
            for p in range(5):
                H_a[6 + 6 * p + i, j] += weights[p] * cross


@njit(cache=True)
def _add_landmark(
    E: FloatArray,
    B: FloatArray,
    weights: FloatArray,
    residual: FloatArray,
    w: float,
    d_anchor: FloatArray,
    d_landmark: FloatArray,
    j: int,
    a: int,
    dof: int,
    coupling: FloatArray,
    system: LinearSystem,
) -> None:
    """One observation on its landmark, and the landmark's coupling to anchor and local coordinates."""
    for d in range(dof):
        l0, l1 = w * d_landmark[0, d], w * d_landmark[1, d]
        system.b_l[j, d] += l0 * residual[0] + l1 * residual[1]
        for e in range(dof):
            system.H_l[j, d, e] += l0 * d_landmark[0, e] + l1 * d_landmark[1, e]
        for i in range(6):
            system.W[j, d, a, i] += l0 * d_anchor[0, i] + l1 * d_anchor[1, i]
            coupling[d, i] += l0 * E[0, i] + l1 * E[1, i]
            cross = l0 * B[0, i] + l1 * B[1, i]
            for p in range(5):
                coupling[d, 6 + 6 * p + i] += weights[p] * cross


@njit(cache=True)
def _flush_coupling(coupling: FloatArray, chain: FloatArray, dof: int, W: FloatArray, i: int) -> None:
    """Move a landmark's coupling from local coordinates to the two knots of interval i, and clear it."""
    for d in range(dof):
        for c in range(18):
            W[d, i, c] += coupling[d, c]
        for p in range(18, 36):
            s = coupling[d, p]
            for c in range(6):
                W[d, i, c] += s * chain[p, c]
            for c in range(18):
                W[d, i + 1, c] += s * chain[p, 24 + c]
        for p in range(36):
            coupling[d, p] = 0.0


@njit(cache=True)
def _add_interval(
    i: int,
    chain: FloatArray,
    H: FloatArray,
    b: FloatArray,
    H_anchor: FloatArray,
    touched: BoolArray,
    system: LinearSystem,
) -> None:
    """Move an interval's sums from local coordinates to the knots; clears `H_anchor` and `touched`."""
    o = 24 * i
    moved = np.dot(chain.T, np.dot(H, chain))
    gradient = np.dot(chain.T, b)
    for p in range(48):
        system.b[o + p] += gradient[p]
        for q in range(48):
            system.H[o + p, o + q] += moved[p, q]
    kinematic = np.ascontiguousarray(chain[:36])
    for a in range(H_anchor.shape[0]):
        if not touched[a]:
            continue
        touched[a] = False
        cross = np.dot(kinematic.T, H_anchor[a])
        for p in range(48):
            for q in range(6):
                system.H[o + p, 24 * a + q] += cross[p, q]
                system.H[24 * a + q, o + p] += cross[p, q]
        H_anchor[a] = 0.0


@njit(cache=True)
def whiten_landmarks(system: LinearSystem, dof: int, damping: FloatArray) -> None:
    """In place: H_l + damping = L L^T, `W <- L^{-1} W`, `b_l <- L^{-1} b_l`, `H_l <- L`."""
    for j in range(system.H_l.shape[0]):
        H, b, W = system.H_l[j], system.b_l[j], system.W[j]
        for d in range(dof):
            H[d, d] += damping[d]
        for d in range(dof):
            for e in range(d):
                for k in range(e):
                    H[d, e] -= H[d, k] * H[e, k]
                H[d, e] /= H[e, e]
            for k in range(d):
                H[d, d] -= H[d, k] * H[d, k]
            H[d, d] = np.sqrt(max(H[d, d], 1e-12))
            for k in range(d):
                b[d] -= H[d, k] * b[k]
                W[d] -= H[d, k] * W[k]
            b[d] /= H[d, d]
            W[d] /= H[d, d]


@njit(cache=True)
def landmark_steps(system: LinearSystem, dof: int, step: FloatArray, out: FloatArray) -> None:
    """Back-substitution: steps `out` (L,3) of whitened landmarks for knot steps `step` (K,24)."""
    knots = step.shape[0]
    for j in range(system.H_l.shape[0]):
        L = system.H_l[j]
        for d in range(dof - 1, -1, -1):
            s = -system.b_l[j, d]
            for k in range(knots):
                for c in range(18):
                    s -= system.W[j, d, k, c] * step[k, c]
            out[j, d] = s
        # L^T x = s
        for d in range(dof - 1, -1, -1):
            for e in range(d + 1, dof):
                out[j, d] -= L[e, d] * out[j, e]
            out[j, d] /= L[d, d]


def eliminate_landmarks(system: LinearSystem, landmarks: Landmarks, model: Model) -> None:
    """Schur complement of all landmarks onto the knots, in place; landmarks become whitened.

    Landmarks with one anchor share a span of knots, so their rank updates become one product.
    """
    whiten_landmarks(system, model.landmark_dof, model.landmark_damping)
    knots = system.W.shape[2]
    H = system.H.reshape(knots, 24, knots, 24)
    b = system.b.reshape(knots, 24)
    for anchor in np.unique(landmarks.anchor):
        mine = np.flatnonzero(landmarks.anchor == anchor)
        used = np.flatnonzero(system.W[mine].any(axis=(0, 1, 3)))
        if len(used) == 0:
            continue
        first, end = used[0], used[-1] + 1
        W = system.W[mine, :, first:end].reshape(-1, (end - first) * 18)
        whitened_b = system.b_l[mine, : model.landmark_dof].ravel()
        S = (W.T @ W).reshape(end - first, 18, end - first, 18)
        H[first:end, :18, first:end, :18] -= S
        b[first:end, :18] -= (W.T @ whitened_b).reshape(end - first, 18)

