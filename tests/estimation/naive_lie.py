"""Lie functions of the oracle: power series and scipy's logarithm, no closed forms, any leading axes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

_TERMS = 24


def times(A: Array, v: Array) -> Array:
    return np.asarray((A @ v[..., None])[..., 0])


def hat3(v: Array) -> Array:
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def power_series(X: Array, shift: int) -> Array:
    """`sum_n X^n / (n + shift)!`: the exponential for shift 0, a left Jacobian for shift 1."""
    term = np.broadcast_to(np.eye(X.shape[-1]), X.shape) / math.factorial(shift)
    total = term.copy()
    for n in range(1, _TERMS):
        term = term @ X / (n + shift)
        total += term
        if np.abs(term).max(initial=0.0) < 1e-20:
            break
    return total


def exp_se3(xi: Array) -> Array:
    X = np.zeros((*xi.shape[:-1], 4, 4))
    X[..., :3, :3], X[..., :3, 3] = hat3(xi[..., :3]), xi[..., 3:]
    return power_series(X, 0)


def exp_so3(phi: Array) -> Array:
    return power_series(hat3(phi), 0)


def log_so3(C: Array) -> Array:
    return Rotation.from_matrix(C.reshape(-1, 3, 3)).as_rotvec().reshape(*C.shape[:-2], 3)


def log_se3(T: Array) -> Array:
    phi = log_so3(T[..., :3, :3])
    rho = np.linalg.solve(power_series(hat3(phi), 1), T[..., :3, 3:])
    return np.concatenate([phi, rho[..., 0]], axis=-1)


def curly_hat(xi: Array) -> Array:
    out = np.zeros((*xi.shape[:-1], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = hat3(xi[..., :3])
    out[..., 3:, :3] = hat3(xi[..., 3:])
    return out


def right_jacobian(xi: Array) -> Array:
    return power_series(-curly_hat(xi), 1)


def right_jacobian_rate(xi: Array, xi_dot: Array) -> Array:
    """Time derivative of the right Jacobian: its power series, differentiated term by term."""
    X, dX = -curly_hat(xi), -curly_hat(xi_dot)
    power, d_power = np.broadcast_to(np.eye(6), X.shape), np.zeros_like(X)
    total = np.zeros_like(X)
    for n in range(1, _TERMS):
        d_power = (d_power @ X + power @ dX) / (n + 1)
        power = power @ X / (n + 1)
        total += d_power
        if np.abs(d_power).max(initial=0.0) < 1e-20:
            break
    return total
