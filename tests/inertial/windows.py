"""Analytic motions sampled around an interval, and the increments that they truly make."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from asyneio.inertial.increments import ImuWindow, Increments, Preintegration, SampleNoise
from asyneio.inertial.noise import InertialNoise, SensorNoise
from asyneio.simulation import AnalyticMotion
from asyneio.simulation.imu import specific_force_b
from asyneio.simulation.motion import Sinusoids
from asyneio.types import ImuNoise

Array = NDArray[np.float64]
Rule = Callable[[ImuWindow, Array, SampleNoise], Preintegration]

GRAVITY = 9.81
#: An ordinary MEMS IMU: densities 2e-4 rad/s/sqrt(Hz) and 2e-3 m/s^2/sqrt(Hz).
DENSITIES = (2e-4, 2e-3)
#: When the interval begins [s].
START = 1.0


def noise_at(rate_hz: float, factor: float = 1.0) -> SampleNoise:
    gyroscope, accelerometer = factor * np.sqrt(rate_hz) * np.array(DENSITIES)
    return SampleNoise(float(gyroscope), float(accelerometer))


def declared_noise(
    noise: ImuNoise, gyroscope_hz: float, accelerometer_hz: float, factor: float = 1.0
) -> InertialNoise:
    """White noise as declared, times a factor."""
    return InertialNoise(
        SensorNoise(factor * noise.gyroscope_density, gyroscope_hz),
        SensorNoise(factor * noise.accelerometer_density, accelerometer_hz),
    )


def shaken(seed: int, acceleration: float = 10.0, rate: float = 4.0, hz: float = 4.0) -> AnalyticMotion:
    """Two sinusoids a coordinate from 1 to `hz` Hz; typical acceleration [m/s^2] and turn rate [rad/s]."""
    rng = np.random.default_rng(seed)
    frequency = rng.uniform(1.0, hz, (6, 2))
    omega = 2.0 * np.pi * frequency
    amplitude = rng.normal(size=(6, 2)) / np.sqrt(2.0)
    amplitude[:3] *= acceleration / omega[:3] ** 2
    amplitude[3:] *= rate / omega[3:]
    return AnalyticMotion(Sinusoids(amplitude, frequency, rng.uniform(0.0, 6.28, (6, 2))), np.eye(3))


def times_around(duration: float, rate_hz: float, offset: float, beyond: int) -> Array:
    """Sample times of a clock that ticks at `offset`, with `beyond` samples outside either end."""
    first = np.ceil((-offset) * rate_hz - 1e-9) - beyond
    last = np.floor((duration - offset) * rate_hz + 1e-9) + beyond
    return np.arange(first, last + 1) / rate_hz + offset


def window_of(
    motion: AnalyticMotion,
    duration: float,
    rate_hz: float,
    accelerometer_hz: float | None = None,
    offsets: tuple[float, float] = (0.0, 0.0),
    beyond: int = 3,
    noise: SampleNoise | None = None,
    seed: int = 0,
) -> ImuWindow:
    rng = np.random.default_rng(seed)
    t_g = times_around(duration, rate_hz, offsets[0], beyond)
    t_a = times_around(duration, accelerometer_hz or rate_hz, offsets[1], beyond)
    omega = motion.angular_velocity_b(START + t_g)
    force = specific_force_b(motion, START + t_a, GRAVITY)
    if noise is not None:
        omega = omega + noise.gyroscope * rng.normal(size=omega.shape)
        force = force + noise.accelerometer * rng.normal(size=force.shape)
    return ImuWindow(t_g, omega, t_a, force, duration)


def true_increments(motion: AnalyticMotion, tau: Array) -> tuple[Array, Array, Array]:
    """C (N,3,3), nu (N,3), r (N,3) from the analytic poses and velocities, gravity taken out."""
    T_0, v_0 = motion.T_w_b(START)[0], motion.velocity_w(START)[0]
    T, v = motion.T_w_b(START + tau), motion.velocity_w(START + tau)
    C_0, g = T_0[:3, :3], np.array([0.0, 0.0, -GRAVITY])
    t = tau[:, None]
    nu = (v - v_0 - g * t) @ C_0
    r = (T[:, :3, 3] - T_0[:3, 3] - v_0 * t - 0.5 * g * t**2) @ C_0
    return C_0.T @ T[:, :3, :3], nu, r


def difference(a: tuple[Array, Array, Array] | Increments, b: Increments) -> Array:
    """[phi, nu, r] (N,9) from `a` to `b`, phi on the right of C."""
    phi = Rotation.from_matrix(a[0].transpose(0, 2, 1) @ b[0]).as_rotvec()
    return np.hstack([phi, b[1] - a[1], b[2] - a[2]])


def true_error(motion: AnalyticMotion, found: Increments, tau: Array) -> Array:
    """Norms (N,3) of the errors of rotation [rad], velocity [m/s], position [m]."""
    error = difference(true_increments(motion, tau), found).reshape(len(tau), 3, 3)
    return np.asarray(np.linalg.norm(error, axis=2))


def altered(window: ImuWindow, gyroscope: Array, accelerometer: Array) -> ImuWindow:
    """The window with something added to its samples."""
    return ImuWindow(
        window.gyroscope_t,
        window.gyroscope + gyroscope,
        window.accelerometer_t,
        window.accelerometer + accelerometer,
        window.duration,
    )


def covariance_by_differences(
    rule: Rule, bias: Array, window: ImuWindow, noise: SampleNoise, time: Array
) -> Array:
    """The sum over all samples of their effects' squares."""
    middle, total, step = rule(window, bias, noise).at(time), np.zeros((9, 9)), 1e-4
    shapes = window.gyroscope.shape, window.accelerometer.shape
    for sensor, sigma in enumerate((noise.gyroscope, noise.accelerometer)):
        for i in np.ndindex(shapes[sensor]):
            change = [np.zeros(shapes[0]), np.zeros(shapes[1])]
            change[sensor][i] = step
            up = difference(middle, rule(altered(window, *change), bias, noise).at(time))[0]
            change[sensor][i] = -step
            down = difference(middle, rule(altered(window, *change), bias, noise).at(time))[0]
            total += sigma**2 * np.outer(up - down, up - down) / (2.0 * step) ** 2
    return total


def spread(found: Array, expected: Array) -> float:
    """Largest relative error of the variance in any direction: 0 for two equal covariances."""
    ratio = eigh(found, expected, eigvals_only=True)
    return float(np.abs(ratio - 1.0).max())
