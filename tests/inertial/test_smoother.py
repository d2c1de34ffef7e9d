"""The linear-time smoother against the dense process of the same kernel, and its closed integrals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from asyneio.inertial.hermite import accumulate, functional, integral_weights, settle
from asyneio.inertial.smoother import evidence, gains, smooth, smooth_adjoint
from asyneio.inertial.smoothness import Smoothness, find_smoothness

from .dense_gp import wiener_regression
from .windows import noise_at, shaken, window_of

Array = NDArray[np.float64]

PRIOR = np.array([4.0, 9.0, 16.0])


def nodes_and_samples(seed: int, count: int = 24) -> tuple[Array, NDArray[np.int64], Array]:
    """Irregular nodes, of which node 3 is at 0 s; two thirds have samples (m,2)."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.01, 0.1, count))
    t -= t[3]
    row = np.full(count, -1, dtype=np.int64)
    sampled = np.sort(rng.choice(count, 2 * count // 3, replace=False))
    row[sampled] = np.arange(len(sampled))
    return t, row, rng.normal(size=(len(sampled), 2)) + 3.0 * np.sin(5.0 * t[sampled, None])


def smoothed(t: Array, row: NDArray[np.int64], y: Array, density: float, variance: float) -> Array:
    """Table (n,5,c) of states and integrals."""
    K, G = np.empty((len(t), 3)), np.empty((len(t) - 1, 3, 3))
    gains(t, row, density, variance, PRIOR, K, G)
    x = np.empty((len(t), 5, y.shape[1]))
    smooth(t, row, K, G, y, x[:, 2:])
    accumulate(t, 3, x)
    return x


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 1000),
    density=st.floats(-3.0, 6.0).map(lambda e: 10.0**e),
    variance=st.floats(-4.0, 1.0).map(lambda e: 10.0**e),
)
def test_equals_the_dense_process(seed: int, density: float, variance: float) -> None:
    """Values and both integrals at the nodes: the posterior of K^{-1} with integrated kernels."""
    t, row, y = nodes_and_samples(seed)
    x = smoothed(t, row, y, density, variance)
    dense, cross = wiener_regression(t[row >= 0], y, t[0], density, variance, PRIOR)
    scale = np.abs(y).max()
    np.testing.assert_allclose(x[:, 2], dense.mean(cross(t)), atol=1e-9 * scale)
    nodes, weights = np.polynomial.legendre.leggauss(6)
    for n in range(len(t) - 1):
        dt = t[n + 1] - t[n]
        s = t[n] + 0.5 * dt * (nodes + 1.0)
        p = dense.mean(cross(s))
        once = 0.5 * dt * weights @ p
        twice = 0.5 * dt * (weights * (t[n + 1] - s)) @ p
        np.testing.assert_allclose(x[n + 1, 1] - x[n, 1], once, atol=1e-9 * scale)
        np.testing.assert_allclose(x[n + 1, 0] - x[n, 0] - dt * x[n, 1], twice, atol=1e-9 * scale)
    assert np.abs(x[3, :2]).max() < 1e-12 * scale


@pytest.mark.parametrize("seed", range(3))
def test_between_nodes_the_posterior_is_the_hermite_polynomial(seed: int) -> None:
    t, row, y = nodes_and_samples(seed)
    x = smoothed(t, row, y, 500.0, 0.05)
    dense, cross = wiener_regression(t[row >= 0], y, t[0], 500.0, 0.05, PRIOR)
    value, first, second = np.empty(6), np.empty(6), np.empty(6)
    for n in range(len(t) - 1):
        for s in (0.0, 0.2, 0.7, 1.0):
            dt = t[n + 1] - t[n]
            integral_weights(s, dt, value, first, second)
            ends = np.concatenate([x[n, 2:], x[n + 1, 2:]])
            exact = dense.mean(cross(np.array([t[n] + s * dt])))[0]
            np.testing.assert_allclose(value @ ends, exact, atol=1e-9)


def test_likelihood_is_the_dense_one() -> None:
    t, row, y = nodes_and_samples(4)
    sampled = t[row >= 0]
    dense, _ = wiener_regression(sampled, y, sampled[0], 300.0, 0.2, PRIOR)
    found = evidence(sampled, y, 300.0, 0.2, PRIOR)
    np.testing.assert_allclose(sum(found), dense.minus_twice_log_likelihood(), rtol=1e-10)


