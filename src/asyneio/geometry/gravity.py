# SPDX-License-Identifier: Apache-2.0
"""Attitude from the direction of gravity: roll and pitch, no yaw."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.types import FloatArray


def upright(gravity_b: FloatArray) -> FloatArray:
    """Smallest rotation (3,3) that aligns gravity (3,) in the body, of any length, with -z."""
    down = np.array([0.0, 0.0, -1.0])
    unit = gravity_b / np.linalg.norm(gravity_b)
    axis = np.cross(unit, down)
    sine, cosine = np.linalg.norm(axis), float(unit @ down)
    if sine < 1e-12:
        return np.eye(3) if cosine > 0.0 else np.diag([1.0, -1.0, -1.0])
    matrix: FloatArray = Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)).as_matrix()
    return matrix
