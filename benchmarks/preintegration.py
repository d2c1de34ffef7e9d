"""Preintegration by GPs, midpoint rule and zero-order hold: accuracy over 0.2 s, and time.

Evidence: simulation, errors against the analytic motion. `fast` is the motion that Le Gentil and
Vidal-Calleja (IJRR 2023) simulate: three sinusoids of 3 to 5 m/s per velocity axis between 0.7 and 3.1 Hz,
one of 0.75 to 1 rad per Euler angle between 0.5 and 1 Hz; their noise is 0.002 rad/s and 0.02 m/s^2 per
sample. `shaken` has two sinusoids of 1 to 4 Hz per coordinate, about 10 m/s^2 and 4 rad/s. The noise `none`
shows the error of the method alone.

    python benchmarks/preintegration.py [--windows 200]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from asyneio.inertial.gp_preintegration import gp_preintegration
from asyneio.inertial.increments import ImuWindow, Preintegration, SampleNoise
from asyneio.inertial.preintegration import midpoint, zero_order_hold
from asyneio.inertial.smoothness import find_smoothness
from asyneio.simulation import AnalyticMotion
from asyneio.simulation.imu import specific_force_b
from asyneio.simulation.motion import Sinusoids
from asyneio.types import FloatArray
from common import table

_GRAVITY = 9.81
_DURATION = 0.2
_RATES = (100.0, 200.0, 1000.0)
_Rule = Callable[[ImuWindow, FloatArray, SampleNoise], Preintegration]
_RULES: dict[str, _Rule] = {"hold": zero_order_hold, "midpoint": midpoint, "GPP": gp_preintegration}
#: Standard deviation of a sample without noise: far below the errors of all methods.
_NONE = SampleNoise(1e-9, 1e-8)


def fast(rng: np.random.Generator) -> AnalyticMotion:
    """Up to 60 m/s^2 per axis and 6 rad/s."""
    low = 0.7 + 0.8 * np.arange(3)
    hz = np.vstack([rng.uniform(low, low + 0.8, (3, 3)), np.ones((3, 3))])
    hz[3:, 0] = rng.uniform(0.5, 1.0, 3)
    amplitude = np.zeros((6, 3))
    amplitude[:3] = rng.uniform(3.0, 5.0, (3, 3)) / (2.0 * np.pi * hz[:3])
    amplitude[3:, 0] = rng.uniform(0.75, 1.0, 3)
    return AnalyticMotion(Sinusoids(amplitude, hz, np.zeros((6, 3))), np.eye(3))


def shaken(rng: np.random.Generator) -> AnalyticMotion:
    """About 10 m/s^2 and 4 rad/s."""
    hz = rng.uniform(1.0, 4.0, (6, 2))
    amplitude = rng.normal(size=(6, 2)) / np.sqrt(2.0)
    amplitude[:3] *= 10.0 / (2.0 * np.pi * hz[:3]) ** 2
    amplitude[3:] *= 4.0 / (2.0 * np.pi * hz[3:])
    return AnalyticMotion(Sinusoids(amplitude, hz, rng.uniform(0.0, 6.28, (6, 2))), np.eye(3))


def sampled(
    motion: AnalyticMotion, start: float, rate_hz: float, noise: SampleNoise, rng: np.random.Generator
) -> ImuWindow:
    """Samples over the interval and three periods beyond both ends."""
    t = np.arange(-3, round(_DURATION * rate_hz) + 4) / rate_hz
    omega, force = motion.angular_velocity_b(start + t), specific_force_b(motion, start + t, _GRAVITY)
    return ImuWindow(
        t,
        omega + noise.gyroscope * rng.normal(size=omega.shape),
        t,
        force + noise.accelerometer * rng.normal(size=force.shape),
        _DURATION,
    )


def position_error_mm(motion: AnalyticMotion, start: float, r: FloatArray) -> float:
    """Distance of the increment `r` (3,) from the true one."""
    T, v = motion.T_w_b([start, start + _DURATION]), motion.velocity_w(start)[0]
    way = T[1, :3, 3] - T[0, :3, 3] - v * _DURATION + [0.0, 0.0, 0.5 * _GRAVITY * _DURATION**2]
    return 1e3 * float(np.linalg.norm(T[0, :3, :3].T @ way - r))


def errors_mm(
    draw: Callable[[np.random.Generator], AnalyticMotion], rate_hz: float, noise: SampleNoise, windows: int
) -> dict[str, float]:
    """RMS position error of each method."""
    errors: dict[str, list[float]] = {name: [] for name in _RULES}
    for seed in range(windows):
        rng = np.random.default_rng(seed)
        motion, start = draw(rng), float(rng.uniform(0.5, 5.0))
        window = sampled(motion, start, rate_hz, noise, rng)
        for name, rule in _RULES.items():
            found = rule(window, np.zeros(6), noise).end()
            errors[name].append(position_error_mm(motion, start, found.r[0]))
    return {name: float(np.sqrt(np.mean(np.square(e)))) for name, e in errors.items()}


def accuracy(windows: int) -> list[list[str]]:
    """Rows of the first table."""
    rows = []
    for motion_name, draw in (("fast", fast), ("shaken", shaken)):
        for rate in _RATES:
            density = {
                "none": _NONE,
                "0.002, 0.02 per sample": SampleNoise(0.002, 0.02),
                "1.7e-4, 2e-3 /√Hz": SampleNoise(1.7e-4 * rate**0.5, 2e-3 * rate**0.5),
                "1e-3, 1e-2 /√Hz": SampleNoise(1e-3 * rate**0.5, 1e-2 * rate**0.5),
            }
            for noise_name, noise in density.items():
                e = errors_mm(draw, rate, noise, windows)
                rows.append(
                    [motion_name, f"{rate:.0f}", noise_name]
                    + [f"{e[name]:.3g}" for name in _RULES]
                    + [f"{e['midpoint'] / e['GPP']:.3g}"]
                )
    return rows


def median_us(task: Callable[[], object], repeats: int = 300) -> float:
    """Median time of a call."""
    task()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        task()
        seconds.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(seconds))


def speed() -> list[list[str]]:
    """Rows of the second table."""
    rows, bias = [], np.zeros(6)
    tau = np.linspace(0.0, _DURATION, 2000)
    for rate in _RATES:
        rng, noise = np.random.default_rng(0), SampleNoise(0.002, 0.02)
        window = sampled(fast(rng), 1.0, rate, noise, rng)
        smoothness = find_smoothness(window, noise)
        found = gp_preintegration(window, bias, noise)
        times = [
            median_us(partial(midpoint, window, bias, noise)),
            median_us(partial(gp_preintegration, window, bias, noise)),
            median_us(partial(gp_preintegration, window, bias, noise, smoothness)),
            median_us(partial(found.covariance, _DURATION)),
            median_us(partial(found.at, tau)) / len(tau),
        ]
        rows.append([f"{rate:.0f}", *(f"{t:.3g}" for t in times), f"{times[1] / times[0]:.2f}"])
    return rows


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--windows", type=int, default=200)
    options = parser.parse_args()
    print(
        f"RMS position error [mm] after {_DURATION} s, windows 0..{options.windows - 1}; noise rad/s, m/s^2"
    )
    print(
        table(["motion", "IMU Hz", "noise", *_RULES, "midpoint / GPP"], accuracy(options.windows)),
        end="\n\n",
    )
    print(f"median time [µs] of a window of {_DURATION} s, and of one query among 2000")
    header = [
        "IMU Hz",
        "midpoint",
        "GPP",
        "GPP, smoothness known",
        "its covariance",
        "query",
        "GPP / midpoint",
    ]
    print(table(header, speed()))


if __name__ == "__main__":
    main()
