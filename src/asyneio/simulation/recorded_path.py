"""A recorded motion to simulate along, with the real samples of the IMU that made it."""

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
class RecordedRun:
    """A part of a recorded motion, and the samples of its IMU as they are (INERTIAL_DTYPE, within the part).

    `motion` begins at `start_ns` (IMU clock), in a world with z up and its origin in the middle of the way.
    Biases are what the fit found.
    """

    start_ns: int
    duration_s: float
    motion: SplineMotion
    gyroscope: RecordArray
    accelerometer: RecordArray
    bias_gyroscope: BiasWalk
    bias_accelerometer: BiasWalk


def recorded_run(
    fit: PathFit,
    gyroscope: RecordArray,
    accelerometer: RecordArray,
    forward_b: FloatArray,
    span_s: tuple[float, float | None] = (0.0, None),
) -> RecordedRun:
    """A part of a fitted path with its samples.

    Gravity points down exactly; the world is turned about the vertical so that `forward_b` points along x on
    average.

    Args:
        fit: of poses and samples.
        gyroscope: the samples that were fitted.
        accelerometer: likewise.
        forward_b: (3,) where the camera looks, in the body.
        span_s: begin after the start of the fit and length [s]; None for all that follows.

    Raises:
        SimulationError: the fit is shorter.
    """
    begin_s, length_s = span_s
    length_s = fit.duration_s - begin_s if length_s is None else length_s
    if not (begin_s >= 0.0 and 0.0 < length_s <= fit.duration_s - begin_s + 1e-9):
        raise SimulationError(
            f"poses and IMU have {fit.duration_s:.1f} s in common; {length_s:g} s from {begin_s:g} s on were "
            "asked for: use a smaller offset or a shorter run"
        )
    start_ns = fit.start_ns + round(begin_s * NS_PER_S)
    end_ns = start_ns + round(length_s * NS_PER_S)
    streams = [
        stream[(stream["t_ns"] >= start_ns) & (stream["t_ns"] <= end_ns)]
        for stream in (gyroscope, accelerometer)
    ]
    nodes_ns = np.rint((fit.bias_s - begin_s) * NS_PER_S).astype(np.int64)
    biases = [BiasWalk(nodes_ns, value) for value in (fit.bias_gyroscope, fit.bias_accelerometer)]
    motion = _upright(fit, forward_b, begin_s, length_s)
    return RecordedRun(start_ns, length_s, motion, streams[0], streams[1], biases[0], biases[1])


def _upright(fit: PathFit, forward_b: FloatArray, begin_s: float, length_s: float) -> SplineMotion:
    """The path in a world with z against gravity, x ahead, and the origin in the middle of the way."""
    level, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [fit.gravity])
    t_s = begin_s + np.linspace(0.0, length_s, 1 + int(np.ceil(50.0 * length_s)))
    ahead = (level * Rotation.from_quat(fit.quaternion(t_s))).apply(forward_b).mean(axis=0)
    turn = Rotation.from_euler("z", -np.arctan2(ahead[1], ahead[0])) * level
    way = turn.apply(fit.position(t_s))
    middle = 0.5 * (way.min(axis=0) + way.max(axis=0))
    x, y, z, w = turn.as_quat()
    # Columns of p -> turn p: a product of quaternions is linear in its second factor.
    product = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    position = BSpline(fit.position.t, turn.apply(fit.position.c) - middle, fit.position.k)
    quaternion = BSpline(fit.quaternion.t, fit.quaternion.c @ product.T, fit.quaternion.k)
    return SplineMotion(position, quaternion, begin_s)
