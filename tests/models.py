"""The four motion models, for tests that hold for all of them."""

from __future__ import annotations

import pytest

from asyneio.trajectory.model import SE3, SO3_X_R3, WNOA, WNOJ, MotionModel

MODELS = {
    "wnoj-se3": MotionModel(WNOJ, SE3),
    "wnoj-so3xr3": MotionModel(WNOJ, SO3_X_R3),
    "wnoa-se3": MotionModel(WNOA, SE3),
    "wnoa-so3xr3": MotionModel(WNOA, SO3_X_R3),
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
every_space = pytest.mark.parametrize("space", [SE3, SO3_X_R3], ids=["se3", "so3xr3"])
every_prior = pytest.mark.parametrize("prior", [WNOJ, WNOA], ids=["wnoj", "wnoa"])
