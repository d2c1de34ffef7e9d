# SPDX-License-Identifier: Apache-2.0
"""Random motions with known derivatives, for studies without an estimator."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.simulation import AnalyticMotion, Sinusoids
from asyneio.types import FloatArray

#: Number of sinusoids of each coordinate.
_TERMS = 3
#: Circle of `ORBIT`: radius [m] and revolutions per second at speed 1.
_RADIUS_M, _ORBIT_HZ = 1.0, 0.5


class MotionKind(StrEnum):
    """Kinds of motion: mainly rotation, mainly translation, both at random, or both along a circle."""

    ROTATION = "rotation"
    TRANSLATION = "translation"
    BOTH = "both"
    ORBIT = "orbit"


#: Amplitudes of the angular rate [rad/s] and velocity [m/s] of each sinusoid, and lowest and highest
#: frequency [Hz], at speed 1.
_LEVELS = {
    MotionKind.ROTATION: (1.5, 0.1, 0.5, 2.0),
    MotionKind.TRANSLATION: (0.15, 0.8, 0.5, 2.0),
    MotionKind.BOTH: (1.5, 0.3, 1.0, 4.0),
    MotionKind.ORBIT: (0.1, 0.05, 0.1, 0.5),
}

#: All parameters of a motion except its kind, speed and seed.
MOTION_SETTINGS = {
    "levels": {kind.value: list(levels) for kind, levels in _LEVELS.items()},
    "terms": _TERMS,
    "orbit": [_RADIUS_M, _ORBIT_HZ],
}


def draw_known_motion(kind: str, speed: float, rng: np.random.Generator) -> AnalyticMotion:
    """A random motion of a kind; `speed` is a factor on all frequencies and does not change the path.

    `orbit` is a circle with the heading along it, as of a vehicle: apart from slow random additions, its
    velocity in the body frame is constant.
    """
    rate, velocity, lowest, highest = _LEVELS[MotionKind(kind)]
    frequency_hz = rng.uniform(lowest, highest, (6, _TERMS))
    amplitude = np.repeat([velocity, rate], 3)[:, None] / (2.0 * np.pi * frequency_hz)
    phase = rng.uniform(0.0, 2.0 * np.pi, (6, _TERMS))
    offset, drift = np.zeros(6), np.zeros(6)
    if kind == MotionKind.ORBIT:
        start = rng.uniform(0.0, 2.0 * np.pi)
        circle = np.zeros((6, 1))
        circle[:2] = 1.0
        amplitude = np.hstack([amplitude, _RADIUS_M * circle])
        frequency_hz = np.hstack([frequency_hz, np.full((6, 1), _ORBIT_HZ)])
        phase = np.hstack([phase, np.array([[start + 0.5 * np.pi], [start], *[[0.0]] * 4])])
        offset[5], drift[5] = start + 0.5 * np.pi, 2.0 * np.pi * _ORBIT_HZ * speed
    # A random mounting, so that no body axis is special.
    mounting = Rotation.random(random_state=rng).as_matrix()
    return AnalyticMotion(Sinusoids(amplitude, speed * frequency_hz, phase, offset, drift), mounting)


def generalized_rates(motion: AnalyticMotion, t_s: FloatArray) -> FloatArray:
    """True [varpi, varpi_dot] (N,2,6) in the body at times (N,) [s]: `nu_dot = C^T a - omega x nu` (5)."""
    C_b_w = np.swapaxes(motion.T_w_b(t_s)[:, :3, :3], 1, 2)
    omega = motion.angular_velocity_b(t_s)
    nu = np.einsum("nij,nj->ni", C_b_w, motion.velocity_w(t_s))
    nu_dot = np.einsum("nij,nj->ni", C_b_w, motion.acceleration_w(t_s)) - np.cross(omega, nu)
    velocity = np.hstack([omega, nu])
    acceleration = np.hstack([motion.angular_acceleration_b(t_s), nu_dot])
    return np.stack([velocity, acceleration], axis=1)


def angles_between(C_one: FloatArray, C_other: FloatArray) -> FloatArray:
    """Angles (N,) [rad] of the rotations between two series of attitudes (N,3,3)."""
    return np.asarray(Rotation.from_matrix(np.swapaxes(C_one, 1, 2) @ C_other).magnitude())


def rms(errors: FloatArray) -> float:
    """Root mean square of errors (N,), or of the norms of errors (N,3)."""
    squares = errors**2 if errors.ndim == 1 else (errors**2).sum(axis=1)
    return float(np.sqrt(squares.mean()))
