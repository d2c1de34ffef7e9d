"""Warm-up (40): rates of the knots from poses alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.optimize import approx_fprime

from asyneio.factors.gp_prior import gp_prior_coefficients, gp_prior_factor
from asyneio.initialization.warm_up import warm_up
from asyneio.simulation import MotionStyle
from asyneio.trajectory.interpolation import interval_local
from asyneio.trajectory.model import WNOJ, WNOJ_SE3, MotionModel
from tests.factors.knots import random_pair
from tests.models import every_model
from tests.trajectory.motions import DENSITY, Samples, along, grid, simulated

Array = NDArray[np.float64]

INTERVAL_NS = 50_000_000
WIDE = np.array([1e4, 1e4])


def warmed_up(
    states: Samples,
    interval_ns: int,
    zero_sigma: Array,
    start: Array | None = None,
    model: MotionModel = WNOJ_SE3,
) -> Array:
    C = np.ascontiguousarray(states.T[:, :3, :3])
    r = np.ascontiguousarray(states.T[:, :3, 3])
    dt = np.full(len(r) - 1, interval_ns * 1e-9)
    begin = np.zeros_like(states.varpi) if start is None else start
    return warm_up(C, r, begin, dt, DENSITY, zero_sigma, model)


@pytest.mark.parametrize("axes", [np.eye(6)[3:], np.eye(6)[[2, 5]]], ids=["translation", "screw"])
@every_model
def test_motion_without_noise_is_recovered_exactly(model: MotionModel, axes: Array) -> None:
    """Without jerk (or acceleration) the cost of the truth is zero: it is the minimum from any start."""
    rng = np.random.default_rng(4)
    known = 2 if model.prior == WNOJ else 1
    motion = [Polynomial(rng.normal(size=1 + known)) for _ in axes]
    states = along(axes, motion, grid(12, INTERVAL_NS))
    for start in (np.zeros_like(states.varpi), rng.normal(size=states.varpi.shape)):
        found = warmed_up(states, INTERVAL_NS, 1e4 * WIDE, start, model)
        np.testing.assert_allclose(found[:, :known], states.varpi[:, :known], atol=1e-6)
        np.testing.assert_array_equal(found[:, known:], start[:, known:])


@pytest.mark.parametrize("style", [MotionStyle.GENTLE, MotionStyle.AGGRESSIVE])
def test_rates_of_a_smooth_motion(style: str) -> None:
    """From poses 50 ms apart, starting at rest: the prior bends the ends, the middle follows closely."""
    states = simulated(grid(31, INTERVAL_NS), style)
    error = np.abs(warmed_up(states, INTERVAL_NS, np.array([10.0, 100.0])) - states.varpi)
    size = np.abs(states.varpi).max(axis=(0, 2))
    assert error[5:-5, 0].max() < 5e-4 * size[0]
    assert error[5:-5, 1].max() < 5e-3 * size[1]
    assert error[:, 0].max() < 5e-2 * size[0]


def test_shorter_intervals_are_closer() -> None:
    errors = []
    for knots, interval_ns in ((16, 100_000_000), (31, 50_000_000)):
        states = simulated(grid(knots, interval_ns))
        error = np.abs(warmed_up(states, interval_ns, WIDE) - states.varpi)
        errors.append(error[knots // 4 : -(knots // 4)].max(axis=(0, 2)))
    assert np.all(errors[1] < 0.3 * errors[0])


def cost(states: Samples, varpi: Array, dt: float, zero_sigma: Array, model: MotionModel) -> float:
    """(40), term by term."""
    coefficients, local, residual = np.empty((3, 5)), np.empty((5, 6)), np.empty((3, 6))
    gp_prior_coefficients(dt, model.prior, coefficients)
    known = 2 if model.prior == WNOJ else 1
    total = np.sum((varpi[0] / zero_sigma[:, None])[:known] ** 2)
    C, r = np.ascontiguousarray(states.T[:, :3, :3]), np.ascontiguousarray(states.T[:, :3, 3])
    for k in range(len(r) - 1):
        interval_local(C[k], r[k], varpi[k], C[k + 1], r[k + 1], varpi[k + 1], model.space, local)
        gp_prior_factor(local, coefficients, DENSITY, residual)
        total += np.sum(residual**2)
    return float(total)


@every_model
def test_the_result_minimises_the_cost(model: MotionModel) -> None:
    """For poses that are far apart and belong to no trajectory, with significant zero priors."""
    dt, zero_sigma = 0.2, np.array([1.0, 5.0])
    k0, k1 = random_pair(np.random.default_rng(6), dt, 1.5)
    states = Samples(np.stack([k0.T, k1.T, k0.T @ k1.T]), np.zeros((3, 2, 6)))
    found = warmed_up(states, round(dt * 1e9), zero_sigma, model=model)

    def f(x: Array) -> float:
        return cost(states, x.reshape(3, 2, 6), dt, zero_sigma, model)

    slope = approx_fprime(found.ravel(), f, 1e-6)
    elsewhere = approx_fprime(np.zeros(36), f, 1e-6)
    assert np.abs(slope).max() < 1e-4 * np.abs(elsewhere).max()
    rng = np.random.default_rng(0)
    for _ in range(20):
        assert f(found.ravel() + 0.01 * rng.normal(size=36)) > f(found.ravel())


def test_zero_priors_hold_the_first_knot() -> None:
    """The tighter lambda_1 and lambda_2, the smaller the first knot's rates."""
    states = simulated(grid(8, INTERVAL_NS))
    loose = warmed_up(states, INTERVAL_NS, WIDE)
    tight = warmed_up(states, INTERVAL_NS, np.array([1e-6, 1e-6]))
    assert np.abs(tight[0]).max() < 1e-3
    assert np.abs(loose[0]).max() > 0.5


def test_two_knots_suffice() -> None:
    """The zero priors remove the null space of one interval: the rates are finite and fit the poses."""
    states = simulated(grid(2, INTERVAL_NS))
    found = warmed_up(states, INTERVAL_NS, np.array([10.0, 100.0]))
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found.mean(axis=0)[0], states.varpi.mean(axis=0)[0], atol=0.2)
