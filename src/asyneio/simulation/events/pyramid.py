# SPDX-License-Identifier: Apache-2.0
"""Mip pyramids of all textures of a world in one flat array, for the renderer.

Each level averages 2 x 2 texels of linear intensity. Without levels, a fine texture far away would be sampled
at random texels, which is white noise that changes with every motion of the camera.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from asyneio.errors import SimulationError
from asyneio.types import FloatArray, IntArray


class Pyramids(NamedTuple):
    """The textures of R rectangles, as kernels take them.

    Attributes:
        texels: (K,) all levels of all textures, each with a border of one repeated texel.
        offset: (R,L) index in `texels` of the first texel of each level.
        size: (R,2) rows and columns of level 0.
        levels: (R,) number of levels.
    """

    texels: NDArray[np.float32]
    offset: IntArray
    size: IntArray
    levels: IntArray


def build_pyramids(textures: list[FloatArray]) -> Pyramids:
    """Build the pyramids of textures whose sides are powers of two.

    Raises:
        SimulationError: a side is not a power of two.
    """
    parts: list[NDArray[np.float32]] = []
    starts: list[list[int]] = []
    total = 0
    for texture in textures:
        rows, columns = texture.shape
        if rows & (rows - 1) or columns & (columns - 1):
            raise SimulationError(f"a texture of {rows} x {columns} texels; expected powers of two")
        level, begin = texture, []
        while True:
            begin.append(total)
            padded = np.pad(level, 1, mode="edge").astype(np.float32)
            parts.append(padded.ravel())
            total += padded.size
            if min(level.shape) == 1:
                break
            level = level.reshape(level.shape[0] // 2, 2, level.shape[1] // 2, 2).mean(axis=(1, 3))
        starts.append(begin)
    offset = np.zeros((len(textures), max(map(len, starts))), dtype=np.int64)
    for row, begin in enumerate(starts):
        offset[row, : len(begin)] = begin
    return Pyramids(
        np.concatenate(parts),
        offset,
        np.array([texture.shape for texture in textures], dtype=np.int64),
        np.array([len(begin) for begin in starts], dtype=np.int64),
    )
