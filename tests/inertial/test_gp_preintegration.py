"""GP preintegration: accuracy, derivatives, covariance, and the paper's kernel as another regression."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from asyneio.errors import InertialError
from asyneio.inertial.gp_preintegration import GpPreintegration, gp_preintegration
from asyneio.inertial.increments import ImuWindow, Increments, SampleNoise
from asyneio.inertial.preintegration import midpoint
from asyneio.inertial.smoothness import Smoothness, find_smoothness
from asyneio.simulation import AnalyticMotion

from ..factors.jacobian_checker import check_jacobian
from .dense_gp import DenseRegression, SquaredExponential
from .windows import (
    START,
    Array,
    altered,
    covariance_by_differences,
    difference,
    noise_at,
    shaken,
    spread,
    true_error,
    true_increments,
    window_of,
)

BIAS = np.array([0.01, -0.02, 0.03, 0.1, -0.2, 0.15])
END = np.array([0.2])
NO_BIAS = np.zeros(6)
GRAVITY_W = np.array([0.0, 0.0, -9.81])
#: Standard deviation far below any motion, so that only the error of the rule remains.
QUIET = SampleNoise(1e-9, 1e-8)


def fixed(smoothness: Smoothness):  # type: ignore[no-untyped-def]
    """The rule at fixed densities, which make it a smooth function of the samples."""

    def rule(window: ImuWindow, bias: Array, noise: SampleNoise) -> GpPreintegration:
        return gp_preintegration(window, bias, noise, smoothness)

    return rule


def rms(errors: list[Array]) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(errors), axis=0)))


def compare(
    motions: list[AnalyticMotion], rate_hz: float, noise: SampleNoise | None, **kwargs: object
) -> tuple[Array, Array]:
    """RMS errors (3,) of rotation, velocity and position after 0.2 s, of GPs and of the midpoint rule."""
    found: tuple[list[Array], list[Array]] = ([], [])
    for seed, motion in enumerate(motions):
        window = window_of(motion, 0.2, rate_hz, noise=noise, seed=seed, **kwargs)  # type: ignore[arg-type]
        for errors, rule in zip(found, (gp_preintegration, midpoint), strict=True):
            errors.append(true_error(motion, rule(window, NO_BIAS, noise or QUIET).end(), END)[0])
    return rms(found[0]), rms(found[1])


MOTIONS = [shaken(seed) for seed in range(12)]
FAST = [shaken(seed, acceleration=60.0, rate=6.0) for seed in range(40)]


@pytest.mark.parametrize(
    ("rates", "offsets"),
    [((200.0, 200.0), (0.0, 0.0)), ((200.0, 150.0), (0.0011, 0.0023)), ((1000.0, 190.0), (0.0, 0.0017))],
)
def test_without_noise_a_hundred_times_better_than_midpoint(
    rates: tuple[float, float], offsets: tuple[float, float]
) -> None:
    gp, mid = compare(MOTIONS, rates[0], None, accelerometer_hz=rates[1], offsets=offsets)
    assert (gp < 0.01 * mid).all(), f"{gp} against {mid}"


def test_fast_motion_under_noise_five_times_better_than_midpoint() -> None:
    gp, mid = compare(FAST, 200.0, noise_at(200.0))
    assert gp[2] < 0.2 * mid[2], f"{gp} against {mid}"


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 1000.0])
@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_never_much_worse_than_midpoint(rate_hz: float, factor: float) -> None:
    """Where noise dominates, both rules have the error of integrated noise."""
    gp, mid = compare(MOTIONS + FAST[:12], rate_hz, noise_at(rate_hz, factor))
    assert (gp < 1.05 * mid).all(), f"{gp} against {mid}"


@pytest.mark.parametrize("believed", [0.1, 10.0])
def test_wrong_noise_does_little_harm(believed: float) -> None:
    errors: tuple[list[Array], list[Array]] = ([], [])
    noise = noise_at(200.0)
    for seed, motion in enumerate(MOTIONS):
        window = window_of(motion, 0.2, 200.0, noise=noise, seed=seed)
        for found, rule in zip(errors, (gp_preintegration, midpoint), strict=True):
            used = SampleNoise(believed * noise.gyroscope, believed * noise.accelerometer)
            found.append(true_error(motion, rule(window, NO_BIAS, used).end(), END)[0])
    assert (rms(errors[0]) < 1.15 * rms(errors[1])).all()


def test_white_vibration_is_integrated_like_midpoint() -> None:
    """White samples, which no smooth signal explains: the interpolation must not overshoot between them."""
    rng, errors = np.random.default_rng(0), ([], [])  # type: ignore[var-annotated]
    for motion in MOTIONS:
        window = window_of(motion, 0.2, 200.0, noise=noise_at(200.0))
        shape = window.gyroscope.shape
        window = altered(window, 0.3 * rng.normal(size=shape), 3.0 * rng.normal(size=shape))
        for found, rule in zip(errors, (gp_preintegration, midpoint), strict=True):
            found.append(true_error(motion, rule(window, NO_BIAS, noise_at(200.0)).end(), END)[0])
    assert (rms(errors[0]) < 1.1 * rms(errors[1])).all()


def test_rates_between_samples_follow_the_motion() -> None:
    """(26): the derivative of the increments in time is the motion's rate and force, at any time inside."""
    motion = shaken(3)
    found = gp_preintegration(window_of(motion, 0.2, 200.0, 150.0), NO_BIAS, QUIET)
    tau, h = np.linspace(0.003, 0.196, 17), 1e-4
    before, here, after = (found.at(tau + d) for d in (-h, 0.0, h))
    turned = Rotation.from_matrix(before.C.transpose(0, 2, 1) @ after.C).as_rotvec() / (2.0 * h)
    np.testing.assert_allclose(turned, motion.angular_velocity_b(1.0 + tau), atol=3e-4)
    np.testing.assert_allclose((after.r - before.r) / (2.0 * h), here.nu, atol=1e-4)
    force = np.einsum("nji,nj->ni", here.C, (after.nu - before.nu) / (2.0 * h))
    body = motion.T_w_b(1.0 + tau)[:, :3, :3].transpose(0, 2, 1)
    expected = np.einsum("nij,nj->ni", body, motion.acceleration_w(1.0 + tau) - GRAVITY_W)
    np.testing.assert_allclose(force, expected, atol=5e-3)


