"""Covariance at any instant: against sampled trajectories, a dense GP, and the derivative it is made of."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.stats import chi2

from asyneio.geometry.se3 import right_jacobian, se3_log
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.trajectory.interpolation import interval_local
from asyneio.trajectory.motion_prior import interpolation_weights
from tests.conftest import SEED
from tests.factors.knots import Knot, hat6, random_pair
from tests.trajectory.motions import DENSITY, START_NS, grid, simulated, trajectory

Array = NDArray[np.float64]

#: Errors of [eps, varpi, varpi_dot]: small enough for first order, of the size of what the prior leaves.
SIZES = np.repeat([1e-3, 1e-2, 0.3], 6)
#: Rows of [eps, varpi, varpi_dot] of both knots in a joint covariance with biases.
KINEMATIC = np.concatenate([np.arange(18), 24 + np.arange(18)])


def random_covariance(rng: np.random.Generator, knots: int) -> Array:
    """Covariance (24 knots, 24 knots) with correlations between everything."""
    sizes = np.tile(np.concatenate([SIZES, np.full(6, 0.1)]), knots)
    A = rng.normal(size=(len(sizes), 2 * len(sizes)))
    return (A @ A.T) / A.shape[1] * np.outer(sizes, sizes)


def joint(covariance: Array, k: int) -> Array:
    return covariance[24 * k : 24 * k + 48, 24 * k : 24 * k + 48]


def pair_trajectory(
    pair: tuple[Knot, Knot], dt_ns: int, density: Array, covariance: Array | None = None
) -> GPTrajectory:
    source = None if covariance is None else lambda _: covariance
    return GPTrajectory(
        grid(2, dt_ns),
        np.stack([k.C for k in pair]),
        np.stack([k.r for k in pair]),
        np.stack([k.varpi for k in pair]),
        density,
        joint_covariance=source,
    )


def test_at_a_knot_it_is_the_knots_own() -> None:
    knots = grid(5, 50_000_000)
    P = random_covariance(np.random.default_rng(SEED), len(knots))
    found = trajectory(knots, simulated(knots), lambda k: joint(P, k))
    own = np.stack([P[24 * k : 24 * k + 18, 24 * k : 24 * k + 18] for k in range(len(knots))])
    unit = np.outer(SIZES, SIZES)
    np.testing.assert_allclose(found.covariance(knots) / unit, own / unit, atol=1e-9)
    beside = found.covariance(np.concatenate([knots[1:] - 1, knots[:-1] + 1]))
    np.testing.assert_allclose(beside / unit, np.concatenate([own[1:], own[:-1]]) / unit, atol=1e-3)


def test_it_is_symmetric_and_positive_everywhere() -> None:
    knots = grid(6, 100_000_000)
    P = random_covariance(np.random.default_rng(SEED), len(knots))
    found = trajectory(knots, simulated(knots), lambda k: joint(P, k))
    t = np.random.default_rng(1).integers(knots[0], knots[-1], 300, endpoint=True)
    covariance = found.covariance(t)
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(covariance / np.outer(SIZES, SIZES)).min() > 1e-4


@pytest.mark.parametrize(("dt", "scale"), [(0.05, 1.0), (0.2, 2.0), (0.4, 2.5)])
@pytest.mark.parametrize("fraction", [0.2, 0.5, 0.9])
def test_errors_of_the_knots_arrive_through_the_exact_jacobian(
    dt: float, scale: float, fraction: float
) -> None:
    """One direction v of error, (J v)(J v)^T, against central differences of the query along v."""
    rng = np.random.default_rng(int(100 * fraction) + int(1000 * dt))
    pair = random_pair(rng, dt, scale)
    dt_ns = int(dt * 1e9)
    t = START_NS + int(fraction * dt_ns)
    v = rng.normal(size=48)
    found = pair_trajectory(pair, dt_ns, np.full(6, 1e-9), np.outer(v, v)).covariance(t)
    bar = pair_trajectory(pair, dt_ns, DENSITY).pose(t)

    def error(size: float) -> Array:
        moved = pair[0].perturbed(size * v[:24]), pair[1].perturbed(size * v[24:])
        query = pair_trajectory(moved, dt_ns, DENSITY)
        return np.concatenate(
            [
                logarithm(np.linalg.inv(bar) @ query.pose(t)),
                query.generalized_velocity(t),
                query.generalized_acceleration(t),
            ]
        )

    h = 1e-4
    Jv = (8.0 * (error(h) - error(-h)) - (error(2 * h) - error(-2 * h))) / (12.0 * h)
    np.testing.assert_allclose(found, np.outer(Jv, Jv), atol=1e-6 * (Jv @ Jv), rtol=1e-5)


def logarithm(T: Array) -> Array:
    out = np.empty(6)
    se3_log(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3]), out)
    return out


def bridges(rng: np.random.Generator, tau_steps: int, dt_steps: int, dt: float, count: int) -> Array:
    """Deviations (count,3,6) of gamma(tau) from its mean between two known ends, drawn from sampled noise.

    White noise, integrated three times in small steps; what the end explains is then subtracted.
    """
    step = dt / dt_steps
    gamma, at_tau = np.zeros((3, count, 6)), np.zeros((3, count, 6))
    for n in range(dt_steps):
        jerk = rng.normal(size=(count, 6)) * DENSITY / np.sqrt(step)
        gamma[0] += step * gamma[1] + step**2 / 2 * gamma[2] + step**3 / 6 * jerk
        gamma[1] += step * gamma[2] + step**2 / 2 * jerk
        gamma[2] += step * jerk
        if n + 1 == tau_steps:
            at_tau[:] = gamma
    weights = np.empty((3, 5))
    interpolation_weights(tau_steps * step, dt, weights)
    return (at_tau - np.einsum("ab,bni->ani", weights[:, 2:], gamma)).transpose(1, 0, 2)


def state_of(T_0: Array, gamma: Array) -> tuple[Array, Array]:
    """Pose and [varpi, varpi_dot] (12,) from gamma (3,6): (7), (8) and (8) differentiated by differences."""

    def jacobian(xi: Array) -> Array:
        out = np.empty((6, 6))
        right_jacobian(xi, out)
        return out

    xi, rate, acceleration = gamma
    h = 1e-5
    turning = (jacobian(xi + h * rate) - jacobian(xi - h * rate)) / (2.0 * h)
    J = jacobian(xi)
    return T_0 @ expm(hat6(xi)), np.concatenate([J @ rate, J @ acceleration + turning @ rate])


@pytest.mark.parametrize("tau_steps", [20, 70])
def test_sampled_trajectories_spread_as_predicted(tau_steps: int) -> None:
    """Knots drawn from their joint covariance, motion between them drawn from the prior, in fast motion."""
    count, dt_ns, dt, steps = 4000, 200_000_000, 0.2, 100
    rng = np.random.default_rng(SEED)
    pair = random_pair(rng, dt, 2.0)
    P = random_covariance(rng, 2)
    t = START_NS + dt_ns * tau_steps // steps
    mean = pair_trajectory(pair, dt_ns, DENSITY, P)
    bar = np.linalg.inv(mean.pose(t))
    rates = np.concatenate([mean.generalized_velocity(t), mean.generalized_acceleration(t)])
    noise = bridges(rng, tau_steps, steps, dt, count)
    drawn = rng.normal(size=(count, 48)) @ np.linalg.cholesky(P).T
    weights, local = np.empty((3, 5)), np.empty((5, 6))
    interpolation_weights(dt * tau_steps / steps, dt, weights)
    errors = np.empty((count, 18))
    for n in range(count):
        a, b = pair[0].perturbed(drawn[n, :24]), pair[1].perturbed(drawn[n, 24:])
        interval_local(a.C, a.r, a.varpi, b.C, b.r, b.varpi, local)
        T, varpi = state_of(a.T, weights @ local + noise[n])
        errors[n] = np.concatenate([logarithm(bar @ T), varpi - rates])
    assert_distributed(errors, mean.covariance(t))


def assert_distributed(errors: Array, covariance: Array) -> None:
    """Zero mean and the covariance in every direction; a right answer misses the bounds once in 1e4 runs."""
    count, dof = errors.shape
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), errors.T).T
    assert count * np.sum(whitened.mean(axis=0) ** 2) < chi2.ppf(0.9999, dof)
    low, high = chi2.ppf([5e-5, 1.0 - 5e-5], count * dof) / count
    assert low < np.mean(np.sum(whitened**2, axis=1)) < high
    spread = np.linalg.eigvalsh(whitened.T @ whitened / count)
    # Edges of the spectrum of a sample covariance (Marchenko and Pastur), a little wider.
    edge = 1.15 * np.sqrt(dof / count)
    assert (1.0 - edge) ** 2 < spread.min()
    assert spread.max() < (1.0 + edge) ** 2


def prior_covariance(times: Array, start: Array) -> Array:
    """Covariance (3n,3n) of [x, x', x''] at all `times`: unit white noise on x''' after `start`.

    From the definition: transition by the matrix exponential, the integral by quadrature.
    """
    A = np.diag([1.0, 1.0], 1)
    nodes, quadrature = np.polynomial.legendre.leggauss(5)
    out = np.empty((3 * len(times), 3 * len(times)))
    for i, a in enumerate(times):
        for j, b in enumerate(times):
            end = min(a, b)
            block = expm(A * a) @ start @ expm(A * b).T
            for node, weight in zip(0.5 * end * (nodes + 1.0), 0.5 * end * quadrature, strict=True):
                block += weight * np.outer(expm(A * (a - node))[:, 2], expm(A * (b - node))[:, 2])
            out[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = block
    return out


def conditioned(prior: Array, H: Array, y: Array, sigma: float) -> tuple[Array, Array]:
    """Posterior mean and covariance of a zero-mean Gaussian after `y = H x + noise`."""
    gain = np.linalg.solve(H @ prior @ H.T + sigma**2 * np.eye(len(H)), H @ prior).T
    return gain @ y, prior - gain @ H @ prior


def test_dense_gaussian_process_on_translations() -> None:
    """Positions measured at the knots: mean and covariance between them are those of the dense solution."""
    dt_ns, q = 100_000_000, 15.0
    knots = grid(4, dt_ns)
    asked = START_NS + np.array([13_000_000, 150_000_000, 288_000_000])
    times = (np.concatenate([knots, asked]) - START_NS) * 1e-9
    prior = q**2 * prior_covariance(times, np.diag([1e-2, 1e-2, 1e-1]))
    H = np.zeros((len(knots), len(prior)))
    H[np.arange(len(knots)), 3 * np.arange(len(knots))] = 1.0
    y = np.random.default_rng(SEED).normal(size=(len(knots), 3))
    mean, covariance = conditioned(prior, H, y, sigma=0.01)
    mean = mean.reshape(len(times), 3, 3)

    varpi = np.zeros((len(knots), 2, 6))
    varpi[:, :, 3:] = mean[: len(knots), 1:]
    rows = np.concatenate([3 + np.arange(3), 9 + np.arange(3), 15 + np.arange(3)])

    def spread(k: int) -> Array:
        both = np.zeros((48, 48))
        at = np.concatenate([rows, 24 + rows])
        both[np.ix_(at, at)] = np.kron(covariance[3 * k : 3 * k + 6, 3 * k : 3 * k + 6], np.eye(3))
        return both

    found = GPTrajectory(
        knots,
        np.tile(np.eye(3), (len(knots), 1, 1)),
        mean[: len(knots), 0],
        varpi,
        np.array([1e-9, 1e-9, 1e-9, q, q, q]),
        joint_covariance=spread,
    )
    np.testing.assert_allclose(found.pose(asked)[:, :3, 3], mean[len(knots) :, 0], atol=1e-10)
    np.testing.assert_allclose(found.velocity(asked), mean[len(knots) :, 1], atol=1e-9)
    np.testing.assert_allclose(found.acceleration(asked), mean[len(knots) :, 2], atol=1e-8)
    for n, at_time in enumerate(found.covariance(asked)):
        o = 3 * (len(knots) + n)
        exact = np.kron(covariance[o : o + 3, o : o + 3], np.eye(3))
        unit = np.sqrt(np.outer(exact.diagonal(), exact.diagonal()))
        np.testing.assert_allclose(at_time[np.ix_(rows, rows)] / unit, exact / unit, atol=1e-9)


def test_dense_gaussian_process_on_a_body_at_rest() -> None:
    """Six axes, every correlation, a density per axis: at rest the errors are the linear process."""
    dt, tau = 0.1, 0.034
    P = random_covariance(np.random.default_rng(SEED), 2)
    at_rest = Knot(np.eye(4), np.zeros((2, 6)), np.zeros(6))
    found = pair_trajectory((at_rest, at_rest), 100_000_000, DENSITY, P).covariance(START_NS + 34_000_000)
    process = prior_covariance(np.array([tau, dt]), np.zeros((3, 3)))
    A = np.diag([1.0, 1.0], 1)
    Psi = np.linalg.solve(process[3:, 3:], process[3:, :3]).T
    Lambda = expm(A * tau) - Psi @ expm(A * dt)
    W = np.kron(np.hstack([Lambda, Psi]), np.eye(6))
    left = process[:3, :3] - Psi @ process[3:, :3]
    exact = W @ P[np.ix_(KINEMATIC, KINEMATIC)] @ W.T + np.kron(left, np.diag(DENSITY**2))
    unit = np.sqrt(np.outer(exact.diagonal(), exact.diagonal()))
    np.testing.assert_allclose(found / unit, exact / unit, atol=1e-9)
