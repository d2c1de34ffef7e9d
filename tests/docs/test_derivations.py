"""Relations of docs/derivations as printed there, against the kernels that implement them."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.geometry.se3 import right_jacobian_inverse_rate_times, right_jacobian_rate_times
from asyneio.geometry.series import INVERSE_SERIES, JACOBIAN_SERIES, evaluate_series
from asyneio.trajectory.model import WNOJ
from asyneio.trajectory.motion_prior import covariance, interpolation_weights


def hat(a: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def curly(xi: np.ndarray) -> np.ndarray:
    return np.block([[hat(xi[:3]), np.zeros((3, 3))], [hat(xi[3:]), hat(xi[:3])]])


def test_local_coordinates_the_fifth_power_of_the_adjoint(rng: np.random.Generator) -> None:
    xi = rng.normal(size=6)
    X, s = curly(xi), xi[:3] @ xi[:3]
    power = np.linalg.matrix_power
    np.testing.assert_allclose(power(X, 5), -2.0 * s * power(X, 3) - s * s * X, atol=1e-13)


@pytest.mark.parametrize("inverse", [False, True])
def test_local_coordinates_recursion(rng: np.random.Generator, inverse: bool) -> None:
    """(L8)-(L14) with full matrices."""
    xi, u, v = rng.normal(size=(3, 6))
    table = INVERSE_SERIES if inverse else JACOBIAN_SERIES
    c = np.empty((4, 3))
    evaluate_series(table, float(xi[:3] @ xi[:3]), inverse, c)
    X, U = curly(xi), curly(u)
    phi, u_phi = np.append(xi[:3], np.zeros(3)), np.append(u[:3], np.zeros(3))
    p = 2.0 * xi[:3] @ u[:3]
    v_i, w_i, D, W, A, B = v, np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6)), np.eye(6), np.zeros((6, 6))
    g, d_xi, d_u, d_v = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    for c0, c1, c2 in c:
        W, B = X @ W - curly(w_i) + U @ D, X @ B + U @ A
        D, A = X @ D - curly(v_i), X @ A
        v_i, w_i = X @ v_i, X @ w_i + U @ v_i
        g = g + c0 * w_i + c1 * p * v_i
        d_xi += (
            c0 * W
            + c1 * p * D
            + 2.0 * np.outer(c1 * w_i + c2 * p * v_i, phi)
            + 2.0 * c1 * np.outer(v_i, u_phi)
        )
        d_u += c0 * D + 2.0 * c1 * np.outer(v_i, phi)
        d_v += c0 * B + c1 * p * A
    out = [np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.empty(6)]
    (right_jacobian_inverse_rate_times if inverse else right_jacobian_rate_times)(xi, u, v, *out)
    for ours, theirs in zip((d_xi, d_u, d_v, g), out, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-13)


def test_motion_prior_root_and_quintic() -> None:
    """(M2) and (M3)."""
    d, h = 0.37, 0.3
    R = np.array(
        [
            [720**0.5 / d**2.5, -(720**0.5) / (2 * d**1.5), 720**0.5 / (12 * d**0.5)],
            [0.0, 12**0.5 / d**1.5, -(12**0.5) / (2 * d**0.5)],
            [0.0, 0.0, d**-0.5],
        ]
    )
    Q, weights = np.empty((3, 3)), np.empty((3, 5))
    covariance(d, WNOJ, Q)
    np.testing.assert_allclose(R.T @ R @ Q, np.eye(3), atol=1e-11)
    interpolation_weights(h * d, d, WNOJ, weights)
    printed = [
        d * (h - 6 * h**3 + 8 * h**4 - 3 * h**5),
        d**2 * (h**2 - 3 * h**3 + 3 * h**4 - h**5) / 2,
        10 * h**3 - 15 * h**4 + 6 * h**5,
        d * (-4 * h**3 + 7 * h**4 - 3 * h**5),
        d**2 * (h**3 - 2 * h**4 + h**5) / 2,
    ]
    np.testing.assert_allclose(weights[0], printed, rtol=1e-13)
