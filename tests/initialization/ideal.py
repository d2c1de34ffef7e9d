"""Motions, tracks and the integrals of an ideal IMU, without kernels of the package."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asyneio.initialization.alignment import AlignmentData
from asyneio.simulation import AnalyticMotion, Sinusoids, draw_motion

Array = NDArray[np.float64]

GRAVITY = 9.81
GRAVITY_W = np.array([0.0, 0.0, -GRAVITY])
C_F_B = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
#: The camera looks along the body's z axis from a few centimetres off.
T_B_C = np.eye(4)
T_B_C[:3, 3] = [0.01, -0.02, 0.03]


@dataclass(frozen=True)
class Aligned:
    """Input of the alignment, and the true velocity and gravity in the first body frame."""

    data: AlignmentData
    velocity: Array
    gravity: Array


def styled(style: str, seed: int) -> AnalyticMotion:
    return draw_motion(style, np.random.default_rng(seed), C_F_B)


def sinusoidal(position_m: float, angle_rad: float, drift_mps: float = 0.0) -> AnalyticMotion:
    """Half a hertz in every coordinate, with a drift along the world's x and y."""
    amplitude = np.repeat([position_m, angle_rad], 3)[:, None]
    phase = np.arange(6.0)[:, None]
    drift = drift_mps * np.array([0.8, 0.6, 0.0, 0.0, 0.0, 0.0])
    return AnalyticMotion(Sinusoids(amplitude, np.full((6, 1), 0.5), phase, drift=drift), C_F_B)


def ideal(
    motion: AnalyticMotion,
    seed: int,
    sigma_rad: float = 0.0,
    T_b_c: Array = T_B_C,
    start_s: float = 0.5,
    span_s: float = 1.5,
    tracks: int = 40,
) -> Aligned:
    """Tracks of 12 observations, each over a third to two thirds of the span, with noise on every ray."""
    rng = np.random.default_rng(seed)
    first = motion.T_w_b(start_s)[0]
    C_0, r_0 = first[:3, :3], first[:3, 3]
    velocity, gravity = C_0.T @ motion.velocity_w(start_s)[0], C_0.T @ GRAVITY_W
    t = np.concatenate([_track_times(rng, span_s) for _ in range(tracks)])
    T_w_c = motion.T_w_b(start_s + t) @ T_b_c
    track = np.repeat(np.arange(tracks), 12)
    # Each landmark is in front of its camera in the middle of its track.
    middle = 12 * track + 6
    ahead = np.column_stack([rng.uniform(-0.5, 0.5, (tracks, 2)), np.ones(tracks)])
    ahead *= rng.uniform(1.5, 6.0, (tracks, 1))
    point = np.einsum("nij,nj->ni", T_w_c[middle, :3, :3], ahead[track]) + T_w_c[middle, :3, 3]
    ray = point - T_w_c[:, :3, 3]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    ray += sigma_rad * rng.normal(size=ray.shape)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    camera = (T_w_c[:, :3, 3] - r_0) @ C_0
    free_fall = velocity * t[:, None] + 0.5 * gravity * t[:, None] ** 2
    return Aligned(AlignmentData(t, ray @ C_0, camera - free_fall, track, tracks), velocity, gravity)


def _track_times(rng: np.random.Generator, span_s: float) -> Array:
    begin = rng.uniform(0.0, 0.35 * span_s)
    return np.sort(rng.uniform(begin, begin + rng.uniform(0.35, 0.65) * span_s, 12))
