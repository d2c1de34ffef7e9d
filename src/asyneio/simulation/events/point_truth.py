"""Truth for feature tracks: what point of the world a pixel sees, where it goes, what hides it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from asyneio.simulation.camera import BoolArray, PinholeCamera
from asyneio.simulation.events.planes import linear_forms, nearest
from asyneio.simulation.events.rays import lens_row, pixel_ray
from asyneio.simulation.events.worlds import World
from asyneio.simulation.motion import Motion
from asyneio.types import CameraIntrinsics, FloatArray, IntArray

#: A point counts as visible when what is seen in its direction is nearer by no more than this fraction.
_TOLERANCE = 1e-3
#: Spacing of the probes of `single_surface` [px].
_PROBE_PX = 2.0


@dataclass(frozen=True)
class PointTruth:
    """Exact rays and points of a run; times (N,) ns in the **camera clock**, distorted pixels (N,2).

    Times outside the run are answered too: the motion does not end there.
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
        """What pixels see: points (N,3) [m] of the world, index (N,) of their rectangle, valid (N,).

        Invalid, with points nan and index -1: the ray meets nothing, or the lens images nothing there.
        """
        points, surface = _hit(*self._arguments(t_ns, uv))
        return points, surface, surface >= 0

    def project(self, t_ns: ArrayLike, points_w: ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Where points (N,3) of the world are seen: distorted pixels (N,2), visible (N,).

        Visible: in front of the camera, inside the image, not hidden by a rectangle. Pixels of points that
        are not in front are meaningless but finite.
        """
        points = np.atleast_2d(np.asarray(points_w, dtype=np.float64))
        T_w_c = self.T_w_c(t_ns)
        points_c = np.einsum("nji,nj->ni", T_w_c[:, :3, :3], points - T_w_c[:, :3, 3])
        pixels, visible = PinholeCamera.from_intrinsics(self.camera).visible(points_c, 0.0)
        candidates = np.flatnonzero(visible)
        seen = _unhidden(*self._rectangles(), T_w_c[candidates], points_c[candidates])
        visible[candidates[~seen]] = False
        return pixels, visible

    def single_surface(self, t_ns: ArrayLike, uv: ArrayLike, radius_px: float = 8.0) -> BoolArray:
        """Whether all within `radius_px` of pixels (N,2) lies on one rectangle (N,)."""
        steps = np.arange(-radius_px, radius_px + 1e-9, _PROBE_PX)
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        turn = np.arange(24) * (2.0 * np.pi / 24)
        rim = radius_px * np.column_stack([np.cos(turn), np.sin(turn)])
        # The rim first: it decides most cases.
        probes = np.vstack([rim, grid[np.hypot(*grid.T) <= radius_px]])
        return _single_surface(*self._arguments(t_ns, uv), probes)

    def _rectangles(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.world.corner, self.world.edge_u, self.world.edge_v

    def _arguments(
        self, t_ns: ArrayLike, uv: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        pixels = np.atleast_2d(np.asarray(uv, dtype=np.float64))
        return (*self._rectangles(), lens_row(self.camera), self.T_w_c(t_ns), pixels)


@njit(cache=True)
def _hit(
    corner: FloatArray,
    edge_u: FloatArray,
    edge_v: FloatArray,
    lens: FloatArray,
    T_w_c: FloatArray,
    uv: FloatArray,
) -> tuple[FloatArray, IntArray]:
    points = np.full((uv.shape[0], 3), np.nan)
    surface = np.full(uv.shape[0], -1, dtype=np.int64)
    forms = np.empty((corner.shape[0], 9))
    for n in range(uv.shape[0]):
        x, y, valid = pixel_ray(lens, uv[n, 0], uv[n, 1])
        if not valid:
            continue
        linear_forms(corner, edge_u, edge_v, T_w_c[n], forms)
        found, inverse = nearest(forms, x, y)
        if found < 0:
            continue
        surface[n] = found
        for i in range(3):
            ray = T_w_c[n, i, 0] * x + T_w_c[n, i, 1] * y + T_w_c[n, i, 2]
            points[n, i] = T_w_c[n, i, 3] + ray / inverse
    return points, surface


@njit(cache=True)
def _unhidden(
    corner: FloatArray, edge_u: FloatArray, edge_v: FloatArray, T_w_c: FloatArray, points_c: FloatArray
) -> NDArray[np.bool_]:
    seen = np.empty(points_c.shape[0], dtype=np.bool_)
    forms = np.empty((corner.shape[0], 9))
    for n in range(points_c.shape[0]):
        linear_forms(corner, edge_u, edge_v, T_w_c[n], forms)
        depth = points_c[n, 2]
        _, inverse = nearest(forms, points_c[n, 0] / depth, points_c[n, 1] / depth)
        seen[n] = inverse * depth <= 1.0 + _TOLERANCE
    return seen


@njit(cache=True)
def _single_surface(
    corner: FloatArray,
    edge_u: FloatArray,
    edge_v: FloatArray,
    lens: FloatArray,
    T_w_c: FloatArray,
    uv: FloatArray,
    probes: FloatArray,
) -> NDArray[np.bool_]:
    single = np.zeros(uv.shape[0], dtype=np.bool_)
    forms = np.empty((corner.shape[0], 9))
    for n in range(uv.shape[0]):
        x, y, valid = pixel_ray(lens, uv[n, 0], uv[n, 1])
        if not valid:
            continue
        linear_forms(corner, edge_u, edge_v, T_w_c[n], forms)
        middle, _ = nearest(forms, x, y)
        alike = middle >= 0
        for k in range(probes.shape[0]):
            if not alike:
                break
            x, y, valid = pixel_ray(lens, uv[n, 0] + probes[k, 0], uv[n, 1] + probes[k, 1])
            alike = valid and nearest(forms, x, y)[0] == middle
        single[n] = alike
    return single
