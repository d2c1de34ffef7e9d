# SPDX-License-Identifier: Apache-2.0
"""Time offset between the rotations of camera and gyroscope: the offset with the smallest innovations."""

from __future__ import annotations

import numpy as np

from asyneio.rotation.camera_rates import CameraRates
from asyneio.rotation.noise import differences, noise_of, spread, weights
from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray, RecordArray

#: Range and step of the search [s]; then size [s] and number of the fine steps on each side of the best.
_REACH_S, _STEP_S, _FINE_STEP_S, _FINE = 0.1, 0.007, 0.0015, 6
#: Range and step [s] of the wide search, used if no offset within the first range fits.
_FAR_S, _FAR_STEP_S = 10.0, 0.02
#: Minimum number of windows for an estimate.
LEAST_WINDOWS = 6
_ROBUST_STEPS = 3
#: Ranges that are searched, each from the edge of the one before, and units of log-likelihood by which an
#: offset outside the first range must be likelier than the middle of it.
_MOVES, _LIKELIER = 4, 15.0


class TurnOf:
    """Integral of the readings of a gyroscope, or an accelerometer (INERTIAL_DTYPE, ascending), by the
    trapezoidal rule."""

    def __init__(self, gyroscope: RecordArray) -> None:
        self._origin_ns = int(gyroscope["t_ns"][0])
        self._t_s = (gyroscope["t_ns"] - self._origin_ns) / NS_PER_S
        steps = 0.5 * (gyroscope["xyz"][1:] + gyroscope["xyz"][:-1]) * np.diff(self._t_s)[:, None]
        self._turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]).T

    def means(self, rates: CameraRates, offset_s: float) -> tuple[FloatArray, BoolArray]:
        """Mean rates (N,3) [rad/s] over the shifted windows, and which windows (N,) the samples cover."""
        start, end = (
            (stamps - self._origin_ns) / NS_PER_S + offset_s for stamps in (rates.start_ns, rates.end_ns)
        )
        inside = (start >= 0.0) & (end <= self._t_s[-1]) & (end > start)
        span = np.where(end > start, end - start, 1.0)
        turn = [np.interp(end, self._t_s, axis) - np.interp(start, self._t_s, axis) for axis in self._turned]
        return np.stack(turn, axis=1) / span[:, None], np.asarray(inside)

    def between(self, t_ns: IntArray) -> FloatArray:
        """Integrals (N-1,3) of the readings between times (N,) [ns]; zero where there are no samples."""
        t_s = (t_ns - self._origin_ns) / NS_PER_S
        return np.diff(np.stack([np.interp(t_s, self._t_s, axis) for axis in self._turned], axis=1), axis=0)


