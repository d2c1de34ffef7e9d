"""Motion along a recorded trajectory: quintic splines through it, whose derivatives are exact.

The splines, not the file, are the truth: they are smooth (four times differentiable) where the file has
noise, and an IMU simulated on them agrees with them to the last digit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.spatial.transform import Rotation

from asyneio.errors import SimulationError
from asyneio.types import NS_PER_S, FloatArray

_DEGREE = 5
#: Spacing of the knots: motion faster than this is taken for noise.
_KNOT_S = 0.1
#: Axes of the camera (x right, y down, z forward) in the sensor frame of a file, one a column. EuRoC's sensor
#: has x up and z forward, the UZH-FPV drone's x forward and z up.
_EUROC_C_s_c = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_UZH_C_s_c = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class SplineMotion:
    """Exact motion of a body along splines; times are float seconds since the start (see `Motion`).

    `position` [m] and `quaternion` (xyzw, of any length near one) are splines of the sensor that was
    recorded; `C_s_b` (3,3) mounts the body on it, at the same place.
    """

    position: BSpline
    quaternion: BSpline
    C_s_b: FloatArray

    def T_w_b(self, t_s: ArrayLike) -> FloatArray:
        """Poses (N,4,4) mapping body to world coordinates."""
        t = _times(t_s)
        T_w_b = np.tile(np.eye(4), (t.size, 1, 1))
        T_w_b[:, :3, :3] = Rotation.from_quat(self.quaternion(t)).as_matrix() @ self.C_s_b
        T_w_b[:, :3, 3] = self.position(t)
        return T_w_b

    def velocity_w(self, t_s: ArrayLike) -> FloatArray:
        """Velocity (N,3) of the body's origin in the world [m/s]."""
        return np.asarray(self.position(_times(t_s), nu=1))

    def acceleration_w(self, t_s: ArrayLike) -> FloatArray:
        """Acceleration (N,3) of the body's origin in the world, gravity not included [m/s^2]."""
        return np.asarray(self.position(_times(t_s), nu=2))

    def angular_velocity_b(self, t_s: ArrayLike) -> FloatArray:
        """Angular velocity (N,3) of the body with respect to the world, in the body [rad/s]."""
        t = _times(t_s)
        rate = _left_quotient(self.quaternion(t), self.quaternion(t, nu=1))
        return 2.0 * rate[:, :3] @ self.C_s_b

    def angular_acceleration_b(self, t_s: ArrayLike) -> FloatArray:
        """Time derivative (N,3) of `angular_velocity_b` [rad/s^2]."""
        t = _times(t_s)
        q = self.quaternion(t)
        rate = _left_quotient(q, self.quaternion(t, nu=1))
        second = _left_quotient(q, self.quaternion(t, nu=2))
        # With r = q^-1 q' it holds that r' = q^-1 q'' - r r, and the vector part of r r is 2 r_w r_xyz.
        return 2.0 * (second[:, :3] - 2.0 * rate[:, 3:] * rate[:, :3]) @ self.C_s_b


def load_motion(file: Path, offset_s: float, duration_s: float, C_c_b: FloatArray) -> SplineMotion:
    """Motion along a part of a file: EuRoC's state CSV or UZH-FPV's ground truth in text.

    The part is moved so that its middle is the world's origin, and turned about the vertical so that the
    camera looks along x on average. Its size is kept.

    Args:
        file: the file.
        offset_s: where to start, after the file's first stamp [s].
        duration_s: length of the part [s].
        C_c_b: (3,3) body in the camera that is carried, which looks where the file's own camera looked.

    Raises:
        SimulationError: the file is absent, cannot be read, or is too short.
    """
    t_s, position, rotation, C_s_c = _read(file)
    if offset_s < 0.0 or offset_s + duration_s > t_s[-1]:
        raise SimulationError(
            f"{file} holds {t_s[-1]:.1f} s of motion; {duration_s} s from {offset_s} s on were asked for: "
            "use a smaller offset or a shorter run"
        )
    used = (t_s >= offset_s) & (t_s <= offset_s + duration_s)
    forward = (rotation[used].as_matrix() @ C_s_c[:, 2]).mean(axis=0)
    level = Rotation.from_euler("z", -np.arctan2(forward[1], forward[0]))
    position = level.apply(position)
    position -= 0.5 * (position[used].min(axis=0) + position[used].max(axis=0))
    quaternion = (level * rotation).as_quat()
    # q and -q are the same attitude; a spline needs one that does not jump.
    flips = np.concatenate([[1.0], np.sign(np.sum(quaternion[1:] * quaternion[:-1], axis=1))])
    quaternion *= np.cumprod(flips)[:, None]
    # A little beyond both ends, because splines are at their worst there.
    near = (t_s >= offset_s - 1.0) & (t_s <= offset_s + duration_s + 1.0)
    elapsed_s = t_s[near] - offset_s
    return SplineMotion(_fit(elapsed_s, position[near]), _fit(elapsed_s, quaternion[near]), C_s_c @ C_c_b)


def _read(file: Path) -> tuple[FloatArray, FloatArray, Rotation, FloatArray]:
    """Times [s] from zero, positions, attitudes, camera in the sensor; of either kind of file."""
    expected = "expected EuRoC's state CSV or UZH-FPV's ground-truth text"
    try:
        comma = "," in file.read_text(encoding="utf-8").split("\n", 1)[0]
        if comma:
            stamps = np.loadtxt(file, delimiter=",", usecols=0, dtype=np.int64)
            t_s = (stamps - stamps[0]) / NS_PER_S
        else:
            t_s = np.loadtxt(file, usecols=0)
            t_s = t_s - t_s[0]
        table = np.loadtxt(file, delimiter="," if comma else None, usecols=range(1, 8))
    except (OSError, ValueError, IndexError) as error:
        raise SimulationError(f"motion file {file} cannot be read ({error}); {expected}") from error
    if t_s.ndim == 0 or t_s.size < 50 or np.any(np.diff(t_s) <= 0.0) or not np.isfinite(table).all():
        raise SimulationError(f"motion file {file} has no ascending, finite poses; {expected}")
    if np.diff(t_s).max() > _KNOT_S / 2.0:
        raise SimulationError(
            f"motion file {file} has a gap of {np.diff(t_s).max():.3f} s; expected poses at least every "
            f"{_KNOT_S / 2.0} s: choose another part or file"
        )
    quaternion = table[:, [4, 5, 6, 3]] if comma else table[:, 3:7]
    return t_s, table[:, :3], Rotation.from_quat(quaternion), _EUROC_C_s_c if comma else _UZH_C_s_c


def _fit(t_s: FloatArray, values: FloatArray) -> BSpline:
    inner = np.linspace(t_s[0], t_s[-1], max(2, round((t_s[-1] - t_s[0]) / _KNOT_S) + 1))
    knots = np.concatenate([[inner[0]] * _DEGREE, inner, [inner[-1]] * _DEGREE])
    return make_lsq_spline(t_s, values, knots, k=_DEGREE)


def _left_quotient(p: FloatArray, q: FloatArray) -> FloatArray:
    """Quaternion products p^-1 q (N,4), xyzw, for p of any length."""
    pv, pw, qv, qw = p[:, :3], p[:, 3:], q[:, :3], q[:, 3:]
    vector = pw * qv - qw * pv - np.cross(pv, qv)
    scalar = pw * qw + np.sum(pv * qv, axis=1, keepdims=True)
    return np.hstack([vector, scalar]) / np.sum(p * p, axis=1, keepdims=True)


def _times(t_s: ArrayLike) -> FloatArray:
    return np.atleast_1d(np.asarray(t_s, dtype=np.float64))
