# SPDX-License-Identifier: Apache-2.0
"""Textures of rooms: overlapping shapes of all sizes on a noise background, or photographs.

Shapes of random reflectance cover each other ("dead leaves" model), with equal area in every octave of size.
Their statistics are those of natural images: edges, sharp corners and T-junctions at all scales.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from asyneio.errors import SimulationError
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray

#: Side of the noise patch that is repeated [texels]; a power of two like all sides.
_PATCH = 512
_DARKEST, _BRIGHTEST = 0.07, 0.9
#: Radius of the smallest shapes [rows of the texture].
_SMALLEST_SHAPE = 5.0
#: Total area of the shapes of each octave of size, as a fraction of the texture.
_COVER = 0.16
#: Number of corners of the shapes, drawn with equal probability from this list; 0 is an ellipse.
_CORNERS = (0.0, 3.0, 4.0, 4.0, 4.0, 5.0)


def procedural_texture(height: int, width: int, aspect: float, rng: np.random.Generator) -> FloatArray:
    """Reflectance (height, width) in 0..1 of overlapping ellipses and polygons on a noise background.

    Sides are powers of two. `aspect`: height of a texel divided by its width, on the wall.
    """
    mottle = _mottle(height, width, rng)
    picture = np.exp(rng.uniform(np.log(0.2), np.log(0.6)) + 0.12 * mottle)
    _paint(picture, _draw_shapes(height, width, aspect, rng), aspect)
    # The shapes have noise too, but less.
    return np.clip(picture * (1.0 + 0.04 * mottle), 0.02, 1.0)


def load_photographs() -> list[FloatArray]:
    """Photographs (H,W) as linear reflectance in 0..1, from `$ASYNEIO_DATA/textures` or
    `../shared/data/textures`.

    Raises:
        SimulationError: the folder does not exist or contains no PNG file, or matplotlib is not installed.
    """
    named = os.environ.get("ASYNEIO_DATA")
    folder = (Path(named) if named else Path("..") / "shared" / "data") / "textures"
    files = sorted(folder.glob("*.png"))
    if not files:
        raise SimulationError(
            f"photographs = True, but {folder} contains no PNG file; expected photographs there: set "
            "ASYNEIO_DATA to the folder that contains `textures`, or use photographs = False"
        )
    try:
        from matplotlib.image import imread
    except ImportError as error:
        raise SimulationError(
            "photographs = True needs matplotlib to read PNG files; install asyneio[report], "
            "or use photographs = False"
        ) from error
    return [_reflectance(np.asarray(imread(file), dtype=np.float64)) for file in files]


def photograph_texture(
    photographs: list[FloatArray], height: int, width: int, rng: np.random.Generator
) -> FloatArray:
    """One of the photographs, mirrored at its borders to fill (height, width), randomly rotated."""
    chosen = np.rot90(photographs[int(rng.integers(len(photographs)))], int(rng.integers(4)))
    rows = _mirrored(height, chosen.shape[0], int(rng.integers(chosen.shape[0])))
    columns = _mirrored(width, chosen.shape[1], int(rng.integers(chosen.shape[1])))
    return np.ascontiguousarray(chosen[np.ix_(rows, columns)])


def _mirrored(count: int, size: int, start: int) -> IntArray:
    position = (start + np.arange(count)) % (2 * size)
    return np.where(position < size, position, 2 * size - 1 - position)


def _reflectance(picture: FloatArray) -> FloatArray:
    grey = picture[..., :3].mean(axis=2) if picture.ndim == 3 else picture
    # Files contain gamma-encoded values; the renderer needs linear intensity.
    linear = grey**2.2
    low, high = np.quantile(linear, [0.01, 0.99])
    return np.clip(_DARKEST + (linear - low) / (high - low) * (_BRIGHTEST - _DARKEST), 0.02, 1.0)


def _mottle(height: int, width: int, rng: np.random.Generator) -> FloatArray:
    """Noise (height, width) with equal power in every octave, mean 0, standard deviation 1.

    It is periodic, so that large textures can repeat it without a seam.
    """
    rows, columns = min(height, _PATCH), min(width, _PATCH)
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)
    spectrum = np.fft.rfft2(rng.normal(size=(rows, columns))) / np.maximum(np.hypot(fy, fx), 1.0 / rows)
    spectrum[0, 0] = 0.0
    noise = np.fft.irfft2(spectrum, s=(rows, columns))
    return np.tile(noise / noise.std(), (height // rows, width // columns))


def _draw_shapes(height: int, width: int, aspect: float, rng: np.random.Generator) -> FloatArray:
    """Shapes (K,7), largest first: centre x y, half axes, angle, corners (0: ellipse), reflectance.

    Lengths are in rows; the height of a row is `aspect` times the width of a column.
    """
    octaves = []
    across = width / aspect
    radius = 0.25 * min(height, across)
    while radius > _SMALLEST_SHAPE:
        count = max(1, round(_COVER * height * across / (np.pi * (0.75 * radius) ** 2)))
        half = radius * rng.uniform(0.5, 1.0, count)
        log_albedo = rng.uniform(np.log(_DARKEST), np.log(_BRIGHTEST), count)
        octaves.append(
            np.column_stack(
                [
                    rng.uniform(0.0, across, count),
                    rng.uniform(0.0, height, count),
                    half,
                    half * rng.uniform(0.4, 1.0, count),
                    # Most objects in rooms are upright.
                    rng.choice([0.0, 0.5 * np.pi], count) + rng.normal(size=count) * rng.choice([0.05, 1.0]),
                    rng.choice(_CORNERS, count),
                    np.exp(log_albedo),
                ]
            )
        )
        radius *= 0.5
    return np.vstack(octaves)


@njit(cache=True)
def _paint(picture: FloatArray, shapes: FloatArray, aspect: float) -> None:
    """Draw shapes into an image (H,W) in their order, with borders antialiased over a texel."""
    height, width = picture.shape
    for row in range(shapes.shape[0]):
        cx, cy, a, b, angle, corners, value = shapes[row]
        c, s = np.cos(angle), np.sin(angle)
        turns = 2.0 * np.pi * np.arange(corners) / max(corners, 1.0)
        across, along = np.cos(turns), np.sin(turns)
        reach = 1.5 * a + 1.0
        left, right = int((cx - reach) * aspect), int((cx + reach) * aspect)
        for i in range(max(0, int(cy - reach)), min(height, int(cy + reach) + 1)):
            for j in range(max(0, left), min(width, right + 1)):
                x, y = j / aspect - cx, i - cy
                p, q = (c * x + s * y) / a, (c * y - s * x) / b
                if corners == 0.0:
                    outside = np.sqrt(p * p + q * q) - 1.0
                else:
                    outside = -1.0
                    for side in range(turns.size):
                        outside = max(outside, p * across[side] + q * along[side] - 0.75)
                cover = min(1.0, max(0.0, 0.5 - outside * b))
                picture[i, j] += cover * (value - picture[i, j])
