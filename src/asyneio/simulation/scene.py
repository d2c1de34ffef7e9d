# SPDX-License-Identifier: Apache-2.0
"""Landmarks of scenes, in the world frame (z up), with the centre of the motion at the origin."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

import numpy as np

from asyneio.errors import SimulationError
from asyneio.types import FloatArray

_ROOM_LOW = np.array([-3.0, -3.2, -1.4])
_ROOM_HIGH = np.array([3.4, 3.0, 1.7])
_RELIEF_M = 0.3


class SceneKind(StrEnum):
    """Scenes by name."""

    ROOM = "room"
    PLANE = "plane"
    NEAR_FAR = "near_far"


def draw_landmarks(kind: str, count: int, rng: np.random.Generator) -> FloatArray:
    """Positions (count,3) [m] of landmarks in the world.

    `room`: walls, floor and ceiling of about 6 x 6 x 3 m, with 0.3 m of relief. `plane`: one wall 2.5 m ahead
    (world x). `near_far`: half of the landmarks 1.3-2 m away, half 6-20 m, all around.

    Raises:
        SimulationError: the scene is unknown or `count` is not positive.
    """
    if count <= 0:
        raise SimulationError(f"{count} landmarks; expected a positive number")
    if kind not in list(SceneKind):
        raise SimulationError(f"scene {kind!r} is unknown; expected one of {', '.join(SceneKind)}")
    return _BUILDERS[SceneKind(kind)](count, rng)


def _room(count: int, rng: np.random.Generator) -> FloatArray:
    size = _ROOM_HIGH - _ROOM_LOW
    # Each face of the box is normal to an axis; the number of its landmarks is proportional to its area.
    area = np.prod(size) / size
    axis = rng.choice(3, size=count, p=area / area.sum())
    upper = rng.integers(0, 2, size=count)
    points = rng.uniform(_ROOM_LOW, _ROOM_HIGH, (count, 3))
    relief = rng.uniform(0.0, _RELIEF_M, count)
    inward = np.where(upper == 1, _ROOM_HIGH[axis] - relief, _ROOM_LOW[axis] + relief)
    points[np.arange(count), axis] = inward
    return points


def _plane(count: int, rng: np.random.Generator) -> FloatArray:
    return rng.uniform([2.5, -5.0, -3.0], [2.5, 5.0, 3.0], (count, 3))


def _near_far(count: int, rng: np.random.Generator) -> FloatArray:
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    near = rng.random(count) < 0.5
    distance = np.where(near, rng.uniform(1.3, 2.0, count), rng.uniform(6.0, 20.0, count))
    return direction * distance[:, None]


_BUILDERS: dict[SceneKind, Callable[[int, np.random.Generator], FloatArray]] = {
    SceneKind.ROOM: _room,
    SceneKind.PLANE: _plane,
    SceneKind.NEAR_FAR: _near_far,
}
