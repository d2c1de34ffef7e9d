# SPDX-License-Identifier: Apache-2.0
"""Settings of a window as plain values."""

from __future__ import annotations

from dataclasses import dataclass

from asyneio.estimation.problem.camera_calibration import FIXED_CALIBRATION, CalibrationSettings
from asyneio.estimation.problem.inertial_calibration import AS_READ, CorrectionSettings
from asyneio.estimation.problem.schemes import Scheme
from asyneio.inertial.noise import InertialNoise
from asyneio.trajectory.model import MotionModel
from asyneio.types import FloatArray


@dataclass(frozen=True)
class WindowSettings:
    """Values that a window is configured with; arrays are not copied."""

    gravity_w: FloatArray  # (3,)
    motion_model: MotionModel
    root_density: FloatArray  # (6,) motion prior
    bias_walk: FloatArray  # (6,)
    scheme: Scheme
    noise: InertialNoise  # of the samples, where `Window.extend` is given no other
    noise_inflation: float  # that noise over the sensor's own
    T_b_c: FloatArray  # (4,4)
    robust_scale: float
    gate: float
    landmark_dof: int
    landmark_damping: FloatArray  # (3,)
    bearing_sigma: float  # rad, of one observation: decides whether a track has parallax
    min_observations: int
    frozen_linearization: bool
    calibration: CalibrationSettings = FIXED_CALIBRATION
    imu: CorrectionSettings = AS_READ
