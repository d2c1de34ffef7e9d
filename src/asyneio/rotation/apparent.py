# SPDX-License-Identifier: Apache-2.0
"""Apparent rotation: the rotation that a fit reports for a translation, or with a wrong focal length.

A fit of a rotation to the image motion of the whole view minimises the squared residuals. No rotation
explains a translation or an error of the focal length completely, so only a part of them appears in it.
That part depends on the view: without distortion, 5 % of focal length change a rotation about y by 3.8 % with
62 degrees, by 1.9 % with 90 degrees, and not at all with 110 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from asyneio.geometry.camera import CameraModel
from asyneio.types import BoolArray, CameraIntrinsics, FloatArray

#: Pixels on each side of the grid that represents the view.
_GRID = 24
#: Half the differences: logarithm of the focal length, rotation [rad].
_LOG_FOCAL, _TURN = 0.01, 1e-3


@dataclass(frozen=True)
class ApparentRotation:
    """Linear maps to the rotation that a fit over the whole view reports.

    Attributes:
        of_translation: (3,3) from a velocity in the camera frame over the depth of the scene [1/s], for a
            scene of constant depth.
        of_focal: (3,3) derivative by the logarithm of true over calibrated focal length, as a map from the
            true rotation.
    """

    of_translation: FloatArray
    of_focal: FloatArray


def apparent_rotation(camera: CameraIntrinsics) -> ApparentRotation:
    """The maps for a camera, with events or tracks over its whole view."""
    # Middles of equal parts of the view: the border must not count for more than the rest.
    middles = (np.arange(_GRID) + 0.5) / _GRID
    u, v = np.meshgrid(camera.width * middles - 0.5, camera.height * middles - 0.5)
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    model = CameraModel(camera)
    xy, _, valid = model.undistort(uv)
    x, y = xy[valid].T
    one, zero = np.ones_like(x), np.zeros_like(x)
    flow = np.moveaxis(np.array([[-one, zero, x], [zero, -one, y]]), 2, 0)
    changed = []
    for factor in (np.exp(_LOG_FOCAL), np.exp(-_LOG_FOCAL)):
        other = CameraModel(replace(camera, fx=factor * camera.fx, fy=factor * camera.fy))
        seen, inside = _flow_of_rotation(other, model, uv)
        changed.append(_fitted(xy[valid & inside], seen[valid & inside]))
    return ApparentRotation(
        _fitted(xy[valid], flow), np.asarray((changed[0] - changed[1]) / (2.0 * _LOG_FOCAL))
    )


def rotation_flow(xy: FloatArray) -> FloatArray:
    """Image motion (N,2,3) of positions (N,2) on the normalised plane by unit rotations about the axes."""
    x, y = xy.T
    return np.moveaxis(np.array([[x * y, -(1.0 + x * x), y], [1.0 + y * y, -x * y, -x]]), 2, 0)


def _fitted(xy: FloatArray, flow: FloatArray) -> FloatArray:
    """Rotations (3,3) that fit the columns of a flow (N,2,3) best."""
    rows = rotation_flow(xy).reshape(-1, 3)
    return np.asarray(np.linalg.lstsq(rows, flow.reshape(-1, 3), rcond=None)[0])


def _flow_of_rotation(
    true: CameraModel, calibrated: CameraModel, uv: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Image motion (N,2,3) by unit rotations of the true camera, on the normalised plane of the calibrated
    one, and where it exists (N,)."""
    xy, _, valid = true.undistort(uv)
    flow = np.zeros((len(uv), 2, 3))
    for axis, motion in enumerate(np.moveaxis(rotation_flow(xy), 2, 0)):
        for turn in (_TURN, -_TURN):
            moved, seen = true.project(np.column_stack([xy + turn * motion, np.ones(len(xy))]))
            end, _, inside = calibrated.undistort(moved)
            flow[:, :, axis] += end / (2.0 * turn)
            valid = valid & inside & seen
    return flow, np.asarray(valid)
