"""Covariance at any instant against sampled trajectories, a dense GP, and central differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.stats import chi2

from asyneio.geometry.se3 import right_jacobian, se3_log
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.trajectory.interpolation import interval_local
from asyneio.trajectory.model import SE3, SO3_X_R3, WNOA, WNOJ, WNOJ_SE3, MotionModel
from asyneio.trajectory.motion_prior import interpolation_weights
from tests.conftest import SEED
from tests.factors.knots import Knot, hat6, random_pair
from tests.models import every_model
from tests.trajectory.motions import DENSITY, START_NS, grid, simulated, trajectory

Array = NDArray[np.float64]

#: Errors of [eps, varpi, varpi_dot]: small enough for first order, of the size of what the prior leaves.
SIZES = np.repeat([1e-3, 1e-2, 0.3], 6)


def random_covariance(rng: np.random.Generator, knots: int) -> Array:
    """Covariance (24 knots, 24 knots) with correlations between everything."""
    sizes = np.tile(np.concatenate([SIZES, np.full(6, 0.1)]), knots)
    A = rng.normal(size=(len(sizes), 2 * len(sizes)))
    return (A @ A.T) / A.shape[1] * np.outer(sizes, sizes)


def joint(covariance: Array, k: int) -> Array:
    return covariance[24 * k : 24 * k + 48, 24 * k : 24 * k + 48]


def in_state(model: MotionModel) -> int:
    """Rows of [eps, varpi, varpi_dot] that are in the state of the prior."""
    return 18 if model.prior == WNOJ else 12


def pair_trajectory(
    pair: tuple[Knot, Knot],
    dt_ns: int,
    density: Array,
    covariance: Array | None = None,
    model: MotionModel = WNOJ_SE3,
) -> GPTrajectory:
    source = None if covariance is None else lambda _: covariance
    return GPTrajectory(
        grid(2, dt_ns),
        np.stack([k.C for k in pair]),
        np.stack([k.r for k in pair]),
        np.stack([k.varpi for k in pair]),
        density,
        joint_covariance=source,
        motion_model=model,
    )


@every_model
def test_at_a_knot_it_is_the_knots_own(model: MotionModel) -> None:
    knots = grid(5, 50_000_000)
    P = random_covariance(np.random.default_rng(SEED), len(knots))
    found = trajectory(knots, simulated(knots), lambda k: joint(P, k), model)
    n = in_state(model)
    own = np.stack([P[24 * k : 24 * k + n, 24 * k : 24 * k + n] for k in range(len(knots))])
    unit = np.outer(SIZES[:n], SIZES[:n])
    np.testing.assert_allclose(found.covariance(knots)[:, :n, :n] / unit, own / unit, atol=1e-9)
    beside = found.covariance(np.concatenate([knots[1:] - 1, knots[:-1] + 1]))[:, :n, :n]
    near = np.concatenate([own[1:], own[:-1]])
    if model.prior == WNOA:
        # A velocity driven by white noise is a random walk: its deviation grows with the root of time.
        near[:, range(6, 12), range(6, 12)] += DENSITY**2 * 1e-9
    np.testing.assert_allclose(beside / unit, near / unit, atol=1e-3)


@every_model
def test_it_is_symmetric_and_positive_everywhere(model: MotionModel) -> None:
    knots = grid(6, 100_000_000)
    P = random_covariance(np.random.default_rng(SEED), len(knots))
    found = trajectory(knots, simulated(knots), lambda k: joint(P, k), model)
    t = np.random.default_rng(1).integers(knots[0], knots[-1], 300, endpoint=True)
    covariance = found.covariance(t)
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(covariance / np.outer(SIZES, SIZES)).min() > 1e-4


@pytest.mark.parametrize(("dt", "scale"), [(0.05, 1.0), (0.2, 2.0), (0.4, 2.5)])
@pytest.mark.parametrize("fraction", [0.2, 0.5, 0.9])
@every_model
def test_errors_of_the_knots_arrive_through_the_exact_jacobian(
    model: MotionModel, dt: float, scale: float, fraction: float
) -> None:
    """One direction v of error, (J v)(J v)^T, against central differences of the query along v."""
    rng = np.random.default_rng(int(100 * fraction) + int(1000 * dt))
    pair = random_pair(rng, dt, scale)
    dt_ns = int(dt * 1e9)
    t = START_NS + int(fraction * dt_ns)
    v = rng.normal(size=48)
    found = pair_trajectory(pair, dt_ns, np.full(6, 1e-9), np.outer(v, v), model).covariance(t)
    bar = pair_trajectory(pair, dt_ns, DENSITY, model=model).pose(t)

    def error(size: float) -> Array:
        moved = pair[0].perturbed(size * v[:24]), pair[1].perturbed(size * v[24:])
        query = pair_trajectory(moved, dt_ns, DENSITY, model=model)
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


def bridges(
    rng: np.random.Generator, tau_steps: int, dt_steps: int, dt: float, count: int, prior: int
) -> Array:
    """Deviations (count,3,6) of gamma(tau) from its mean between two known ends, drawn from sampled noise.

    White noise, integrated three times (twice on acceleration: the second derivative stays zero) in small
    steps; what the end explains is then subtracted.
    """
    step = dt / dt_steps
    gamma, at_tau = np.zeros((3, count, 6)), np.zeros((3, count, 6))
    for n in range(dt_steps):
        white = rng.normal(size=(count, 6)) * DENSITY / np.sqrt(step)
        if prior == WNOJ:
            gamma[0] += step * gamma[1] + step**2 / 2 * gamma[2] + step**3 / 6 * white
            gamma[1] += step * gamma[2] + step**2 / 2 * white
            gamma[2] += step * white
        else:
            gamma[0] += step * gamma[1] + step**2 / 2 * white
            gamma[1] += step * white
        if n + 1 == tau_steps:
            at_tau[:] = gamma
    weights = np.empty((3, 5))
    interpolation_weights(tau_steps * step, dt, prior, weights)
    return (at_tau - np.einsum("ab,bni->ani", weights[:, 2:], gamma)).transpose(1, 0, 2)


def state_of(T_0: Array, gamma: Array, space: int) -> tuple[Array, Array]:
    """Pose and [varpi, varpi_dot] (12,) from gamma (3,6): (7), (8) and (8) differentiated by differences."""
    if space == SO3_X_R3:
        return state_on_a_line(T_0, gamma)

    def jacobian(xi: Array) -> Array:
        out = np.empty((6, 6))
        right_jacobian(xi, out)
        return out

    xi, rate, acceleration = gamma
    h = 1e-5
    turning = (jacobian(xi + h * rate) - jacobian(xi - h * rate)) / (2.0 * h)
    J = jacobian(xi)
    return T_0 @ expm(hat6(xi)), np.concatenate([J @ rate, J @ acceleration + turning @ rate])


def state_on_a_line(T_0: Array, gamma: Array) -> tuple[Array, Array]:
    """The same on SO(3) x R^3: rotation as on SE(3) at rest, position linear."""
    turning = gamma.copy()
    turning[:, 3:] = 0.0
    T, rates = state_of(np.eye(4), turning, SE3)
    C, omega = T[:3, :3], rates[:3]
    nu = C.T @ gamma[1, 3:]
    T[:3, 3] = gamma[0, 3:]
    return T_0 @ T, np.concatenate([omega, nu, rates[6:9], C.T @ gamma[2, 3:] - np.cross(omega, nu)])


@pytest.mark.slow
@pytest.mark.parametrize("tau_steps", [20, 70])
@every_model
def test_sampled_trajectories_spread_as_predicted(model: MotionModel, tau_steps: int) -> None:
    """Knots drawn from their joint covariance, motion between them drawn from the prior, in fast motion."""
    count, dt_ns, dt, steps = 4000, 200_000_000, 0.2, 100
    rng = np.random.default_rng(SEED)
    pair = random_pair(rng, dt, 2.0)
    P = random_covariance(rng, 2)
    t = START_NS + dt_ns * tau_steps // steps
    mean = pair_trajectory(pair, dt_ns, DENSITY, P, model)
    bar = np.linalg.inv(mean.pose(t))
    rates = np.concatenate([mean.generalized_velocity(t), mean.generalized_acceleration(t)])
    noise = bridges(rng, tau_steps, steps, dt, count, model.prior)
    drawn = rng.normal(size=(count, 48)) @ np.linalg.cholesky(P).T
    weights, local = np.empty((3, 5)), np.empty((5, 6))
    interpolation_weights(dt * tau_steps / steps, dt, model.prior, weights)
    errors = np.empty((count, 18))
    for n in range(count):
        a, b = pair[0].perturbed(drawn[n, :24]), pair[1].perturbed(drawn[n, 24:])
        interval_local(a.C, a.r, a.varpi, b.C, b.r, b.varpi, model.space, local)
        T, varpi = state_of(a.T, weights @ local + noise[n], model.space)
        errors[n] = np.concatenate([logarithm(bar @ T), varpi - rates])
    assert_distributed(errors[:, : in_state(model)], mean.covariance(t)[: in_state(model), : in_state(model)])


def assert_distributed(errors: Array, covariance: Array) -> None:
    """Zero mean and the covariance in every direction; a correct result fails once in 1e4 runs."""
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
    """Covariance (mn,mn) at all n `times` of a value and m - 1 derivatives: unit white noise on the next one
    after `start` (m,m).

    From the definition: transition by the matrix exponential, the integral by quadrature.
    """
    m = len(start)
    A = np.eye(m, k=1)
    nodes, quadrature = np.polynomial.legendre.leggauss(5)
    out = np.empty((m * len(times), m * len(times)))
    for i, a in enumerate(times):
        for j, b in enumerate(times):
            end = min(a, b)
            block = expm(A * a) @ start @ expm(A * b).T
            for node, weight in zip(0.5 * end * (nodes + 1.0), 0.5 * end * quadrature, strict=True):
                block += weight * np.outer(expm(A * (a - node))[:, -1], expm(A * (b - node))[:, -1])
            out[m * i : m * i + m, m * j : m * j + m] = block
    return out


def conditioned(prior: Array, H: Array, y: Array, sigma: float) -> tuple[Array, Array]:
    """Posterior mean and covariance of a zero-mean Gaussian after `y = H x + noise`."""
    gain = np.linalg.solve(H @ prior @ H.T + sigma**2 * np.eye(len(H)), H @ prior).T
    return gain @ y, prior - gain @ H @ prior


@every_model
def test_dense_gaussian_process_on_translations(model: MotionModel) -> None:
    """Positions measured at the knots: mean and covariance between them are those of the dense solution."""
    dt_ns, q = 100_000_000, 15.0
    knots = grid(4, dt_ns)
    asked = START_NS + np.array([13_000_000, 150_000_000, 288_000_000])
    times = (np.concatenate([knots, asked]) - START_NS) * 1e-9
    m = in_state(model) // 6
    prior = q**2 * prior_covariance(times, np.diag([1e-2, 1e-2, 1e-1][:m]))
    H = np.zeros((len(knots), len(prior)))
    H[np.arange(len(knots)), m * np.arange(len(knots))] = 1.0
    y = np.random.default_rng(SEED).normal(size=(len(knots), 3))
    mean, covariance = conditioned(prior, H, y, sigma=0.01)
    mean = mean.reshape(len(times), m, 3)

    varpi = np.zeros((len(knots), 2, 6))
    varpi[:, : m - 1, 3:] = mean[: len(knots), 1:]
    rows = np.concatenate([3 + np.arange(3), 9 + np.arange(3), 15 + np.arange(3)][:m])

    def spread(k: int) -> Array:
        both = np.zeros((48, 48))
        at = np.concatenate([rows, 24 + rows])
        both[np.ix_(at, at)] = np.kron(covariance[m * k : m * k + 2 * m, m * k : m * k + 2 * m], np.eye(3))
        return both

    found = GPTrajectory(
        knots,
        np.tile(np.eye(3), (len(knots), 1, 1)),
        mean[: len(knots), 0],
        varpi,
        np.array([1e-9, 1e-9, 1e-9, q, q, q]),
        joint_covariance=spread,
        motion_model=model,
    )
    np.testing.assert_allclose(found.pose(asked)[:, :3, 3], mean[len(knots) :, 0], atol=1e-10)
    np.testing.assert_allclose(found.velocity(asked), mean[len(knots) :, 1], atol=1e-9)
    if model.prior == WNOJ:
        np.testing.assert_allclose(found.acceleration(asked), mean[len(knots) :, 2], atol=1e-8)
    for n, at_time in enumerate(found.covariance(asked)):
        o = m * (len(knots) + n)
        exact = np.kron(covariance[o : o + m, o : o + m], np.eye(3))
        unit = np.sqrt(np.outer(exact.diagonal(), exact.diagonal()))
        np.testing.assert_allclose(at_time[np.ix_(rows, rows)] / unit, exact / unit, atol=1e-9)


@every_model
def test_dense_gaussian_process_on_a_body_at_rest(model: MotionModel) -> None:
    """Six axes, every correlation, a density per axis: at rest the errors are the linear process."""
    dt, tau = 0.1, 0.034
    P = random_covariance(np.random.default_rng(SEED), 2)
    at_rest = Knot(np.eye(4), np.zeros((2, 6)), np.zeros(6))
    t = START_NS + 34_000_000
    found = pair_trajectory((at_rest, at_rest), 100_000_000, DENSITY, P, model).covariance(t)
    n = in_state(model)
    m = n // 6
    process = prior_covariance(np.array([tau, dt]), np.zeros((m, m)))
    A = np.eye(m, k=1)
    Psi = np.linalg.solve(process[m:, m:], process[m:, :m]).T
    Lambda = expm(A * tau) - Psi @ expm(A * dt)
    W = np.kron(np.hstack([Lambda, Psi]), np.eye(6))
    left = process[:m, :m] - Psi @ process[m:, :m]
    states = np.concatenate([np.arange(n), 24 + np.arange(n)])
    exact = W @ P[np.ix_(states, states)] @ W.T + np.kron(left, np.diag(DENSITY**2))
    unit = np.sqrt(np.outer(exact.diagonal(), exact.diagonal()))
    np.testing.assert_allclose(found[:n, :n] / unit, exact / unit, atol=1e-9)
