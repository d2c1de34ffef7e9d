"""Discrete preintegration against gtsam and analytic motions, its derivatives against differences."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from asyneio.inertial.increments import ImuWindow, SampleNoise
from asyneio.inertial.preintegration import midpoint, zero_order_hold

from ..factors.jacobian_checker import check_jacobian
from .windows import (
    Array,
    Rule,
    altered,
    covariance_by_differences,
    difference,
    noise_at,
    shaken,
    spread,
    true_error,
    window_of,
)

RULES = [midpoint, zero_order_hold]
BIAS = np.array([0.01, -0.02, 0.03, 0.1, -0.2, 0.15])
END = np.array([0.2])
BLOCKS = [("b_g", 3), ("b_a", 3)]


def integrated_by_gtsam(omega: Array, force: Array, dt: Array, noise: SampleNoise, bias: Array):  # type: ignore[no-untyped-def]
    """gtsam's manifold preintegration of one rate and one force a step; its rule rotates by the start."""
    parameters = gtsam.PreintegrationParams.MakeSharedU(0.0)
    parameters.setGyroscopeCovariance(noise.gyroscope**2 * dt[0] * np.eye(3))
    parameters.setAccelerometerCovariance(noise.accelerometer**2 * dt[0] * np.eye(3))
    parameters.setIntegrationCovariance(np.zeros((3, 3)))
    found = gtsam.PreintegratedImuMeasurementsManifold(
        parameters, gtsam.imuBias.ConstantBias(bias[3:], bias[:3])
    )
    for n in range(len(dt)):
        found.integrateMeasurement(force[n], omega[n], dt[n])
    return found


def relative(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


def test_midpoint_equals_gtsam_on_averaged_samples() -> None:
    """gtsam is given the force already turned by half a step, which is what this rule adds to its own."""
    window, noise = window_of(shaken(0), 0.2, 200.0, beyond=0), noise_at(200.0)
    omega = 0.5 * (window.gyroscope[1:] + window.gyroscope[:-1]) - BIAS[:3]
    force = 0.5 * (window.accelerometer[1:] + window.accelerometer[:-1]) - BIAS[3:]
    dt = np.diff(window.gyroscope_t)
    turned = np.einsum("nij,nj->ni", Rotation.from_rotvec(0.5 * dt[:, None] * omega).as_matrix(), force)
    expected = integrated_by_gtsam(omega, turned, dt, noise, np.zeros(6))
    found = midpoint(window, BIAS, noise).end()
    assert relative(found.C[0], expected.deltaRij().matrix()) < 1e-12
    assert relative(found.nu[0], expected.deltaVij()) < 1e-12
    assert relative(found.r[0], expected.deltaPij()) < 1e-12


def test_zero_order_hold_equals_gtsam_in_value_derivative_and_covariance() -> None:
    window, noise = window_of(shaken(1), 0.2, 200.0, beyond=0), noise_at(200.0)
    steps = len(window.gyroscope_t) - 1
    dt = np.full(steps, 0.2 / steps)
    expected = integrated_by_gtsam(window.gyroscope[:-1], window.accelerometer[:-1], dt, noise, BIAS)
    rule = zero_order_hold(window, BIAS, noise)
    found = rule.end()
    assert relative(found.C[0], expected.deltaRij().matrix()) < 1e-12
    assert relative(found.nu[0], expected.deltaVij()) < 1e-12
    assert relative(found.r[0], expected.deltaPij()) < 1e-12
    # gtsam shows its bias derivatives through the prediction of a body at rest in a world without gravity.
    still = gtsam.NavState()
    for i in range(6):
        bias = BIAS.copy()
        bias[i] += 1e-3
        moved = expected.predict(still, gtsam.imuBias.ConstantBias(bias[3:], bias[:3]))
        turn = Rotation.from_matrix(found.C[0].T @ moved.attitude().matrix()).as_rotvec()
        column = np.concatenate([turn, moved.velocity() - found.nu[0], moved.position() - found.r[0]]) / 1e-3
        np.testing.assert_allclose(found.d_bias[0][:, i], column, rtol=1e-7, atol=1e-10)
    # gtsam orders rotation, position, velocity, with position and velocity in the body at the end.
    to_start = np.zeros((9, 9))
    to_start[:3, :3] = np.eye(3)
    to_start[3:6, 6:9] = to_start[6:9, 3:6] = found.C[0]
    theirs = to_start @ expected.preintMeasCov() @ to_start.T
    assert spread(rule.covariance(0.2), theirs) < 1e-9


@pytest.mark.parametrize(("rule", "order"), [(midpoint, 2.0), (zero_order_hold, 1.0)])
@pytest.mark.parametrize("rates", [(200.0, 200.0), (200.0, 500.0), (500.0, 200.0)])
def test_error_falls_with_the_order_of_the_rule(rule: Rule, order: float, rates: tuple[float, float]) -> None:
    """Against the analytic motion; sensors of different rates keep the order of the slower one."""
    errors = []
    for factor in (4.0, 8.0):
        error = np.zeros(3)
        for seed in range(8):
            motion = shaken(seed)
            window = window_of(motion, 0.2, factor * rates[0], factor * rates[1])
            found = rule(window, np.zeros(6), noise_at(200.0)).end()
            error += true_error(motion, found, END)[0] ** 2
        errors.append(np.sqrt(error))
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), order, atol=0.3)


