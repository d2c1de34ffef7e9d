# SPDX-License-Identifier: Apache-2.0
"""Check that poses and IMU samples agree in clocks, units and axes, before and after a path is fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from asyneio.errors import SimulationError
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory, RecordArray

#: Minimum common time span for a fit [s].
_SHORTEST_S = 1.0
#: Length of the windows for mean rates [s], and maximum step between poses in them [s].
_WINDOW_S, _LONGEST_GAP_S = 0.1, 0.15
#: Maximum offset between the clocks [s], and step of the search [s].
_LARGEST_LAG_S, _LAG_STEP_S = 2.0, 0.01
#: Minimum RMS angular rate for a comparison [rad/s].
_LEAST_RATE = 0.03
#: Limits of agreement: correlation of rates, their ratio, and angle between the axes [deg].
_LEAST_CORRELATION, _SCALE, _LARGEST_ANGLE = 0.95, (0.9, 1.1), 3.0
#: Minimum ratio of the second to the first singular value for observable axes.
_SPREAD = 0.02
#: Maximum RMS residuals of a fit: rad/s, m/s^2, m, rad.
_LEFT_OVER = {"rad/s": 0.5, "m/s^2": 5.0, "m": 0.1, "rad": 0.05}


def common_span_ns(poses: PoseTrajectory, streams: Sequence[RecordArray]) -> tuple[int, int]:
    """First and last common time of poses and streams [ns].

    Raises:
        SimulationError: the common time span is shorter than a second.
    """
    if poses.t_ns.size < 2 or any(stream.size < 2 for stream in streams):
        raise SimulationError("fewer than two poses or IMU samples; expected seconds of both")
    stamps = [poses.t_ns, *(stream["t_ns"] for stream in streams)]
    start_ns, end_ns = max(int(t[0]) for t in stamps), min(int(t[-1]) for t in stamps)
    if end_ns - start_ns < _SHORTEST_S * NS_PER_S:
        raise SimulationError(
            f"the poses span {_span(poses.t_ns)} and the IMU {_span(stamps[-1])}, so they have less than "
            f"{_SHORTEST_S:g} s in common; expected both from one run in one clock: shift the times of one "
            "file, or use the file that belongs to the other"
        )
    return start_ns, end_ns


def check_rates(poses: PoseTrajectory, gyroscope: RecordArray) -> float:
    """Approximate time by which the gyroscope's clock is ahead of that of the poses [s].

    It compares mean rates over short windows: magnitudes give the clock offset, vectors give unit and axes.

    Raises:
        SimulationError: the rates do not correlate, or differ in scale or axes.
    """
    middle_s, rate_p = _rates_of_poses(poses)
    if np.sqrt(np.mean(rate_p**2)) < _LEAST_RATE / 10.0:
        turning = float(np.sqrt(np.mean((gyroscope["xyz"] - np.median(gyroscope["xyz"], axis=0)) ** 2)))
        if turning > 10.0 * _LEAST_RATE:
            raise SimulationError(
                f"the orientation of the poses never changes, but the gyroscope reads {turning:.2f} rad/s "
                "(RMS); expected poses with orientation, x y z qx qy qz qw, of the body that carries the IMU"
            )
    if np.sqrt(np.mean(rate_p**2)) < _LEAST_RATE:
        return 0.0
    t_s = (gyroscope["t_ns"] - poses.t_ns[0]) / NS_PER_S
    integral = np.vstack([np.zeros(3), np.cumsum(np.diff(t_s)[:, None] * gyroscope["xyz"][1:], axis=0)])
    lags = np.arange(-_LARGEST_LAG_S, _LARGEST_LAG_S + 1e-9, _LAG_STEP_S)
    alike = [_alike(rate_p, _mean_rates(t_s, integral, middle_s + lag)) for lag in lags]
    lag_s = float(lags[int(np.argmax(alike))])
    if max(alike) < _LEAST_CORRELATION:
        raise SimulationError(
            f"the rates of poses and gyroscope correlate by {max(alike):.2f} at most, whatever their clocks "
            f"within {_LARGEST_LAG_S:g} s; expected at least {_LEAST_CORRELATION}: check that both files are "
            "of the same run, in one clock"
        )
    _check_axes(rate_p, _mean_rates(t_s, integral, middle_s + lag_s))
    return lag_s


def check_left_over(gyroscope: float, accelerometer: float, position: float, orientation: float) -> None:
    """Reject a fit with large RMS residuals (rad/s, m/s^2, m, rad; NaN for sensors that are absent).

    Raises:
        SimulationError: poses and samples do not agree.
    """
    found = dict(zip(_LEFT_OVER, (gyroscope, accelerometer, position, orientation), strict=True))
    if not any(value > most for value, most in zip(found.values(), _LEFT_OVER.values(), strict=True)):
        return
    raise SimulationError(
        "no smooth path agrees with poses and IMU; RMS residual "
        + ", ".join(f"{value:.3g} {unit}" for unit, value in found.items())
        + ", expected at most "
        + ", ".join(f"{value:g} {unit}" for unit, value in _LEFT_OVER.items())
        + ". Likely causes: positions not in metres, an accelerometer not in m/s^2 or without gravity, an "
        "IMU far from the body of the poses, or jumps in the poses"
    )


def _span(t_ns: IntArray) -> str:
    return f"{t_ns[0] / NS_PER_S:.3f} .. {t_ns[-1] / NS_PER_S:.3f} s"


def _rates_of_poses(poses: PoseTrajectory) -> tuple[FloatArray, FloatArray]:
    """Centres (N,) of windows [s since the first pose], and mean rates (N,3) over each [rad/s]."""
    t_s = (poses.t_ns - poses.t_ns[0]) / NS_PER_S
    edges = np.arange(0.0, t_s[-1], _WINDOW_S)
    C = Slerp(t_s, Rotation.from_quat(poses.quaternion))(edges)
    rate = (C[:-1].inv() * C[1:]).as_rotvec() / _WINDOW_S
    after = np.searchsorted(t_s, edges[:-1], side="right")
    # The rate between two distant poses is unknown.
    gaps = np.diff(t_s, append=np.inf)
    known = (gaps[after - 1] < _LONGEST_GAP_S) & (gaps[np.minimum(after, gaps.size - 1)] < _LONGEST_GAP_S)
    return edges[:-1][known] + 0.5 * _WINDOW_S, rate[known]


def _mean_rates(t_s: FloatArray, integral: FloatArray, middle_s: FloatArray) -> FloatArray:
    """Means (N,3) of a gyroscope over windows; NaN for windows beyond its span."""
    ends = [
        np.column_stack([np.interp(middle_s + half, t_s, integral[:, axis]) for axis in range(3)])
        for half in (-0.5 * _WINDOW_S, 0.5 * _WINDOW_S)
    ]
    rate = (ends[1] - ends[0]) / _WINDOW_S
    rate[(middle_s - _WINDOW_S < t_s[0]) | (middle_s + _WINDOW_S > t_s[-1])] = np.nan
    return rate


def _alike(one: FloatArray, other: FloatArray) -> float:
    """Correlation of rates (N,3) for any axes, units and constant offsets; -1 for too few rates."""
    both = np.isfinite(other).all(axis=1)
    if both.sum() < 10:
        return -1.0
    a, b = (rates[both] - rates[both].mean(axis=0) for rates in (one, other))
    return float(np.linalg.svd(a.T @ b, compute_uv=False).sum() / np.sqrt((a**2).sum() * (b**2).sum()))


def _check_axes(rate_p: FloatArray, rate_g: FloatArray) -> None:
    """Check unit and axes of a gyroscope whose rates (N,3) correlate with those of the poses."""
    both = np.isfinite(rate_g).all(axis=1)
    a, b = (rates[both] - rates[both].mean(axis=0) for rates in (rate_p, rate_g))
    scale = float(np.sqrt((b**2).sum() / (a**2).sum()))
    if not _SCALE[0] <= scale <= _SCALE[1]:
        degrees = "; it seems to be in deg/s" if 50.0 < scale < 65.0 else ""
        raise SimulationError(
            f"the gyroscope reads {scale:.3g} times the rates of the poses{degrees}; expected 1: check the "
            "unit of the gyroscope (rad/s) and of the timestamps of both files"
        )
    U, S, Vt = np.linalg.svd(b.T @ a)
    if S[1] < _SPREAD * S[0]:
        # All rotations are about one axis.
        return
    C_i_p = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    turn = Rotation.from_matrix(C_i_p)
    angle = float(np.degrees(turn.magnitude()))
    if angle > _LARGEST_ANGLE:
        x, y, z, w = turn.as_quat()
        raise SimulationError(
            f"the IMU is rotated by {angle:.1f} deg relative to the body of the poses (quaternion xyzw of "
            f"the body in the IMU: {x:.4f} {y:.4f} {z:.4f} {w:.4f}); expected poses of the IMU: rotate "
            "the orientations of the poses by it, or the axes of the samples"
        )
