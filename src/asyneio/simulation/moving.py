# SPDX-License-Identifier: Apache-2.0
"""A moving rigid object: a box of a person's size that walks in front of the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.simulation.motion import COORDINATES, AnalyticMotion, Motion, Sinusoids
from asyneio.types import FloatArray

#: Depth, width and height of a person with arms [m].
PERSON_M = (0.3, 0.55, 1.75)
#: Default mean position: in front of the camera (world x), with the head slightly above it.
_SPOT_M = (1.7, 0.0, -0.5)
#: Terms (amplitude [m or rad], frequency [Hz]) of each coordinate: walking back and forth at up to 1 m/s,
#: with the vertical motion of steps, and turning towards the direction of walking.
_WALK = (
    ((0.15, 0.17), (0.02, 0.9)),
    ((0.50, 0.22), (0.10, 0.50)),
    ((0.03, 0.9), (0.01, 1.8)),
    ((0.04, 0.8), (0.0, 0.0)),
    ((0.05, 0.6), (0.0, 0.0)),
    ((0.60, 0.22), (0.15, 0.55)),
)
_FREQUENCY_SCATTER = 0.1


@dataclass(frozen=True)
class MovingObject:
    """A rigid object with the pose `T_w_o` of `motion`, and points `points_o` (P,3) [m] on it in its own
    frame (x forward, y left, z up)."""

    motion: Motion
    points_o: FloatArray

    def positions_w(self, t_s: FloatArray, point: FloatArray) -> FloatArray:
        """World positions (N,3) [m] of points (N,3) in the object's frame at times (N,) [s]."""
        T_w_o = self.motion.T_w_b(t_s)
        return np.einsum("nij,nj->ni", T_w_o[:, :3, :3], point) + T_w_o[:, :3, 3]


def draw_walk(
    rng: np.random.Generator, spot_m: tuple[float, float, float] = _SPOT_M, still: bool = False
) -> AnalyticMotion:
    """Motion of a person who walks in front of the origin, with random phases and frequencies.

    Args:
        rng: random generator; the same state gives the same motion.
        spot_m: mean position in the world [m].
        still: stand at that position instead.
    """
    table = np.array(_WALK).transpose(2, 0, 1)
    amplitude, frequency_hz = (0.0 if still else 1.0) * table[0], table[1]
    scatter = rng.uniform(1.0 - _FREQUENCY_SCATTER, 1.0 + _FREQUENCY_SCATTER, frequency_hz.shape)
    phase = rng.uniform(0.0, 2.0 * np.pi, amplitude.shape)
    offset = np.zeros(len(COORDINATES))
    offset[:3] = spot_m
    return AnalyticMotion(Sinusoids(amplitude, frequency_hz * scatter, phase, offset))


def draw_person(count: int, rng: np.random.Generator) -> MovingObject:
    """A walking box of a person's size with `count` points on its surface."""
    motion = draw_walk(rng)
    size = np.array(PERSON_M)
    # Each face of the box is normal to an axis; the number of its points is proportional to its area.
    area = np.prod(size) / size
    axis = rng.choice(3, size=count, p=area / area.sum())
    points = rng.uniform(-0.5 * size, 0.5 * size, (count, 3))
    points[np.arange(count), axis] = rng.choice([-0.5, 0.5], count) * size[axis]
    return MovingObject(motion, points)
