"""A rigid object with a motion of its own: a person-like body that walks about ahead of the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.simulation.motion import COORDINATES, AnalyticMotion, Motion, Sinusoids
from asyneio.types import FloatArray

#: Width, depth and height [m] of a person with arms.
PERSON_M = (0.5, 0.3, 1.6)
#: Where it walks about: ahead (world x), so near that its upper body holds a third of the view.
_SPOT_M = (1.7, 0.0, -0.2)
#: Terms (amplitude [m or rad], frequency [Hz]) of each coordinate: walks to and fro at up to 1 m/s, as people
#: do, bobs with its steps and turns to where it goes.
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
    """A rigid object: `motion` gives its pose `T_w_o`, `points_o` (P,3) [m] lie on it in its own frame
    (x forward, y left, z up)."""

    motion: Motion
    points_o: FloatArray

    def positions_w(self, t_s: FloatArray, point: FloatArray) -> FloatArray:
        """Where points (N,3) of the object's frame are in the world at times (N,) [s]: (N,3) [m]."""
        T_w_o = self.motion.T_w_b(t_s)
        return np.einsum("nij,nj->ni", T_w_o[:, :3, :3], point) + T_w_o[:, :3, 3]


def draw_walk(rng: np.random.Generator, scale: float = 1.0) -> AnalyticMotion:
    """The exact motion of somebody who walks about ahead of the origin, with phases and frequencies drawn.

    Args:
        rng: source of randomness; the same state gives the same walk.
        scale: factor on place and amplitudes, for scenes of another size.
    """
    table = np.array(_WALK).transpose(2, 0, 1)
    amplitude, frequency_hz = table[0].copy(), table[1]
    amplitude[:3] *= scale
    scatter = rng.uniform(1.0 - _FREQUENCY_SCATTER, 1.0 + _FREQUENCY_SCATTER, frequency_hz.shape)
    phase = rng.uniform(0.0, 2.0 * np.pi, amplitude.shape)
    offset = np.zeros(len(COORDINATES))
    offset[:3] = scale * np.array(_SPOT_M)
    return AnalyticMotion(Sinusoids(amplitude, frequency_hz * scatter, phase, offset))


def draw_person(count: int, rng: np.random.Generator) -> MovingObject:
    """A walking box of a person's size with `count` points on its surface."""
    motion = draw_walk(rng)
    size = np.array(PERSON_M)
    # A face of the box is normal to an axis; faces receive points in proportion to their area.
    area = np.prod(size) / size
    axis = rng.choice(3, size=count, p=area / area.sum())
    points = rng.uniform(-0.5 * size, 0.5 * size, (count, 3))
    points[np.arange(count), axis] = rng.choice([-0.5, 0.5], count) * size[axis]
    return MovingObject(motion, points)
