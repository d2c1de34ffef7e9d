"""The rays of a camera's pixels, and the tiles that the image is rendered in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.events.rays import lens_row, pixel_grid, pixel_rays
from asyneio.types import CameraIntrinsics, FloatArray

#: Side of the squares of pixels that are rendered together.
TILE = 8


@dataclass(frozen=True)
class View:
    """A camera's rays: `rays` (H,W,2) at unit depth, `pitch` (H,W) their spacing per pixel; of each square of
    8 x 8 pixels, row by row, `tiles` (J,4) x_low, y_low, x_high, y_high of the rays, `tile_pitch` (J,).
    `tile_rows`: how many rows of tiles."""

    rays: FloatArray
    pitch: FloatArray
    tiles: FloatArray
    tile_pitch: FloatArray
    tile_rows: int


def view_of(camera: CameraIntrinsics) -> View:
    """The rays of all pixels.

    Raises:
        SimulationError: the lens model images nothing at some pixel.
    """
    rays = pixel_rays(lens_row(camera), pixel_grid(camera))
    if np.isnan(rays).any():
        raise SimulationError(
            f"{int(np.isnan(rays[:, 0]).sum())} pixels see nothing with {camera}; expected a distortion "
            "that can be inverted in the whole image: check the coefficients"
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
