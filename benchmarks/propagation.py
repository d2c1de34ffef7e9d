"""Propagation of real IMU samples by zero-order hold, midpoint rule and GPs, against motion capture.

Evidence: real. EuRoC V1_01 (200 Hz, gentle): from the true states and biases at 20 Hz, the pose after an
interval is propagated with the samples and compared with the ground truth. The lower limit of the error is
the noise of the samples and of the ground truth.

    python benchmarks/propagation.py [--every 4]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.geometry.so3 import so3_log
from asyneio.inertial.gp_preintegration import gp_preintegration
from asyneio.inertial.increments import ImuWindow, Preintegration, SampleNoise
from asyneio.inertial.preintegration import midpoint, zero_order_hold
from asyneio.types import FloatArray, IntArray
from common import data_folder, table

_GRAVITY_W = np.array([0.0, 0.0, -9.81])
_INTERVALS = (0.1, 0.2, 0.5)
_RATE_HZ = 200.0
#: Densities of the recording's sensor file, times the square root of the rate.
_NOISE = SampleNoise(1.6968e-4 * _RATE_HZ**0.5, 2e-3 * _RATE_HZ**0.5)
_BEYOND_NS = 15_000_000
_Rule = Callable[[ImuWindow, FloatArray, SampleNoise], Preintegration]
_RULES: dict[str, _Rule] = {"hold": zero_order_hold, "midpoint": midpoint, "GPP": gp_preintegration}


def load() -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    """Times [ns] and columns of the IMU (N,6) and of the ground truth (M,16)."""
    folder = data_folder() / "euroc_V1_01"
    return *_read(folder / "imu0_data.csv"), *_read(folder / "groundtruth_20hz_full_state.csv")


def _read(path: Path) -> tuple[IntArray, FloatArray]:
    """Times as integer nanoseconds, and the other columns as floats."""
    with path.open() as file:
        rows = [line.split(",", 1) for line in file if line.strip() and not line.startswith("#")]
    t_ns = np.array([int(row[0]) for row in rows], dtype=np.int64)
    return t_ns, np.array([row[1].split(",") for row in rows], dtype=np.float64)


def window_between(t_ns: IntArray, samples: FloatArray, start: int, end: int) -> ImuWindow | None:
    """Samples of the interval and of three periods around it; empty if the recording does not contain
    them."""
    first, last = np.searchsorted(t_ns, [start - _BEYOND_NS, end + _BEYOND_NS])
    if t_ns[first] > start or t_ns[last - 1] < end:
        return None
    t = np.asarray((t_ns[first:last] - start) * 1e-9, dtype=np.float64)
    chosen = samples[first:last]
    return ImuWindow(t, chosen[:, :3], t, chosen[:, 3:], (end - start) * 1e-9)


def errors(
    interval: float, every: int, data: tuple[IntArray, FloatArray, IntArray, FloatArray]
) -> dict[str, FloatArray]:
    """Errors (n,2) of rotation [deg] and position [mm] of each method."""
    imu_t, imu, truth_t, truth = data
    steps = round(interval * 20.0)
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in _RULES}
    C = Rotation.from_quat(truth[:, [4, 5, 6, 3]]).as_matrix()
    phi = np.empty(3)
    for k in range(0, len(truth_t) - steps, every):
        window = window_between(imu_t, imu, int(truth_t[k]), int(truth_t[k + steps]))
        if window is None:
            continue
        dt, v = window.duration, truth[k, 7:10]
        for name, rule in _RULES.items():
            end = rule(window, truth[k, 10:16], _NOISE).end()
            r = truth[k, :3] + v * dt + 0.5 * _GRAVITY_W * dt**2 + C[k] @ end.r[0]
            so3_log((C[k] @ end.C[0]).T @ C[k + steps], phi)
            found[name].append(
                (
                    float(np.degrees(np.linalg.norm(phi))),
                    1e3 * float(np.linalg.norm(r - truth[k + steps, :3])),
                )
            )
    return {name: np.array(e) for name, e in found.items()}


def main() -> None:
    """Print the medians."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--every", type=int, default=4, help="take every n-th state of the ground truth")
    options = parser.parse_args()
    data = load()
    rows = []
    for interval in _INTERVALS:
        result = errors(interval, options.every, data)
        for column, unit in enumerate(("rotation deg", "position mm")):
            medians = [float(np.median(result[name][:, column])) for name in _RULES]
            rows.append(
                [f"{interval}", str(len(result["GPP"])), unit, *(f"{value:.4f}" for value in medians)]
            )
    print("EuRoC V1_01, median error of the propagated pose")
    print(table(["interval s", "windows", "error", *_RULES], rows))


if __name__ == "__main__":
    main()
