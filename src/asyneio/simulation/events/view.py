# SPDX-License-Identifier: Apache-2.0
"""Viewing rays of a camera's pixels, and the tiles in which the image is rendered."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.events.rays import lens_row, pixel_grid, pixel_rays
from asyneio.types import CameraIntrinsics, FloatArray

#: Side of the square tiles of pixels that are rendered together [px].
TILE = 8


class View(NamedTuple):
    """Viewing rays of a camera with H x W pixels and J tiles (row by row), as kernels take them.

    Attributes:
        rays: (H,W,2) rays at unit depth.
        pitch: (H,W) distance between neighbouring rays at unit depth.
        tiles: (J,4) bounds of the rays of each tile: x_low, y_low, x_high, y_high.
        tile_pitch: (J,) pitch of the first pixel of each tile.
        tile_rows: number of rows of tiles.
    """

    rays: FloatArray
    pitch: FloatArray
    tiles: FloatArray
    tile_pitch: FloatArray
    tile_rows: int


def view_of(camera: CameraIntrinsics) -> View:
    """Viewing rays of all pixels.

    Raises:
        SimulationError: the distortion cannot be inverted at some pixels.
    """
    rays = pixel_rays(lens_row(camera), pixel_grid(camera))
    if np.isnan(rays).any():
        raise SimulationError(
            f"{int(np.isnan(rays[:, 0]).sum())} pixels have no viewing ray with {camera}; expected a "
            "distortion that can be inverted in the whole image: check the coefficients"
        )
    rays = rays.reshape(camera.height, camera.width, 2)
    dv, du = np.gradient(rays, axis=(0, 1))
    pitch = np.sqrt(np.abs(du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]))
    tiles = [
        [*tile.min(axis=(0, 1)), *tile.max(axis=(0, 1))]
        for v in range(0, camera.height, TILE)
        for u in range(0, camera.width, TILE)
        for tile in [rays[v : v + TILE, u : u + TILE]]
    ]
    return View(rays, pitch, np.array(tiles), pitch[::TILE, ::TILE].ravel(), -(-camera.height // TILE))
