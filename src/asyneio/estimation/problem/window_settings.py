"""What a window is told: its settings, and the observations it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.problem.camera_calibration import FIXED_CALIBRATION, CalibrationSettings
from asyneio.estimation.problem.inertial_calibration import AS_READ, CorrectionSettings
from asyneio.estimation.problem.schemes import Scheme
from asyneio.inertial.noise import InertialNoise
from asyneio.trajectory.model import MotionModel
from asyneio.types import FloatArray, IntArray


@dataclass(frozen=True)
class WindowSettings:
    """Plain values that the window needs."""

    gravity_w: FloatArray  # (3,)
    motion_model: MotionModel
    root_density: FloatArray  # (6,) motion prior
    bias_walk: FloatArray  # (6,)
    scheme: Scheme
    noise: InertialNoise  # of the samples, unless an interval is told another
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


@dataclass(frozen=True)
class TrackObservations:
    """Undistorted observations: `t_ns` (N,), `track` (N,), `xy` (N,2), `root_information` (N,2,2)."""

    t_ns: IntArray
    track: IntArray
    xy: FloatArray
    root_information: FloatArray

    def between(self, start_ns: int, end_ns: int) -> TrackObservations:
        """Those with start < t <= end (times ascending)."""
        a, b = np.searchsorted(self.t_ns, [start_ns, end_ns], side="right")
        return TrackObservations(self.t_ns[a:b], self.track[a:b], self.xy[a:b], self.root_information[a:b])