@pytest.mark.parametrize("rule", RULES)
def test_queries_are_shorter_intervals(rule: Rule) -> None:
    """At any time inside the same as integrating to that time; at the start nothing has happened."""
    motion, noise = shaken(2), noise_at(200.0)
    window = window_of(motion, 0.2, 200.0, 130.0, offsets=(0.0011, 0.0023))
    tau = np.array([0.2, 0.0, 0.1234, 0.005, 0.0011])
    found = rule(window, BIAS, noise).at(tau)
    for n in (0, 2, 3, 4):
        parts = (window.gyroscope_t, window.gyroscope, window.accelerometer_t, window.accelerometer)
        alone = rule(ImuWindow(*parts, duration=tau[n]), BIAS, noise)
        for a, b in zip(alone.end(), found, strict=True):
            np.testing.assert_allclose(a[0], b[n], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(
            alone.covariance(tau[n]), rule(window, BIAS, noise).covariance(tau[n]), rtol=1e-9, atol=1e-20
        )
    assert np.abs(found.C[1] - np.eye(3)).max() < 1e-15
    for nothing in (found.nu[1], found.r[1], found.d_bias[1], rule(window, BIAS, noise).covariance(0.0)):
        assert np.abs(nothing).max() == 0.0


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("tau", [0.2, 0.1234])
def test_bias_derivatives(rule: Rule, tau: float) -> None:
    window = window_of(shaken(3), 0.2, 200.0, 150.0, offsets=(0.0, 0.0031))
    noise, time = noise_at(200.0), np.array([tau])
    found = rule(window, BIAS, noise).at(time)
    check_jacobian(
        rule.__name__,
        found.d_bias[0],
        lambda d: difference(found, rule(window, BIAS + d, noise).at(time))[0],
        BLOCKS,
    )


@pytest.mark.parametrize("rule", RULES)
def test_covariance_is_that_of_every_sample(rule: Rule) -> None:
    """Differences with respect to each sample: nothing is assumed of how samples enter the rule."""
    window = window_of(shaken(4), 0.05, 200.0, 150.0, offsets=(0.0, 0.0031))
    noise, time = noise_at(200.0), np.array([0.047])
    found = rule(window, BIAS, noise)
    expected = covariance_by_differences(rule, BIAS, window, noise, time)
    assert spread(found.covariance(0.047), expected) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("rule", RULES)
def test_scatter_under_noise_is_the_covariance(rule: Rule) -> None:
    rng, runs = np.random.default_rng(6), 400
    window, noise = window_of(shaken(5), 0.2, 200.0), noise_at(200.0)
    clean = rule(window, BIAS, noise)
    information = np.linalg.inv(clean.covariance(0.2))
    total = 0.0
    for _ in range(runs):
        added = (
            noise.gyroscope * rng.normal(size=window.gyroscope.shape),
            noise.accelerometer * rng.normal(size=window.accelerometer.shape),
        )
        error = difference(clean.end(), rule(altered(window, *added), BIAS, noise).end())[0]
        total += error @ information @ error
    assert chi2.ppf(1e-4, 9 * runs) < total < chi2.ppf(1.0 - 1e-4, 9 * runs)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), split=st.floats(0.03, 0.17))
def test_increments_compose(seed: int, split: float) -> None:
    """Two intervals after each other make the whole, where a sample stands at the seam."""
    window, noise = window_of(shaken(seed), 0.2, 200.0), noise_at(200.0)
    seam = float(window.gyroscope_t[np.argmin(np.abs(window.gyroscope_t - split))])
    later = ImuWindow(
        window.gyroscope_t - seam,
        window.gyroscope,
        window.accelerometer_t - seam,
        window.accelerometer,
        0.2 - seam,
    )
    whole = midpoint(window, BIAS, noise)
    a, b = whole.at(np.array([seam])), midpoint(later, BIAS, noise).end()
    C, nu, r, _ = whole.end()
    np.testing.assert_allclose(a.C[0] @ b.C[0], C[0], atol=1e-12)
    np.testing.assert_allclose(a.nu[0] + a.C[0] @ b.nu[0], nu[0], atol=1e-12)
    np.testing.assert_allclose(a.r[0] + a.nu[0] * (0.2 - seam) + a.C[0] @ b.r[0], r[0], atol=1e-12)
