# SPDX-License-Identifier: Apache-2.0
"""Study: accuracy and cost of preintegration methods over a window."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import product

import numpy as np

from asyneio.inertial.gp_preintegration import gp_preintegration
from asyneio.inertial.increments import ImuWindow, Increments, Preintegration, SampleNoise
from asyneio.inertial.preintegration import midpoint, zero_order_hold
from asyneio.simulation import AnalyticMotion
from asyneio.simulation.imu import specific_force_b
from asyneio.studies.imu_noise import NOISE
from asyneio.studies.known_motion import MOTION_SETTINGS, MotionKind, angles_between, draw_known_motion, rms
from asyneio.studies.study import QUICK_SEEDS, SEEDS, Contest, Metric, Study, View
from asyneio.types import FloatArray

Rule = Callable[[ImuWindow, FloatArray, SampleNoise], Preintegration]

RULES: dict[str, Rule] = {"zero-order hold": zero_order_hold, "midpoint": midpoint, "gpp": gp_preintegration}
WINDOWS_S = (0.05, 0.1, 0.2, 0.5)
RATES_HZ = (100, 200, 1000)

_GRAVITY = 9.81
#: Number of windows of a task, and time span in which they begin [s].
_WINDOWS, _SPAN_S = 20, 4.0
#: Number of samples beyond each end of a window.
_MARGIN = 2.5

ROTATION = Metric("rotation_deg", "rotation error", "deg")
VELOCITY = Metric("velocity_mm_s", "velocity error", "mm/s")
POSITION = Metric("position_mm", "position error", "mm")
COST = Metric("cost_ms", "time for a window", "ms")
_METRICS = (ROTATION, VELOCITY, POSITION, COST)
_LINES = ("rule",)


@dataclass(frozen=True)
class PreintegrationTask:
    """A method over windows of `window_s` with samples at `rate_hz` and a level of noise."""

    rule: str
    window_s: float
    rate_hz: int
    noise: str
    seed: int


def measure(task: PreintegrationTask) -> dict[str, float]:
    """RMS errors at the ends of the windows, and the minimum time, which is least affected by other load."""
    # All methods use the same motion, windows and noise.
    rng = np.random.default_rng([task.seed, round(1e3 * task.window_s), task.rate_hz])
    motion = draw_known_motion(MotionKind.BOTH, 1.0, rng)
    starts_s = rng.uniform(0.0, _SPAN_S, _WINDOWS)
    density = NOISE[task.noise]
    root_rate = np.sqrt(task.rate_hz)
    noise = SampleNoise(density.assumed_gyroscope * root_rate, density.assumed_accelerometer * root_rate)
    sigma = (density.gyroscope * root_rate, density.accelerometer * root_rate)
    integrate, bias = RULES[task.rule], np.zeros(6)
    errors, seconds = [], []
    for start_s in starts_s:
        window = _draw_window(motion, float(start_s), task, sigma, rng)
        started = time.perf_counter()
        end = integrate(window, bias, noise).end()
        seconds.append(time.perf_counter() - started)
        errors.append(_errors(end, true_increments(motion, float(start_s), task.window_s)))
    rotation, velocity, position = np.array(errors).T
    return {
        ROTATION.name: rms(np.rad2deg(rotation)),
        VELOCITY.name: 1e3 * rms(velocity),
        POSITION.name: 1e3 * rms(position),
        COST.name: 1e3 * min(seconds),
    }


def true_increments(
    motion: AnalyticMotion, start_s: float, duration_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True rotation (3,3), velocity (3,) and position (3,) increments of the motion, (29) and (30).

    With C, v, r of the body in the world: `C_k^T C`, `C_k^T (v - v_k - g dt)`,
    `C_k^T (r - r_k - v_k dt - g dt^2 / 2)`.
    """
    t_s = np.array([start_s, start_s + duration_s])
    g_w = np.array([0.0, 0.0, -_GRAVITY])
    T, v = motion.T_w_b(t_s), motion.velocity_w(t_s)
    C_b_w, r = T[0, :3, :3].T, T[:, :3, 3]
    velocity = v[1] - v[0] - g_w * duration_s
    position = r[1] - r[0] - v[0] * duration_s - 0.5 * g_w * duration_s**2
    return C_b_w @ T[1, :3, :3], C_b_w @ velocity, C_b_w @ position


