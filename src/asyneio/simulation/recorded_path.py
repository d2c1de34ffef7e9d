# SPDX-License-Identifier: Apache-2.0
"""A recorded motion for a simulation, with the real IMU samples recorded on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from asyneio.errors import SimulationError
from asyneio.simulation.imu import BiasWalk
from asyneio.simulation.path_fit import PathFit
from asyneio.simulation.spline_motion import SplineMotion
from asyneio.types import NS_PER_S, FloatArray, RecordArray


@dataclass(frozen=True)
class RealSamples:
    """IMU samples as recorded (INERTIAL_DTYPE), and their biases estimated by the fit."""

    gyroscope: RecordArray
    accelerometer: RecordArray
    bias_gyroscope: BiasWalk
    bias_accelerometer: BiasWalk


@dataclass(frozen=True)
class RecordedRun:
    """A part of a recorded motion, and its IMU samples (None: the IMU is simulated).

    `motion` begins at `start_ns` (IMU clock), in a world with z up and its origin at the centre of the path.
    """

    start_ns: int
    duration_s: float
    motion: SplineMotion
    samples: RealSamples | None = None


def recorded_run(
    fit: PathFit,
    gyroscope: RecordArray | None,
    accelerometer: RecordArray | None,
    forward_b: FloatArray,
    span_s: tuple[float, float | None] = (0.0, None),
) -> RecordedRun:
    """A part of a fitted path with its samples.

    The world is rotated so that gravity points down exactly, and `forward_b` points along x on average.

    Args:
        fit: fit of poses and samples.
        gyroscope: the fitted samples, if any.
        accelerometer: the fitted samples, if any.
        forward_b: (3,) viewing direction of the camera in the body frame.
        span_s: beginning since the start of the fit and length [s]; None for the rest of the fit.

    Raises:
        SimulationError: the fit is shorter.
    """
    begin_s, length_s = span_s
    length_s = fit.duration_s - begin_s if length_s is None else length_s
    if not (begin_s >= 0.0 and 0.0 < length_s <= fit.duration_s - begin_s + 1e-9):
        raise SimulationError(
            f"poses (and IMU) span {fit.duration_s:.1f} s, but {length_s:g} s from {begin_s:g} s on are "
            "required: use a smaller offset or a shorter run"
        )
    start_ns = fit.start_ns + round(begin_s * NS_PER_S)
    motion = _upright(fit, forward_b, begin_s, length_s)
    if gyroscope is None or accelerometer is None:
        return RecordedRun(start_ns, length_s, motion)
    end_ns = start_ns + round(length_s * NS_PER_S)
    inside = [(s["t_ns"] >= start_ns) & (s["t_ns"] <= end_ns) for s in (gyroscope, accelerometer)]
    nodes_ns = np.rint((fit.bias_s - begin_s) * NS_PER_S).astype(np.int64)
    samples = RealSamples(
        gyroscope[inside[0]],
        accelerometer[inside[1]],
        BiasWalk(nodes_ns, fit.bias_gyroscope),
        BiasWalk(nodes_ns, fit.bias_accelerometer),
    )
    return RecordedRun(start_ns, length_s, motion, samples)


def _upright(fit: PathFit, forward_b: FloatArray, begin_s: float, length_s: float) -> SplineMotion:
    """The path in a world with z against gravity, x forward, and the origin at the centre of the path."""
    level, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [fit.gravity])
    t_s = begin_s + np.linspace(0.0, length_s, 1 + int(np.ceil(50.0 * length_s)))
    ahead = (level * Rotation.from_quat(fit.quaternion(t_s))).apply(forward_b).mean(axis=0)
    turn = Rotation.from_euler("z", -np.arctan2(ahead[1], ahead[0])) * level
    way = turn.apply(fit.position(t_s))
    middle = 0.5 * (way.min(axis=0) + way.max(axis=0))
    x, y, z, w = turn.as_quat()
    # Matrix of the map p -> turn p: a quaternion product is linear in its second factor.
    product = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    position = BSpline(fit.position.t, turn.apply(fit.position.c) - middle, fit.position.k)
    quaternion = BSpline(fit.quaternion.t, fit.quaternion.c @ product.T, fit.quaternion.k)
    return SplineMotion(position, quaternion, begin_s)
