"""Rectangles seen by a camera: per pose, each becomes three linear forms of a viewing ray.

With the ray `d = (x, y, 1)` in the camera, `1/z = M . d`, `s = A . d / M . d`, `t = B . d / M . d`, where `z`
is the depth and `s`, `t` the coordinates on the rectangle.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.types import FloatArray

#: Rectangles are cut off this close to the camera [m].
NEAR_M = 0.05


@njit(cache=True)
def linear_forms(
    corner: FloatArray, edge_u: FloatArray, edge_v: FloatArray, T_w_c: FloatArray, forms: FloatArray
) -> None:
    """Fill `forms` (R,9) = [M, A, B] for rectangles (R,3) each and a camera pose (4,4); M = 0 edge-on."""
    for r in range(corner.shape[0]):
        u, v = edge_u[r], edge_v[r]
        n = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
        offset, start_s, start_t, uu, vv = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            from_corner = T_w_c[i, 3] - corner[r, i]
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
                m += n[i] * T_w_c[i, j]
                a += u[i] * T_w_c[i, j]
                b += v[i] * T_w_c[i, j]
            m /= offset
            forms[r, j] = m
            forms[r, 3 + j] = (start_s * m + a) / uu
            forms[r, 6 + j] = (start_t * m + b) / vv


@njit(cache=True)
def image_boxes(
    corner: FloatArray, edge_u: FloatArray, edge_v: FloatArray, T_w_c: FloatArray, boxes: FloatArray
) -> None:
    """Fill `boxes` (R,4) with x_low, y_low, x_high, y_high of what each rectangle covers at unit depth.

    Low above high: it is behind the camera.
    """
    points = np.empty((4, 3))
    for r in range(corner.shape[0]):
        for k in range(4):
            # Once around the rectangle.
            s, t = 1.0 if k == 1 or k == 2 else 0.0, 1.0 if k >= 2 else 0.0
            for j in range(3):
                points[k, j] = 0.0
                for i in range(3):
                    w = corner[r, i] + s * edge_u[r, i] + t * edge_v[r, i] - T_w_c[i, 3]
                    points[k, j] += T_w_c[i, j] * w
        boxes[r, 0] = boxes[r, 1] = np.inf
        boxes[r, 2] = boxes[r, 3] = -np.inf
        for k in range(4):
            p, q = points[k], points[(k + 1) % 4]
            for end in range(2):
                if end == 0:
                    x, y, z = p
                    if z < NEAR_M:
                        continue
                else:
                    if (p[2] < NEAR_M) == (q[2] < NEAR_M):
                        continue
                    f = (NEAR_M - p[2]) / (q[2] - p[2])
                    x, y, z = p[0] + f * (q[0] - p[0]), p[1] + f * (q[1] - p[1]), NEAR_M
                boxes[r, 0], boxes[r, 1] = min(boxes[r, 0], x / z), min(boxes[r, 1], y / z)
                boxes[r, 2], boxes[r, 3] = max(boxes[r, 2], x / z), max(boxes[r, 3], y / z)


@njit(cache=True)
def nearest(forms: FloatArray, x: float, y: float) -> tuple[int, float]:
    """Index of the first rectangle that a ray meets, and its inverse depth [1/m]; -1 for none."""
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