def test_adjoint_gives_the_weights_of_the_samples() -> None:
    """Integrals at any time are linear in the samples; their weights, found backwards, reproduce them."""
    t, row, y = nodes_and_samples(5)
    x = smoothed(t, row, y, 200.0, 0.1)
    K, G = np.empty((len(t), 3)), np.empty((len(t) - 1, 3, 3))
    gains(t, row, 200.0, 0.1, PRIOR, K, G)
    value, first, second = np.empty(6), np.empty(6), np.empty(6)
    for n, s in ((1, 0.3), (3, 0.0), (10, 0.8), (len(t) - 2, 1.0)):
        dt = t[n + 1] - t[n]
        tau = t[n] + s * dt
        integral_weights(s, dt, value, first, second)
        ends = np.concatenate([x[n, 2:], x[n + 1, 2:]])
        expected = [x[n, 1] + first @ ends, x[n, 0] + x[n, 1] * s * dt + second @ ends]
        f = np.zeros((len(t), 5, 2))
        for column, (once, twice) in enumerate(((1.0, 0.0), (0.0, 1.0))):
            functional(t, 3, tau, once, twice, f[:, :, column])
            settle(t, f[:, :, column])
        weight = np.empty((len(y), 2))
        smooth_adjoint(t, row, K, G, f[:, 2:], weight)
        np.testing.assert_allclose(weight.T @ y, expected, atol=1e-12)


@pytest.mark.parametrize("power", range(6))
def test_integrals_of_polynomials_are_exact(power: int) -> None:
    t = np.array([-0.3, -0.1, 0.0, 0.25, 0.9])
    p = np.polynomial.Polynomial.basis(power)
    x = np.zeros((5, 5, 1))
    for i in range(3):
        x[:, 2 + i, 0] = p.deriv(i)(t) if i else p(t)
    accumulate(t, 2, x)
    np.testing.assert_allclose(x[:, 1, 0], p.integ()(t), atol=1e-14)
    np.testing.assert_allclose(x[:, 0, 0], p.integ(2)(t), atol=1e-14)


def test_smoothness_is_read_from_the_samples() -> None:
    """More noise or less motion never gives a rougher process, and the time unit does not matter."""
    noise = noise_at(200.0)
    still = find_smoothness(window_of(shaken(1, 0.01, 0.01), 0.2, 200.0, noise=noise), noise)
    moved = find_smoothness(window_of(shaken(1, 10.0, 4.0), 0.2, 200.0, noise=noise), noise)
    shaken_hard = find_smoothness(window_of(shaken(1, 50.0, 10.0, 20.0), 0.2, 200.0, noise=noise), noise)
    for sensor in ("gyroscope", "accelerometer"):
        found = [getattr(s, sensor) for s in (still, moved, shaken_hard)]
        assert found[0] < 1e-2 * found[1]
        assert found[1] < 1e-1 * found[2]
    assert isinstance(still, Smoothness)


@pytest.mark.parametrize("seed", range(4))
def test_smoothness_is_the_likeliest_of_the_ladder(seed: int) -> None:
    """Every third decade and then its neighbours find what all decades would."""
    noise = noise_at(200.0)
    window = window_of(shaken(seed), 0.2, 200.0, noise=noise, seed=seed)
    found = find_smoothness(window, noise).gyroscope
    prior = np.array([100.0, 1e4, 1e7])
    unit = noise.gyroscope**2 * 200.0**5
    t, y = window.gyroscope_t, window.gyroscope
    values = [sum(evidence(t, y, unit * 10.0**e, noise.gyroscope**2, prior)) for e in range(-14, 5)]
    assert abs(np.log10(found / unit) - (np.argmin(values) - 14)) < 1.01


def test_inflated_noise_does_not_smooth_the_motion_away() -> None:
    """Ten times the noise that the samples show: the densities stay within a decade, in absolute units."""
    noise = noise_at(200.0)
    window = window_of(shaken(1), 0.2, 200.0, noise=noise)
    right, inflated = find_smoothness(window, noise), find_smoothness(window, noise_at(200.0, 10.0))
    for sensor in ("gyroscope", "accelerometer"):
        # What smooths is the density in units of the sample's variance, here a hundred times larger.
        ratio = getattr(inflated, sensor) / getattr(right, sensor) / 100.0
        assert 0.09 < ratio < 11.0