def find_far_offset(rates: CameraRates, turn: TurnOf, around_s: float) -> float | None:
    """Offset within 10 s of `around_s` at which a linear map explains most; None without enough windows.

    The result is coarse and must be refined by `find_offset`. The search is expensive and used only for
    streams that do not agree near the calibrated offset. At least half the windows must be covered.
    """
    trials = around_s + np.arange(-round(_FAR_S / _FAR_STEP_S), round(_FAR_S / _FAR_STEP_S) + 1) * _FAR_STEP_S
    limit = 3.0 * spread(rates.omega)
    camera = np.clip(rates.omega, -limit, limit)
    costs = np.full(trials.size, np.inf)
    for k, trial in enumerate(trials.tolist()):
        body, inside = turn.means(rates, trial)
        count = np.count_nonzero(inside)
        if count < max(LEAST_WINDOWS, rates.count // 2):
            continue
        design = np.column_stack([body[inside], np.ones(count)])
        seen = camera[inside]
        normal = design.T @ design + 1e-3 * np.eye(4)
        left = seen - design @ np.linalg.solve(normal, design.T @ seen)
        costs[k] = float(np.log((left**2).mean(axis=0) / (seen**2).mean(axis=0) + 1e-6).sum())
    best = int(np.argmin(costs))
    return float(trials[best]) if np.isfinite(costs[best]) else None


def find_offset(rates: CameraRates, turn: TurnOf, around_s: float) -> tuple[float, float]:
    """Offset with the smallest innovations [s], and its standard deviation [s] (infinite: not observable)."""
    reach = min(_REACH_S + 2.0 * abs(around_s), 5.0 * _REACH_S)
    steps = np.arange(-round(reach / _STEP_S), round(reach / _STEP_S) + 1) * _STEP_S
    middle, centre = steps.size // 2, around_s
    needed = np.inf
    for _ in range(_MOVES):
        trials = centre + steps
        costs = np.array([_offset_cost(rates, turn, trial) for trial in trials])
        k = int(np.argmin(costs))
        if k not in (0, trials.size - 1) or not np.isfinite(costs[k]):
            break
        # The best offset is beyond the edge. It counts if it is far likelier than the one looked for.
        needed = min(needed, costs[middle] - 2.0 * _LIKELIER)
        centre = float(trials[k])
    if k in (0, trials.size - 1) or not np.isfinite(costs[k]) or costs[k] > needed:
        return around_s, float("inf")
    steps = np.arange(-_FINE, _FINE + 1) * _FINE_STEP_S
    costs = np.array([_offset_cost(rates, turn, trials[k] + step) for step in steps])
    if not np.isfinite(costs).all():
        return around_s, float("inf")
    # A parabola, because the costs of single steps are noisy.
    a, b, _ = np.polyfit(steps, costs, 2)
    if a <= 0.0:
        return around_s, float("inf")
    shift = float(np.clip(-b / (2.0 * a), steps[0], steps[-1]))
    # The cost is in squared standard deviations.
    return float(trials[k] + shift), float(np.sqrt(1.0 / a))


def _offset_cost(rates: CameraRates, turn: TurnOf, offset_s: float) -> float:
    """Twice the robust negative log-likelihood of the best linear map from body to camera rates; infinite if
    too few windows are covered."""
    body, inside = turn.means(rates, offset_s)
    if np.count_nonzero(inside) < max(LEAST_WINDOWS, rates.count // 2):
        return float("inf")
    design = np.hstack([body[inside], np.ones((np.count_nonzero(inside), 1))])
    gaps = gaps_of(rates, inside)
    cost = 0.0
    for axis in rates.omega[inside].T:
        alike = np.zeros((len(gaps), 1))
        for _ in range(2):
            rows, target = differences(design, alike), differences(axis[:, None], alike)
            map_ = _robust_solution(rows, target)
            noise = noise_of(axis[:, None] - design @ map_, gaps)
            alike = noise.alike
        # Scaled to all windows, covered or not, so that the costs of two offsets are comparable.
        cost += 2.0 * rates.count * float(np.log(noise.sigma[0]))
    return cost


def _robust_solution(rows: FloatArray, target: FloatArray) -> FloatArray:
    """Reweighted least squares of `rows @ x = target`, with weak regularization: for a rotation about a
    single axis the other axes are not observable."""
    weight = np.ones((len(rows), 1))
    for _ in range(_ROBUST_STEPS):
        normal = rows.T @ (rows * weight) + 1e-3 * np.eye(rows.shape[1])
        solution = np.linalg.solve(normal, rows.T @ (target * weight))
        residual = target - rows @ solution
        weight = weights(residual, spread(residual))[:, None]
    return np.asarray(solution)


def gaps_of(rates: CameraRates, inside: BoolArray) -> FloatArray:
    """Times between neighbouring windows (N-1,), in units of their median."""
    gaps = np.diff(rates.start_ns[inside]).astype(np.float64)
    return np.asarray(gaps / max(float(np.median(gaps)), 1.0))


def clock_fix(offset_s: float) -> str:
    """What to do about a time offset: calibrations contain less than a second."""
    if abs(offset_s) < 1.0:
        return f"set timeshift_cam_imu to {offset_s:.4f} s"
    return (
        f"add {offset_s:.4f} s to the timestamps of the camera, or subtract it from those of the IMU: "
        "timeshift_cam_imu must be less than 1 s"
    )