def preintegration(quick: bool = False, seeds: int | None = None) -> Study:
    """The study; `quick`: one rate, two windows, two levels of noise."""
    windows_s = (0.1, 0.2) if quick else WINDOWS_S
    rates_hz = (200,) if quick else RATES_HZ
    levels = ("none", "medium") if quick else tuple(NOISE)
    tasks = tuple(
        PreintegrationTask(rule, window_s, rate_hz, noise, seed)
        for seed in range(seeds or (QUICK_SEEDS if quick else SEEDS))
        for window_s, rate_hz, noise, rule in product(windows_s, rates_hz, levels, RULES)
    )
    return Study(
        name="preintegration",
        question="How accurate and how fast is preintegration of inertial samples by zero-order hold, by the "
        "midpoint rule and by Gaussian processes, over fast random motions?",
        settings={
            "windows": _WINDOWS,
            "span_s": _SPAN_S,
            "margin": _MARGIN,
            "cost": "fastest window",
            "motion": MOTION_SETTINGS,
            "noise": {name: asdict(level) for name, level in NOISE.items()},
        },
        tasks=tasks,
        measure=measure,
        views=tuple(view for rate_hz in rates_hz for view in _views(rate_hz)),
        contests=tuple(contest for rate_hz in rates_hz for contest in _contests(rate_hz)),
        labels={"window_s": "length of the window [s]", "noise": "noise of the IMU"},
    )


def _views(rate_hz: int) -> Iterator[View]:
    for noise in ("none", "medium"):
        yield View(
            f"window-{rate_hz}hz-{noise}",
            f"{rate_hz} Hz, noise {noise}: error against the length of the window",
            _METRICS,
            "window_s",
            _LINES,
            {"rate_hz": rate_hz, "noise": noise},
            log_x=True,
        )
    yield View(
        f"noise-{rate_hz}hz",
        f"{rate_hz} Hz, windows of 0.2 s: error against noise",
        _METRICS,
        "noise",
        _LINES,
        {"rate_hz": rate_hz, "window_s": 0.2},
    )


def _contests(rate_hz: int) -> Iterator[Contest]:
    for metric in (POSITION, ROTATION):
        name, title = f"best-{metric.name}-{rate_hz}hz", f"{rate_hz} Hz: smallest {metric.title}"
        yield Contest(name, title, metric, _LINES, "window_s", "noise", {"rate_hz": rate_hz})


def _draw_window(
    motion: AnalyticMotion,
    start_s: float,
    task: PreintegrationTask,
    sigma: tuple[float, float],
    rng: np.random.Generator,
) -> ImuWindow:
    """Noisy samples of both sensors around a window, each with its own phase."""
    gyroscope_t, accelerometer_t = (
        np.arange(rng.uniform() - _MARGIN, task.window_s * task.rate_hz + _MARGIN) / task.rate_hz
        for _ in range(2)
    )
    gyroscope = motion.angular_velocity_b(start_s + gyroscope_t)
    accelerometer = specific_force_b(motion, start_s + accelerometer_t, _GRAVITY)
    return ImuWindow(
        gyroscope_t,
        gyroscope + sigma[0] * rng.normal(size=gyroscope.shape),
        accelerometer_t,
        accelerometer + sigma[1] * rng.normal(size=accelerometer.shape),
        task.window_s,
    )


def _errors(end: Increments, truth: tuple[FloatArray, FloatArray, FloatArray]) -> tuple[float, float, float]:
    """Angle [rad] and norms [m/s, m] of the errors of the increments."""
    C, velocity, position = truth
    return (
        float(angles_between(C[None], end.C)[0]),
        float(np.linalg.norm(end.nu[0] - velocity)),
        float(np.linalg.norm(end.r[0] - position)),
    )