def test_errors_grow_smoothly_along_the_interval() -> None:
    """Times inside give the same as the end of a shorter batch, together or alone; zero at the start."""
    motion = shaken(4)
    found = gp_preintegration(window_of(motion, 0.2, 200.0), NO_BIAS, QUIET)
    tau = np.array([0.2, 0.0, 0.1234, 0.005, 0.1, 0.19999])
    together = found.at(tau)
    assert true_error(motion, together, tau).max() < 1e-6
    for n in range(len(tau)):
        for a, b in zip(found.at(tau[n : n + 1]), together, strict=True):
            np.testing.assert_array_equal(a[0], b[n])
    for a, b in zip(found.end(), together, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
    for nothing in (together.C[1] - np.eye(3), together.nu[1], together.r[1], together.d_bias[1]):
        assert np.abs(nothing).max() < 1e-14


@pytest.mark.parametrize("factor", [1.0, 20.0])
@pytest.mark.parametrize("tau", [0.2, 0.1234])
def test_bias_derivatives(tau: float, factor: float) -> None:
    """The smoothness is chosen anew: it does not depend on the bias."""
    noise, time = noise_at(200.0, factor), np.array([tau])
    window = window_of(shaken(3), 0.2, 200.0, 150.0, offsets=(0.0011, 0.0031), noise=noise)
    found = gp_preintegration(window, BIAS, noise).at(time)
    check_jacobian(
        "GP increments",
        found.d_bias[0],
        lambda d: difference(found, gp_preintegration(window, BIAS + d, noise).at(time))[0],
        [("b_g", 3), ("b_a", 3)],
    )


@pytest.mark.parametrize(("factor", "tolerance"), [(1.0, 1e-3), (20.0, 2e-2)])
def test_covariance_is_that_of_every_sample(factor: float, tolerance: float) -> None:
    """The covariance assumes that smoothing commutes with rotation, which strong smoothing violates."""
    noise, time = noise_at(200.0, factor), np.array([0.117])
    window = window_of(shaken(4), 0.12, 200.0, 150.0, offsets=(0.0, 0.0031), noise=noise)
    rule = fixed(find_smoothness(window, noise))
    expected = covariance_by_differences(rule, BIAS, window, noise, time)
    assert spread(rule(window, BIAS, noise).covariance(0.117), expected) < tolerance


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_scatter_under_noise_is_the_covariance(factor: float) -> None:
    rng, runs, noise = np.random.default_rng(6), 400, noise_at(200.0, factor)
    clean = window_of(shaken(5), 0.2, 200.0)
    smoothness = find_smoothness(
        altered(clean, noise.gyroscope * rng.normal(size=clean.gyroscope.shape), 0.0), noise
    )
    rule = fixed(smoothness)
    exact = rule(clean, BIAS, noise)
    information = np.linalg.inv(exact.covariance(0.2))
    total = 0.0
    for _ in range(runs):
        added = (
            noise.gyroscope * rng.normal(size=clean.gyroscope.shape),
            noise.accelerometer * rng.normal(size=clean.accelerometer.shape),
        )
        error = difference(exact.end(), rule(altered(clean, *added), BIAS, noise).end())[0]
        total += error @ information @ error
    assert chi2.ppf(1e-4, 9 * runs) < total < chi2.ppf(1.0 - 1e-4, 9 * runs)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_true_errors_are_consistent_with_the_covariance(factor: float) -> None:
    """Against the analytic motion, smoothness found anew in every window: smoothing adds little."""
    noise, total, runs = noise_at(200.0, factor), 0.0, 150
    for seed in range(runs):
        motion = shaken(seed)
        window = window_of(motion, 0.2, 200.0, noise=noise, seed=seed)
        found = gp_preintegration(window, NO_BIAS, noise)
        error = difference(true_increments(motion, END), found.end())[0]
        total += error @ np.linalg.solve(found.covariance(0.2), error)
    assert 0.9 < total / (9 * runs) < 1.15


@pytest.mark.slow
def test_the_papers_kernel_does_no_better() -> None:
    """Squared-exponential GPs, dense, with integrals by erf (28), (29) and the same fixed point."""
    noise = noise_at(200.0)
    errors: tuple[list[Array], list[Array]] = ([], [])
    for seed, motion in enumerate(FAST[:12]):
        window = window_of(motion, 0.2, 200.0, noise=noise, seed=seed)
        errors[0].append(true_error(motion, gp_preintegration(window, NO_BIAS, noise).end(), END)[0])
        errors[1].append(true_error(motion, squared_exponential_increments(window, noise), END)[0])
    ours, dense = rms(errors[0]), rms(errors[1])
    assert (ours < 1.1 * dense).all(), f"{ours} against {dense}"
    assert (dense < 1.1 * ours).all(), f"less accurate than the dense oracle: {ours} against {dense}"


def squared_exponential_increments(window: ImuWindow, noise: SampleNoise) -> Increments:
    """Increments at 0.2 s: latent rates by fixed-point iteration, kernel length by likelihood."""
    t_g, t_a = window.gyroscope_t, window.accelerometer_t
    rho, phi = window.gyroscope, np.zeros_like(window.gyroscope)
    kernel = likeliest(t_g, window.gyroscope, noise.gyroscope)
    for _ in range(20):
        gp = DenseRegression(kernel(t_g, t_g), noise.gyroscope**2, rho)
        phi = gp.mean(kernel.once(t_g, t_g))
        rho = np.stack([rate_of(p, w) for p, w in zip(phi, window.gyroscope, strict=True)])
    gp = DenseRegression(kernel(t_g, t_g), noise.gyroscope**2, rho)
    alpha = Rotation.from_rotvec(gp.mean(kernel.once(t_a, t_g))).apply(window.accelerometer)
    push = likeliest(t_a, alpha, noise.accelerometer)
    acceleration = DenseRegression(push(t_a, t_a), noise.accelerometer**2, alpha)
    return Increments(
        Rotation.from_rotvec(gp.mean(kernel.once(END, t_g))).as_matrix(),
        acceleration.mean(push.once(END, t_a)),
        acceleration.mean(push.twice(END, t_a)),
        np.zeros((1, 9, 6)),
    )


def likeliest(t: Array, y: Array, sigma: float) -> SquaredExponential:
    kernels = [SquaredExponential(3.0 * np.abs(y).max(), length) for length in (0.03, 0.05, 0.08, 0.13, 0.2)]
    return min(kernels, key=lambda k: DenseRegression(k(t, t), sigma**2, y).minus_twice_log_likelihood())


def rate_of(phi: Array, omega: Array) -> Array:
    """`phi_dot` from `omega = J_r(phi) phi_dot`, the Jacobian from its closed form."""
    angle = np.linalg.norm(phi)
    if angle < 1e-9:
        return omega
    x, y, z = phi
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    J = np.eye(3) - (1.0 - np.cos(angle)) / angle**2 * hat + (angle - np.sin(angle)) / angle**3 * hat @ hat
    return np.asarray(np.linalg.solve(J, omega))


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    duration=st.floats(0.004, 0.3),
    rate_hz=st.sampled_from([90.0, 200.0, 1000.0]),
    missing=st.integers(0, 2),
    kept=st.floats(0.5, 1.0),
)
def test_jitter_gaps_and_missing_ends(
    seed: int, duration: float, rate_hz: float, missing: int, kept: float
) -> None:
    """Irregular stamps, dropped samples, ends without samples: finite, close to the truth, positive."""
    rng, motion, noise = np.random.default_rng(seed), shaken(seed, 10.0, 2.0), noise_at(rate_hz)
    full = window_of(motion, duration, rate_hz, beyond=4, noise=noise, seed=seed)
    chosen = np.sort(
        rng.permutation(np.arange(1, len(full.gyroscope_t) - 1))[: int(kept * len(full.gyroscope_t))]
    )
    chosen = np.unique(
        np.concatenate([[0, 1], chosen, [len(full.gyroscope_t) - 2, len(full.gyroscope_t) - 1]])
    )
    chosen = chosen[: len(chosen) - missing]
    window = ImuWindow(
        full.gyroscope_t[chosen], full.gyroscope[chosen], full.accelerometer_t, full.accelerometer, duration
    )
    found = gp_preintegration(window, NO_BIAS, noise)
    error = true_error(motion, found.end(), np.array([duration]))[0]
    assert (error < [0.05, 1.0, 0.2]).all()
    assert np.linalg.eigvalsh(found.covariance(duration)).min() > 0.0


