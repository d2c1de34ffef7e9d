# SPDX-License-Identifier: Apache-2.0
"""Ground truth for feature tracks: the world point seen by a pixel, its projections, and its visibility."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from asyneio.jit import njit
from asyneio.simulation.camera import BoolArray, PinholeCamera
from asyneio.simulation.events.planes import Rectangles, linear_forms, nearest, rectangles_of
from asyneio.simulation.events.rays import lens_row, pixel_ray
from asyneio.simulation.events.world import World
from asyneio.simulation.motion import Motion
from asyneio.types import CameraIntrinsics, FloatArray, IntArray

#: A point is visible unless a surface in its direction is nearer by more than this fraction.
_TOLERANCE = 1e-3
#: Spacing of the rays tested by `single_surface` [px].
_PROBE_PX = 2.0


@dataclass(frozen=True)
class PointTruth:
    """Exact rays and points of a run, for times (N,) [ns] in the **camera clock** and distorted pixels (N,2).

    Times outside the run are valid too: the motion is defined for all times.
    """

    motion: Motion
    world: World
    camera: CameraIntrinsics
    T_b_c: FloatArray
    #: Camera-clock time of the start of the motion [ns].
    start_ns: int

    def T_w_c(self, t_ns: ArrayLike) -> FloatArray:
        """Camera poses (N,4,4) at times (N,)."""
        elapsed_ns = np.atleast_1d(np.asarray(t_ns, dtype=np.int64)) - self.start_ns
        return self.motion.T_w_b(elapsed_ns * 1e-9) @ self.T_b_c

    def hit(self, t_ns: ArrayLike, uv: ArrayLike) -> tuple[FloatArray, IntArray, BoolArray]:
        """World points seen by pixels: points (N,3) [m], index (N,) of their rectangle, valid (N,).

        Points are in the frame of the body that their rectangle belongs to, which is the world frame unless
        it moves. If the ray meets nothing or does not exist, the entry is invalid, with points nan and index
        -1.
        """
        points, surface = _hit(*self._arguments(t_ns, uv))
        return points, surface, surface >= 0

    def project(
        self, t_ns: ArrayLike, points: ArrayLike, surface: ArrayLike | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """Project points (N,3) [m]: distorted pixels (N,2), visible (N,).

        `surface` (N,) are the rectangles of the points, as returned by `hit`: points are in the frames of the
        bodies of these rectangles and move with them. Without it, points are in the world frame.

        Visible points are in front of the camera, inside the image, and not hidden by a rectangle. Pixels of
        points behind the camera are meaningless but finite.
        """
        p_o = np.atleast_2d(np.asarray(points, dtype=np.float64))
        T_o_c = self._seen_from(t_ns)
        # Points on no rectangle are static.
        own = np.full(len(T_o_c), -1) if surface is None else np.atleast_1d(np.asarray(surface))
        T_own_c = T_o_c[np.arange(len(T_o_c)), np.where(own < 0, 0, self.world.body[own])]
        points_c = np.einsum("nji,nj->ni", T_own_c[:, :3, :3], p_o - T_own_c[:, :3, 3])
        pixels, visible = PinholeCamera.from_intrinsics(self.camera).visible(points_c, 0.0)
        candidates = np.flatnonzero(visible)
        seen = _unhidden(rectangles_of(self.world), T_o_c[candidates], points_c[candidates])
        visible[candidates[~seen]] = False
        return pixels, visible

    def single_surface(self, t_ns: ArrayLike, uv: ArrayLike, radius_px: float = 8.0) -> BoolArray:
        """Whether the surroundings of pixels (N,2) within `radius_px` lie on a single rectangle (N,)."""
        steps = np.arange(-radius_px, radius_px + 1e-9, _PROBE_PX)
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        turn = np.arange(24) * (2.0 * np.pi / 24)
        rim = radius_px * np.column_stack([np.cos(turn), np.sin(turn)])
        # The rim first, because it decides most cases.
        probes = np.vstack([rim, grid[np.hypot(*grid.T) <= radius_px]])
        return _single_surface(*self._arguments(t_ns, uv), probes)

    def _seen_from(self, t_ns: ArrayLike) -> FloatArray:
        """Camera poses (N,B,4,4) in the frame of the world and of each moving body."""
        elapsed_ns = np.atleast_1d(np.asarray(t_ns, dtype=np.int64)) - self.start_ns
        return self.world.seen_from(np.asarray(elapsed_ns * 1e-9), self.T_w_c(t_ns))

    def _arguments(
        self, t_ns: ArrayLike, uv: ArrayLike
    ) -> tuple[Rectangles, FloatArray, FloatArray, FloatArray]:
        pixels = np.atleast_2d(np.asarray(uv, dtype=np.float64))
        return rectangles_of(self.world), lens_row(self.camera), self._seen_from(t_ns), pixels


@njit(cache=True)
def _hit(
    rectangles: Rectangles,
    lens: FloatArray,
    T_o_c: FloatArray,
    uv: FloatArray,
) -> tuple[FloatArray, IntArray]:
    points = np.full((uv.shape[0], 3), np.nan)
    surface = np.full(uv.shape[0], -1, dtype=np.int64)
    forms = np.empty((rectangles.corner.shape[0], 9))
    for n in range(uv.shape[0]):
        x, y, valid = pixel_ray(lens, uv[n, 0], uv[n, 1])
        if not valid:
            continue
        linear_forms(rectangles, T_o_c, n, forms)
        found, inverse = nearest(forms, x, y)
        if found < 0:
            continue
        surface[n] = found
        o = rectangles.body[found]
        for i in range(3):
            ray = T_o_c[n, o, i, 0] * x + T_o_c[n, o, i, 1] * y + T_o_c[n, o, i, 2]
            points[n, i] = T_o_c[n, o, i, 3] + ray / inverse
    return points, surface


@njit(cache=True)
def _unhidden(rectangles: Rectangles, T_o_c: FloatArray, points_c: FloatArray) -> NDArray[np.bool_]:
    seen = np.empty(points_c.shape[0], dtype=np.bool_)
    forms = np.empty((rectangles.corner.shape[0], 9))
    for n in range(points_c.shape[0]):
        linear_forms(rectangles, T_o_c, n, forms)
        depth = points_c[n, 2]
        _, inverse = nearest(forms, points_c[n, 0] / depth, points_c[n, 1] / depth)
        seen[n] = inverse * depth <= 1.0 + _TOLERANCE
    return seen


@njit(cache=True)
def _single_surface(
    rectangles: Rectangles,
    lens: FloatArray,
    T_o_c: FloatArray,
    uv: FloatArray,
    probes: FloatArray,
) -> NDArray[np.bool_]:
    single = np.zeros(uv.shape[0], dtype=np.bool_)
    forms = np.empty((rectangles.corner.shape[0], 9))
    for n in range(uv.shape[0]):
        x, y, valid = pixel_ray(lens, uv[n, 0], uv[n, 1])
        if not valid:
            continue
        linear_forms(rectangles, T_o_c, n, forms)
        middle, _ = nearest(forms, x, y)
        alike = middle >= 0
        for k in range(probes.shape[0]):
            if not alike:
                break
            x, y, valid = pixel_ray(lens, uv[n, 0] + probes[k, 0], uv[n, 1] + probes[k, 1])
            alike = valid and nearest(forms, x, y)[0] == middle
        single[n] = alike
    return single
