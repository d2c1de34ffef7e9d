"""White noise on jerk and on acceleration: transition, covariance and weights against their definitions."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from asyneio.trajectory.model import WNOJ
from asyneio.trajectory.motion_prior import (
    conditional_covariance,
    covariance,
    information,
    information_root,
    interpolation_weights,
    interpolation_weights_many,
    transition,
)
from tests.models import every_prior

Array = NDArray[np.float64]

MP = mpmath.MPContext()
MP.dps = 50

#: The intervals a window may ask for, and beyond.
INTERVALS = (1e-5, 1e-4, 1e-3, 0.02, 0.05, 0.3, 1.0)
FRACTIONS = (0.0, 1e-6, 1e-3, 0.1, 0.37, 0.5, 0.83, 0.999, 1.0)
EPS = float(np.finfo(np.float64).eps)

intervals = st.floats(1e-5, 1.0)


def filled(
    kernel: Callable[..., None], *arguments: float, prior: int, shape: tuple[int, ...] = (3, 3)
) -> Array:
    out = np.full(shape, np.nan)
    kernel(*arguments, prior, out)
    return out


def size(prior: int) -> int:
    """Derivatives in the state of the prior, the value itself included."""
    return 3 if prior == WNOJ else 2


def padded(matrix: Array) -> Array:
    """In the upper left corner of a (3,3) matrix of zeros."""
    out = np.zeros((3, 3))
    out[: len(matrix), : len(matrix)] = matrix
    return out


def units(dt: float) -> Array:
    """Sizes of xi, xi_dot, xi_ddot relative to each other over `dt`."""
    return np.array([dt**2, dt, 1.0])


def mp_transition(dt: float, prior: int) -> mpmath.matrix:
    d, n = MP.mpf(dt), size(prior)
    return MP.matrix([[1, d, d * d / 2], [0, 1, d], [0, 0, 1]])[:n, :n]


def mp_covariance(dt: float, prior: int) -> mpmath.matrix:
    """(15) integrated entry by entry; the integrand is a polynomial, so the quadrature is exact."""

    def entry(i: int, j: int) -> mpmath.mpf:
        return MP.quad(lambda s: column(s)[i] * column(s)[j], [0, MP.mpf(dt)])

    def column(s: mpmath.mpf) -> tuple[mpmath.mpf, ...]:
        return (s * s / 2, s, MP.mpf(1))[3 - n :]

    n = size(prior)
    return MP.matrix([[entry(i, j) for j in range(n)] for i in range(n)])


def to_array(matrix: mpmath.matrix) -> Array:
    return np.array([[float(matrix[i, j]) for j in range(matrix.cols)] for i in range(matrix.rows)])


@pytest.mark.parametrize("dt", INTERVALS)
@every_prior
def test_transition_is_the_exponential_of_the_system_matrix(prior: int, dt: float) -> None:
    A = np.eye(size(prior), k=1)
    np.testing.assert_allclose(
        filled(transition, dt, prior=prior), padded(expm(A * dt)), rtol=4 * EPS, atol=0
    )


@pytest.mark.parametrize("dt", INTERVALS)
@every_prior
def test_covariance_is_the_integral_of_its_definition(prior: int, dt: float) -> None:
    exact = padded(to_array(mp_covariance(dt, prior)))
    np.testing.assert_allclose(filled(covariance, dt, prior=prior), exact, rtol=8 * EPS, atol=0)


@given(a=intervals, b=intervals)
@every_prior
def test_two_intervals_are_one(prior: int, a: float, b: float) -> None:
    """Chapman-Kolmogorov: the covariance over a + b is that over a, propagated, plus that over b."""
    Phi_a, Phi_b, whole = (filled(transition, dt, prior=prior) for dt in (a, b, a + b))
    np.testing.assert_allclose(Phi_b @ Phi_a, whole, rtol=1e-13, atol=0)
    Q_a, Q_b, Q = (filled(covariance, dt, prior=prior) for dt in (a, b, a + b))
    np.testing.assert_allclose(Phi_b @ Q_a @ Phi_b.T + Q_b, Q, rtol=1e-13, atol=0)


@pytest.mark.parametrize("dt", INTERVALS)
@every_prior
def test_information_is_the_inverse_and_its_root_a_root(prior: int, dt: float) -> None:
    exact = padded(to_array(mp_covariance(dt, prior) ** -1))
    root = filled(information_root, dt, prior=prior)
    np.testing.assert_allclose(filled(information, dt, prior=prior), exact, rtol=1e-14, atol=0)
    np.testing.assert_allclose(root.T @ root, exact, rtol=1e-13, atol=0)
    np.testing.assert_array_equal(root, np.triu(root))


@pytest.mark.parametrize("dt", INTERVALS)
@pytest.mark.parametrize("fraction", FRACTIONS)
@every_prior
def test_weights_are_lambda_and_psi(prior: int, dt: float, fraction: float) -> None:
    """The closed form against (20) at 50 digits; entry (a, b) is measured in its own unit."""
    tau, n = fraction * dt, size(prior)
    Q = mp_covariance(tau, prior) if tau else MP.zeros(n)
    Psi = Q * mp_transition(dt - tau, prior).T * mp_covariance(dt, prior) ** -1
    Lambda = mp_transition(tau, prior) - Psi * mp_transition(dt, prior)
    exact = np.zeros((n, 5))
    exact[:, : n - 1], exact[:, 2 : 2 + n] = to_array(Lambda)[:, 1:], to_array(Psi)
    unit = units(dt)[:, None] / units(dt)[[1, 2, 0, 1, 2]]
    found = filled(interpolation_weights, tau, dt, prior=prior, shape=(3, 5))
    assert np.abs((found[:n] - exact) / unit[:n]).max() < 500 * EPS


@pytest.mark.parametrize("dt", INTERVALS)
@pytest.mark.parametrize("fraction", FRACTIONS[3:-2])
@every_prior
def test_each_row_of_weights_is_the_derivative_of_the_one_above(
    prior: int, dt: float, fraction: float
) -> None:
    """Also the last row under white noise on acceleration, which no state of the prior stands behind."""
    tau, h = fraction * dt, 0.01 * dt

    def at(t: float) -> Array:
        return filled(interpolation_weights, t, dt, prior=prior, shape=(3, 5))

    slope = sum(w * (at(tau + k * h) - at(tau - k * h)) for k, w in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)))
    unit = units(dt)[1:, None] / units(dt)[[1, 2, 0, 1, 2]]
    np.testing.assert_allclose(at(tau)[1:] / unit, slope[:2] / h / unit, atol=1e-10)


@pytest.mark.parametrize("dt", INTERVALS)
@every_prior
def test_weights_at_the_ends_pick_the_ends(prior: int, dt: float) -> None:
    n = size(prior)
    start, end = (filled(interpolation_weights, tau, dt, prior=prior, shape=(3, 5))[:n] for tau in (0.0, dt))
    np.testing.assert_array_equal(start, [[0, 0, 0, 0, 0], [1, 0, 0, 0, 0], [0, 1, 0, 0, 0]][:n])
    np.testing.assert_array_equal(end, np.eye(5)[2 : 2 + n])


@every_prior
def test_many_weights_are_single_weights(prior: int) -> None:
    tau, dt = np.array([0.0, 0.01, 0.2]), np.array([0.05, 0.03, 0.2])
    out = np.full((3, 3, 5), np.nan)
    interpolation_weights_many(tau, dt, prior, out)
    for n in range(3):
        single = filled(interpolation_weights, tau[n], dt[n], prior=prior, shape=(3, 5))
        np.testing.assert_array_equal(out[n], single)


@pytest.mark.parametrize("dt", INTERVALS)
@pytest.mark.parametrize("fraction", FRACTIONS)
@every_prior
def test_conditional_covariance_is_gaussian_conditioning(prior: int, dt: float, fraction: float) -> None:
    """gamma(tau) and gamma(t_{k+1}) are jointly Gaussian given gamma(t_k): condition one on the other."""
    tau = fraction * dt
    variance = mp_covariance(tau, prior) if tau else MP.zeros(size(prior))
    cross = variance * mp_transition(dt - tau, prior).T
    exact = padded(to_array(variance - cross * mp_covariance(dt, prior) ** -1 * cross.T))
    unit = np.outer(units(dt), units(dt)) * dt
    found = filled(conditional_covariance, tau, dt, prior=prior)
    # In units of Q: a prior with fewer derivatives is larger by dt^2.
    unit *= 1.0 if prior == WNOJ else dt**-2
    np.testing.assert_allclose(found / unit, exact / unit, rtol=0, atol=100 * EPS)


@given(fraction=st.floats(0.0, 1.0), dt=intervals)
@every_prior
def test_conditional_covariance_looks_the_same_backwards(prior: int, fraction: float, dt: float) -> None:
    flip = np.array([1.0, -1.0, 1.0])
    forwards = filled(conditional_covariance, fraction * dt, dt, prior=prior)
    backwards = filled(conditional_covariance, (1.0 - fraction) * dt, dt, prior=prior)
    unit = np.outer(units(dt), units(dt)) * (dt if prior == WNOJ else 1.0 / dt)
    np.testing.assert_allclose(forwards / unit, backwards * np.outer(flip, flip) / unit, rtol=0, atol=1e-13)
