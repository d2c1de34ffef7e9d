# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms (4,4) from calibration files, checked: lists of rows, matrices, quaternions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from asyneio.errors import CalibrationError
from asyneio.io.calibration.values import matrix, number
from asyneio.types import FloatArray

#: Largest entry of R R^T - I that rounded digits explain; a matrix with a larger one is not a rotation.
MAX_ROTATION_ERROR = 1e-3
#: Above this, a rotation is replaced by the nearest orthonormal one, with a note.
REPAIRED_ROTATION_ERROR = 1e-7
#: Longer lever arms [m] get a note (wrong unit?), and are rejected.
DOUBTFUL_TRANSLATION, MAX_TRANSLATION = 1.0, 20.0

#: A transform (4,4) and notes on what was repaired or is suspect.
Checked = tuple[FloatArray, tuple[str, ...]]


def read_rigid(section: dict[str, Any], key: str, path: Path) -> Checked:
    """The transform at `key`: four rows of four numbers, or rows, cols and data.

    Raises:
        CalibrationError: not a rigid transform.
    """
    T = matrix(section, key, (4, 4), path)
    if not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise CalibrationError(
            f"{path}: {key} must be a rigid transform with the last row 0 0 0 1; found {T[3].tolist()}"
        )
    return check_rigid(T[:3, :3], T[:3, 3], key, path)


def read_quaternion_pose(section: dict[str, Any], key: str, path: Path) -> Checked:
    """The transform of a mapping px py pz [m] qx qy qz qw. Raises CalibrationError as above."""
    t = np.array([number(section, name, path) for name in ("px", "py", "pz")])
    q = np.array([number(section, name, path) for name in ("qx", "qy", "qz", "qw")])
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > MAX_ROTATION_ERROR:
        raise CalibrationError(
            f"{path}: the quaternion of {key} has length {length:g}; expected 1: check its four numbers"
        )
    x, y, z, w = (q / length).tolist()
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return check_rigid(R, t, key, path)


def check_rigid(R: FloatArray, t: FloatArray, key: str, path: Path) -> Checked:
    """The transform with a rotation (3,3) and a translation (3,) [m]. Raises CalibrationError as above."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(np.abs(R @ R.T - np.eye(3)).max())
        longest = float(np.abs(t).max())
    if not error <= MAX_ROTATION_ERROR:
        raise CalibrationError(
            f"{path}: the rotation of {key} is not orthonormal (R R^T is off by {error:.2g}); its columns "
            "must have length 1 and be at right angles: check the digits and that it is not scaled"
        )
    if np.linalg.det(R) < 0.0:
        raise CalibrationError(
            f"{path}: the rotation of {key} is a reflection (det = -1, expected +1): an axis has the wrong "
            "sign; the third column must be the cross product of the first two"
        )
    if longest > MAX_TRANSLATION:
        raise CalibrationError(
            f"{path}: {key} places camera and IMU {longest:g} m apart; the translation must be in metres: "
            "divide by 1000 if these are millimetres"
        )
    notes: tuple[str, ...] = ()
    if longest > DOUBTFUL_TRANSLATION:
        notes += (
            f"{path.name}: {key} places camera and IMU {longest:.3g} m apart; is its translation in metres?",
        )
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    if error > REPAIRED_ROTATION_ERROR:
        U, _, Vt = np.linalg.svd(R)
        T[:3, :3] = U @ Vt
        notes += (f"{path.name}: the rotation of {key} was off by {error:.1g}; made orthonormal",)
    return T, notes


def inverse_rigid(T: FloatArray) -> FloatArray:
    """The inverse of a rigid transform (4,4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse
