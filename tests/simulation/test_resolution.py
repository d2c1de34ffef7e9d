"""A scenario with another sensor behind the same lens: the view is as wide, its middle stays where it was."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.geometry.camera import CameraModel
from asyneio.simulation import EVENT_SCENARIOS
from asyneio.simulation.events.scenario import at_resolution
from asyneio.types import CameraIntrinsics, FloatArray

BASE = EVENT_SCENARIOS["suite_fine_6dof"]


def places(camera: CameraIntrinsics, share: FloatArray) -> FloatArray:
    """What is seen (N,2) [normalised] at shares (N,2) of the width from the middle of the image."""
    middle = np.array([camera.width, camera.height]) / 2.0 - 0.5
    return CameraModel(camera).undistort(middle + share * camera.width)[0]


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (120, 90)])
def test_the_view_stays(size: tuple[int, int]) -> None:
    camera = at_resolution(BASE, *size).camera
    assert (camera.width, camera.height) == size
    share = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 5), np.linspace(-0.28, 0.28, 3)), axis=-1).reshape(
        -1, 2
    )
    np.testing.assert_allclose(places(camera, share), places(BASE.camera, share), atol=1e-9)
    assert camera.coefficients == BASE.camera.coefficients


def test_only_the_camera_changes() -> None:
    scenario = EVENT_SCENARIOS["suite_fine_6dof_1280x720"]
    changed = {
        name
        for name in BASE.__dataclass_fields__
        if name != "T_b_c" and getattr(scenario, name) != getattr(BASE, name)
    }
    assert changed == {"name", "camera"}
