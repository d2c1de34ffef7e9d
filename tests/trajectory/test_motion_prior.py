"""White noise on jerk: transition, covariance and weights against their definitions."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from asyneio.trajectory.motion_prior import (
    conditional_covariance,
    covariance,
    information,
    information_root,
    interpolation_weights,
    interpolation_weights_many,
    transition,
)

Array = NDArray[np.float64]

MP = mpmath.MPContext()
MP.dps = 50

#: The intervals a window may ask for, and beyond.
INTERVALS = (1e-5, 1e-4, 1e-3, 0.02, 0.05, 0.3, 1.0)
FRACTIONS = (0.0, 1e-6, 1e-3, 0.1, 0.37, 0.5, 0.83, 0.999, 1.0)
EPS = float(np.finfo(np.float64).eps)

intervals = st.floats(1e-5, 1.0)


def filled(kernel: Callable[..., None], *arguments: float, shape: tuple[int, ...] = (3, 3)) -> Array:
    out = np.full(shape, np.nan)
    kernel(*arguments, out)
    return out


def units(dt: float) -> Array:
    """Sizes of xi, xi_dot, xi_ddot relative to each other over `dt`."""
    return np.array([dt**2, dt, 1.0])


def mp_transition(dt: float) -> mpmath.matrix:
    d = MP.mpf(dt)
    return MP.matrix([[1, d, d * d / 2], [0, 1, d], [0, 0, 1]])


def mp_covariance(dt: float) -> mpmath.matrix:
    """(15) integrated entry by entry; the integrand is a polynomial, so the quadrature is exact."""

    def entry(i: int, j: int) -> mpmath.mpf:
        return MP.quad(lambda s: column(s)[i] * column(s)[j], [0, MP.mpf(dt)])

    def column(s: mpmath.mpf) -> tuple[mpmath.mpf, ...]:
        return (s * s / 2, s, MP.mpf(1))

    return MP.matrix([[entry(i, j) for j in range(3)] for i in range(3)])


def to_array(matrix: mpmath.matrix) -> Array:
    return np.array([[float(matrix[i, j]) for j in range(matrix.cols)] for i in range(matrix.rows)])


@pytest.mark.parametrize("dt", INTERVALS)
def test_transition_is_the_exponential_of_the_system_matrix(dt: float) -> None:
    A = np.diag([1.0, 1.0], 1)
    np.testing.assert_allclose(filled(transition, dt), expm(A * dt), rtol=4 * EPS, atol=0)


@pytest.mark.parametrize("dt", INTERVALS)
def test_covariance_is_the_integral_of_its_definition(dt: float) -> None:
    np.testing.assert_allclose(filled(covariance, dt), to_array(mp_covariance(dt)), rtol=8 * EPS, atol=0)


@given(a=intervals, b=intervals)
def test_two_intervals_are_one(a: float, b: float) -> None:
    """Chapman-Kolmogorov: what is lost over a + b is what is lost over a, carried on, and over b."""
    Phi_a, Phi_b, whole = filled(transition, a), filled(transition, b), filled(transition, a + b)
    np.testing.assert_allclose(Phi_b @ Phi_a, whole, rtol=1e-13, atol=0)
    lost = Phi_b @ filled(covariance, a) @ Phi_b.T + filled(covariance, b)
    np.testing.assert_allclose(lost, filled(covariance, a + b), rtol=1e-13, atol=0)


@pytest.mark.parametrize("dt", INTERVALS)
def test_information_is_the_inverse_and_its_root_a_root(dt: float) -> None:
    exact = to_array(mp_covariance(dt) ** -1)
    root = filled(information_root, dt)
    np.testing.assert_allclose(filled(information, dt), exact, rtol=1e-14, atol=0)
    np.testing.assert_allclose(root.T @ root, exact, rtol=1e-13, atol=0)
    np.testing.assert_array_equal(root, np.triu(root))


@pytest.mark.parametrize("dt", INTERVALS)
@pytest.mark.parametrize("fraction", FRACTIONS)
def test_weights_are_lambda_and_psi(dt: float, fraction: float) -> None:
    """The closed form against (20) at 50 digits; entry (a, b) is measured in its own unit."""
    tau = fraction * dt
    Psi = mp_covariance(tau) * mp_transition(dt - tau).T * mp_covariance(dt) ** -1 if tau else MP.zeros(3)
    Lambda = mp_transition(tau) - Psi * mp_transition(dt)
    exact = np.hstack([to_array(Lambda)[:, 1:], to_array(Psi)])
    unit = units(dt)[:, None] / units(dt)[[1, 2, 0, 1, 2]]
    found = filled(interpolation_weights, tau, dt, shape=(3, 5))
    assert np.abs((found - exact) / unit).max() < 500 * EPS


@pytest.mark.parametrize("dt", INTERVALS)
def test_weights_at_the_ends_pick_the_ends(dt: float) -> None:
    start, end = (filled(interpolation_weights, tau, dt, shape=(3, 5)) for tau in (0.0, dt))
    np.testing.assert_array_equal(start, [[0, 0, 0, 0, 0], [1, 0, 0, 0, 0], [0, 1, 0, 0, 0]])
    np.testing.assert_array_equal(end, np.eye(5)[2:])


def test_many_weights_are_single_weights() -> None:
    tau, dt = np.array([0.0, 0.01, 0.2]), np.array([0.05, 0.03, 0.2])
    out = np.full((3, 3, 5), np.nan)
    interpolation_weights_many(tau, dt, out)
    for n in range(3):
        np.testing.assert_array_equal(out[n], filled(interpolation_weights, tau[n], dt[n], shape=(3, 5)))


@pytest.mark.parametrize("dt", INTERVALS)
@pytest.mark.parametrize("fraction", FRACTIONS)
def test_conditional_covariance_is_gaussian_conditioning(dt: float, fraction: float) -> None:
    """gamma(tau) and gamma(t_{k+1}) are jointly Gaussian given gamma(t_k): condition one on the other."""
    tau = fraction * dt
    variance, carry = mp_covariance(tau) if tau else MP.zeros(3), mp_transition(dt - tau)
    cross = variance * carry.T
    exact = to_array(variance - cross * mp_covariance(dt) ** -1 * cross.T)
    unit = np.outer(units(dt), units(dt)) * dt
    found = filled(conditional_covariance, tau, dt)
    np.testing.assert_allclose(found / unit, exact / unit, rtol=0, atol=100 * EPS)


@given(fraction=st.floats(0.0, 1.0), dt=intervals)
def test_conditional_covariance_looks_the_same_backwards(fraction: float, dt: float) -> None:
    flip = np.array([1.0, -1.0, 1.0])
    forwards = filled(conditional_covariance, fraction * dt, dt)
    backwards = filled(conditional_covariance, (1.0 - fraction) * dt, dt)
    unit = np.outer(units(dt), units(dt)) * dt
    np.testing.assert_allclose(forwards / unit, backwards * np.outer(flip, flip) / unit, rtol=0, atol=1e-13)