@pytest.mark.parametrize("apart", [1e-9, 1e-7, 1e-5])
@pytest.mark.parametrize("factor", [1.0, 100.0])
def test_samples_almost_at_once(apart: float, factor: float) -> None:
    """Noise between stamps that are nanoseconds apart is not a slope."""
    motion, noise = shaken(1), noise_at(200.0)
    window = window_of(motion, 0.2, 200.0, noise=noise_at(200.0, factor))
    t = np.sort(np.concatenate([window.gyroscope_t, window.gyroscope_t[::3] + apart]))
    omega = motion.angular_velocity_b(START + t)
    omega = omega + factor * noise.gyroscope * np.random.default_rng(2).normal(size=omega.shape)
    doubled = ImuWindow(t, omega, window.accelerometer_t, window.accelerometer, 0.2)
    found = gp_preintegration(doubled, NO_BIAS, noise)
    error = true_error(motion, found.end(), END)[0]
    assert (error < factor * np.array([1e-3, 1e-2, 1e-3])).all()
    assert np.linalg.eigvalsh(found.covariance(0.2)).min() > 0.0


def test_two_samples_are_enough() -> None:
    t, one = np.array([0.0, 0.01]), np.ones((2, 3))
    found = gp_preintegration(ImuWindow(t, 0.1 * one, t, 9.0 * one, 0.01), NO_BIAS, SampleNoise(1e-3, 1e-2))
    np.testing.assert_allclose(found.end().nu[0], 0.09, rtol=0.01)


def test_half_a_turn_is_refused() -> None:
    t = np.linspace(0.0, 0.2, 41)
    force = np.tile([0.0, 0.0, 9.81], (41, 1))
    noise = SampleNoise(1e-3, 1e-2)
    for rate, accepted in ((15.0, True), (16.0, False), (1000.0, False)):
        window = ImuWindow(t, np.tile([0.0, rate, 0.0], (41, 1)), t, force, 0.2)
        if accepted:
            C = gp_preintegration(window, NO_BIAS, noise).end().C[0]
            np.testing.assert_allclose(C, Rotation.from_rotvec([0.0, 3.0, 0.0]).as_matrix(), atol=1e-9)
        else:
            with pytest.raises(InertialError, match="half a turn"):
                gp_preintegration(window, NO_BIAS, noise)
