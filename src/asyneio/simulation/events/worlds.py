# SPDX-License-Identifier: Apache-2.0
"""Worlds of textured rectangles, in the world frame (z up) around the centre of the motion at the origin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.events.pyramid import build_pyramids
from asyneio.simulation.events.textures import load_photographs, photograph_texture, procedural_texture
from asyneio.simulation.events.world import World
from asyneio.simulation.motion import Motion
from asyneio.simulation.moving import PERSON_M
from asyneio.types import FloatArray

_LARGEST_SIDE = 2048
#: Texel pitch of a person's clothes [m].
_CLOTHES_PITCH_M = 0.004
#: Minimum distance of the room around a path to the path [m].
_SLACK_M = 0.05


class WorldKind(StrEnum):
    """Worlds by name."""

    ROOM = "room"
    BOXES = "boxes"
    POSTER = "poster"
    NEAR = "near"
    FAR = "far"
    HALL = "hall"
    AROUND = "around"
    FINE = "fine"


@dataclass(frozen=True)
class _Plan:
    """Rectangles, each (3,3) of corner, edge_u and edge_v [m], their texel pitch [m], and the free space
    [m]."""

    rectangles: list[FloatArray]
    pitch_m: float
    free_low: tuple[float, float, float]
    free_high: tuple[float, float, float]


@dataclass(frozen=True)
class Walker:
    """A person who moves through a world: the motion, and the random generator for the clothes."""

    motion: Motion
    rng: np.random.Generator


def build_world(
    kind: str,
    photographs: bool,
    sunlit: float,
    rng: np.random.Generator,
    walker: Walker | None = None,
    path: FloatArray | None = None,
) -> World:
    """Build a world by name.

    Args:
        kind: a value of `WorldKind`.
        photographs: textures from photographs instead of procedural ones.
        sunlit: ratio of the brightness of sunlit patches to shade; 1 for uniform light.
        rng: source of randomness; the same state gives the same world.
        walker: a box of a person's size, or None; it does not change the rest of the world.
        path: positions (N,3) of the camera that the room `around` keeps free; the other worlds ignore it.

    Raises:
        SimulationError: the world is unknown, or photographs are missing.
    """
    if kind not in list(WorldKind):
        raise SimulationError(f"world {kind!r} is unknown; expected one of {', '.join(WorldKind)}")
    if kind == WorldKind.AROUND:
        plan = _around(rng, np.zeros((1, 3)) if path is None else path)
    else:
        plan = _BUILDERS[WorldKind(kind)](rng)
    pictures = load_photographs() if photographs else []
    textures = []
    for rectangle in plan.rectangles:
        texture = _texture(rectangle, plan.pitch_m, pictures, rng)
        textures.append(texture * _sun(texture, sunlit, rng) if sunlit != 1.0 else texture)
    body = np.zeros(len(textures), dtype=np.int64)
    rectangles = plan.rectangles
    if walker is not None:
        size = np.array(PERSON_M)
        faces = _shell(-0.5 * size, 0.5 * size)
        textures += [_texture(face, _CLOTHES_PITCH_M, pictures, walker.rng) for face in faces]
        body = np.concatenate([body, np.ones(len(faces), dtype=np.int64)])
        rectangles = rectangles + faces
    corner, edge_u, edge_v = np.array(rectangles).transpose(1, 0, 2).copy()
    return World(
        corner,
        edge_u,
        edge_v,
        build_pyramids(textures),
        np.array(plan.free_low),
        np.array(plan.free_high),
        () if walker is None else (walker.motion,),
        body,
    )


def _texture(
    rectangle: FloatArray, pitch_m: float, pictures: list[FloatArray], rng: np.random.Generator
) -> FloatArray:
    """Texture of a rectangle (3,3) with texels of about the given pitch [m]."""
    side_u, side_v = (float(np.linalg.norm(edge)) for edge in rectangle[1:])
    height, width = _texels(side_v, pitch_m), _texels(side_u, pitch_m)
    if pictures:
        return photograph_texture(pictures, height, width, rng)
    return procedural_texture(height, width, (side_v / height) / (side_u / width), rng)


def _texels(length_m: float, pitch_m: float) -> int:
    return int(np.clip(2 ** round(float(np.log2(length_m / pitch_m))), 32, _LARGEST_SIDE))


def _sun(texture: FloatArray, sunlit: float, rng: np.random.Generator) -> FloatArray:
    """Light on a surface, with the shape of its texture: `sunlit` in a slanted band with sharp borders, else
    1."""
    height, width = texture.shape
    y, x = np.mgrid[:height, :width] / max(height, width)
    turn = rng.uniform(0.0, np.pi)
    along = np.cos(turn) * x + np.sin(turn) * y
    begin = rng.uniform(along.min(), along.max())
    inside = (along > begin) & (along < begin + rng.uniform(0.15, 0.4))
    return np.where(inside, sunlit, 1.0)


def _shell(low: FloatArray, high: FloatArray) -> list[FloatArray]:
    """The six faces of an upright box, each (3,3): corner and two edges."""
    size = high - low
    faces = []
    for axis in range(3):
        u, v = np.delete(np.eye(3) * size, axis, axis=0)
        for end in (0.0, size[axis]):
            faces.append(np.array([low + end * np.eye(3)[axis], u, v]))
    return faces


def _turned_box(centre: FloatArray, size: FloatArray, yaw: float) -> list[FloatArray]:
    """Faces of a box rotated about the vertical."""
    C = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    faces = _shell(-0.5 * size, 0.5 * size)
    return [face @ C.T + np.array([centre, np.zeros(3), np.zeros(3)]) for face in faces]


def _panel(centre: FloatArray, width: float, height: float, normal: FloatArray) -> FloatArray:
    """A rectangle centred at `centre`, with its normal along `normal` and a horizontal lower side."""
    u = np.cross([0.0, 0.0, 1.0], normal)
    u /= np.linalg.norm(u)
    v = np.cross(normal / np.linalg.norm(normal), u)
    return np.array([centre - 0.5 * width * u - 0.5 * height * v, width * u, height * v])


def _clutter(
    count: int,
    distance: tuple[float, float],
    size: tuple[float, float],
    spread: tuple[float, float],
    rng: np.random.Generator,
) -> list[FloatArray]:
    """Panels that approximately face the origin, at `distance` [m], with a width of `size` [m].

    They are evenly distributed around world x, within `spread` [rad] horizontally and vertically.
    """
    panels = []
    for index in range(count):
        # Steps of the golden ratio give evenly distributed directions; random ones would leave gaps.
        across = 2.0 * ((index + 0.5) * 0.6180339887 % 1.0) - 1.0
        up = 2.0 * (index + 0.5) / count - 1.0
        yaw = spread[0] * across + rng.uniform(-0.1, 0.1)
        pitch = spread[1] * up + rng.uniform(-0.1, 0.1)
        away = rng.uniform(*distance)
        ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        normal = -ahead + rng.uniform(-0.4, 0.4, 3)
        width, height = rng.uniform(*size, 2)
        panels.append(_panel(away * ahead, float(width), float(height), normal))
    return panels


def _furnished(
    low: FloatArray, high: FloatArray, pieces: int, size: tuple[float, float], rng: np.random.Generator
) -> list[FloatArray]:
    """A closed room with boxes along its walls, on the floor or at some height."""
    faces = _shell(low, high)
    middle = 0.5 * (low + high)
    for index in range(pieces):
        dimensions = rng.uniform(*size, 3)
        heading = 2.0 * np.pi * (index + rng.uniform(-0.25, 0.25)) / pieces
        # From the centre outwards to the wall, then back by half the size of a piece.
        reach = 0.5 * (high - low)[:2] - 0.5 * float(np.hypot(*dimensions[:2]))
        ahead = np.array([np.cos(heading), np.sin(heading)])
        spot = middle[:2] + ahead * np.min(reach / np.maximum(np.abs(ahead), 1e-9))
        base = low[2] if index % 2 else rng.uniform(low[2], high[2] - dimensions[2])
        centre = np.array([*spot, base + 0.5 * dimensions[2]])
        faces += _turned_box(centre, dimensions, heading + rng.uniform(-0.5, 0.5))
    return faces


def _room(rng: np.random.Generator) -> _Plan:
    low, high = np.array([-3.0, -3.2, -1.4]), np.array([3.4, 3.0, 1.7])
    faces = _furnished(low, high, 9, (0.5, 1.1), rng)
    return _Plan(faces, 0.008, (-1.1, -1.1, -0.7), (1.1, 1.1, 0.7))


def _hall(rng: np.random.Generator) -> _Plan:
    low, high = np.array([-18.0, -16.0, -3.5]), np.array([18.0, 16.0, 5.0])
    faces = _furnished(low, high, 16, (1.5, 3.5), rng)
    return _Plan(faces, 0.02, (-11.0, -10.0, -3.0), (11.0, 10.0, 4.0))


def _around(rng: np.random.Generator, path: FloatArray) -> _Plan:
    """A furnished room like `room`, with the size that a path needs."""
    low, high = path.min(axis=0) - _SLACK_M, path.max(axis=0) + _SLACK_M
    walls = np.array([2.0, 2.0, 0.8])
    pieces = max(9, round(float((high - low + 2.0 * walls)[:2].sum()) / 1.4))
    faces = _furnished(low - walls, high + walls, pieces, (0.5, 1.1), rng)
    return _Plan(faces, 0.008, tuple(low), tuple(high))


def _boxes(rng: np.random.Generator) -> _Plan:
    shell = _shell(np.array([-2.5, -3.5, -2.0]), np.array([3.6, 3.5, 2.2]))
    panels = _clutter(26, (1.7, 3.0), (0.35, 0.8), (1.5, 0.6), rng)
    return _Plan(shell + panels, 0.006, (-0.9, -0.9, -0.6), (0.9, 0.9, 0.6))


def _fine(rng: np.random.Generator) -> _Plan:
    """The boxes with textures as fine as the pixels of a sensor with 1280 columns: a milliradian."""
    return replace(_boxes(rng), pitch_m=0.0015)


def _poster(rng: np.random.Generator) -> _Plan:
    wall = _panel(np.array([2.0, 0.0, 0.0]), 16.0, 10.0, np.array([-1.0, 0.05, 0.03]))
    return _Plan([wall], 0.008, (-0.7, -0.9, -0.6), (0.7, 0.9, 0.6))


def _near(rng: np.random.Generator) -> _Plan:
    shell = _shell(np.array([-1.5, -2.2, -1.3]), np.array([1.25, 2.2, 1.3]))
    panels = _clutter(12, (0.85, 1.1), (0.25, 0.5), (1.1, 0.5), rng)
    return _Plan(shell + panels, 0.003, (-0.3, -0.3, -0.25), (0.3, 0.3, 0.25))


def _far(rng: np.random.Generator) -> _Plan:
    shell = _shell(np.array([-18.0, -18.0, -7.0]), np.array([20.0, 18.0, 9.0]))
    panels = _clutter(22, (6.5, 17.0), (1.5, 4.0), (1.5, 0.35), rng)
    return _Plan(shell + panels, 0.03, (-3.0, -3.0, -2.0), (3.0, 3.0, 2.0))


_BUILDERS: dict[WorldKind, Callable[[np.random.Generator], _Plan]] = {
    WorldKind.ROOM: _room,
    WorldKind.BOXES: _boxes,
    WorldKind.POSTER: _poster,
    WorldKind.NEAR: _near,
    WorldKind.FAR: _far,
    WorldKind.HALL: _hall,
    WorldKind.FINE: _fine,
}
