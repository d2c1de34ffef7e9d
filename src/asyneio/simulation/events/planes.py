# SPDX-License-Identifier: Apache-2.0
"""Rectangles seen by a camera: for each pose, a rectangle becomes three linear forms of a viewing ray.

Camera poses are given in the frame of each body, so moving bodies need no special treatment.

With the ray `d = (x, y, 1)` in the camera, `1/z = M . d`, `s = A . d / M . d`, `t = B . d / M . d`, where `z`
is the depth and `s`, `t` the coordinates on the rectangle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.jit import njit
from asyneio.simulation.events.world import World
from asyneio.types import FloatArray, IntArray

#: Rectangles are clipped at this distance to the camera [m].
NEAR_M = 0.05


class Rectangles(NamedTuple):
    """The rectangles of a world, as kernels take them; fields as in `World`."""

    corner: FloatArray
    edge_u: FloatArray
    edge_v: FloatArray
    body: IntArray


class Planes(NamedTuple):
    """R rectangles as seen from P camera poses.

    Attributes:
        forms: (P,R,9) linear forms [M, A, B] of `linear_forms`.
        lines: (P,R,5,3) border lines of `border_lines`.
    """

    forms: FloatArray
    lines: FloatArray


def rectangles_of(world: World) -> Rectangles:
    """The rectangles of a world."""
    return Rectangles(world.corner, world.edge_u, world.edge_v, world.body)


@njit(cache=True)
def linear_forms(rectangles: Rectangles, T_o_c: FloatArray, pose: int, forms: FloatArray) -> None:
    """Fill `forms` (R,9) = [M, A, B] of all rectangles for one camera pose.

    Args:
        rectangles: R rectangles.
        T_o_c: (P,B,4,4) camera poses in the frame of each body.
        pose: index of the pose.
        forms: output; zero for a rectangle seen edge-on.
    """
    corner = rectangles.corner
    for r in range(corner.shape[0]):
        u, v, o = rectangles.edge_u[r], rectangles.edge_v[r], rectangles.body[r]
        n = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
        offset, start_s, start_t, uu, vv = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            from_corner = T_o_c[pose, o, i, 3] - corner[r, i]
            offset -= n[i] * from_corner
            start_s += u[i] * from_corner
            start_t += v[i] * from_corner
            uu += u[i] * u[i]
            vv += v[i] * v[i]
        if abs(offset) < 1e-12:
            forms[r] = 0.0
            continue
        for j in range(3):
            m, a, b = 0.0, 0.0, 0.0
            for i in range(3):
                m += n[i] * T_o_c[pose, o, i, j]
                a += u[i] * T_o_c[pose, o, i, j]
                b += v[i] * T_o_c[pose, o, i, j]
            m /= offset
            forms[r, j] = m
            forms[r, 3 + j] = (start_s * m + a) / uu
            forms[r, 6 + j] = (start_t * m + b) / vv


@njit(cache=True)
def border_lines(forms: FloatArray, lines: FloatArray) -> None:
    """Fill `lines` (R,5,3): `line . d` is positive for all rays `d` that meet the rectangle.

    Line 0 is `1/z`, positive in front of the camera. Lines 1 to 4 are the borders, scaled so that the value
    is the distance from the border at unit depth.
    """
    for r in range(forms.shape[0]):
        for j in range(3):
            m = forms[r, j]
            lines[r, 0, j] = m
            lines[r, 1, j], lines[r, 2, j] = forms[r, 3 + j], m - forms[r, 3 + j]
            lines[r, 3, j], lines[r, 4, j] = forms[r, 6 + j], m - forms[r, 6 + j]
        for k in range(1, 5):
            # A border at infinity has no direction in the image; only its sign is used.
            lines[r, k] /= max(np.hypot(lines[r, k, 0], lines[r, k, 1]), 1e-12)


@njit(cache=True)
def planes_of(rectangles: Rectangles, T_o_c: FloatArray) -> Planes:
    """Forms and lines of rectangles for camera poses (P,B,4,4) in the frame of each body."""
    count = rectangles.corner.shape[0]
    forms = np.empty((T_o_c.shape[0], count, 9))
    lines = np.empty((T_o_c.shape[0], count, 5, 3))
    for pose in range(T_o_c.shape[0]):
        linear_forms(rectangles, T_o_c, pose, forms[pose])
        border_lines(forms[pose], lines[pose])
    return Planes(forms, lines)


@njit(cache=True)
def nearest(forms: FloatArray, x: float, y: float) -> tuple[int, float]:
    """Index of the nearest rectangle that a ray meets (-1 for none), and its inverse depth [1/m]."""
    best, found = 0.0, -1
    for r in range(forms.shape[0]):
        inverse = forms[r, 0] * x + forms[r, 1] * y + forms[r, 2]
        if inverse <= best or inverse > 1.0 / NEAR_M:
            continue
        s = (forms[r, 3] * x + forms[r, 4] * y + forms[r, 5]) / inverse
        t = (forms[r, 6] * x + forms[r, 7] * y + forms[r, 8]) / inverse
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            best, found = inverse, r
    return found, best
