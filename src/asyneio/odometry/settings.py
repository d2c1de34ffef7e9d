# SPDX-License-Identifier: Apache-2.0
"""From configuration and calibration to the plain values that estimation and initialization take."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from asyneio.config import CalibrationConfig, Config, MotionPriorConfig
from asyneio.estimation.problem.camera_calibration import CalibrationSettings
from asyneio.estimation.problem.inertial_calibration import AS_READ, CorrectionSettings, correction_settings
from asyneio.estimation.problem.schemes import SCHEMES, Scheme
from asyneio.estimation.problem.window_settings import WindowSettings
from asyneio.estimation.solver.optimizer import OptimizerSettings
from asyneio.inertial.noise import InertialNoise
from asyneio.trajectory.model import motion_model_named
from asyneio.types import NS_PER_S, Calibration, FloatArray

#: The weight of the prior on the camera's rotation is halved at this number of standard deviations.
_ROTATION_TAIL = 2.0


@dataclass(frozen=True)
class InitializationSettings:
    """Settings of the initialization beyond those of the window."""

    min_seconds: float
    max_seconds: float
    min_landmarks: int
    max_scale_sigma: float
    bias_sigma: FloatArray  # (6,) prior on the first biases
    optimizer: OptimizerSettings


@dataclass(frozen=True)
class Settings:
    """All plain values of one odometry.

    They are resolved once; only the noise, which is learned from the samples, changes afterwards.
    """

    knot_interval_ns: int
    window_s: float
    window: WindowSettings
    optimizer: OptimizerSettings
    initialization: InitializationSettings
    attitude_bias_sigma: float  # rad/s, of the gyroscope's bias due to gravity

    def with_noise(self, noise: InertialNoise) -> Settings:
        """The same settings for inertial samples of another noise."""
        return replace(self, window=replace(self.window, noise=noise))


def resolve(config: Config, calibration: Calibration, noise: InertialNoise) -> Settings:
    """Settings for inertial samples of the given noise."""
    initialization, inertial, optimizer = config.initialization, config.inertial, config.optimizer
    bias_sigma = [inertial.initial_gyroscope_bias_sigma, inertial.initial_accelerometer_bias_sigma]
    return Settings(
        knot_interval_ns=round(config.window.knot_interval_s * NS_PER_S),
        window_s=config.window.length_s,
        window=_window(config, calibration, noise),
        optimizer=OptimizerSettings(
            optimizer.max_iterations,
            optimizer.relative_decrease,
            optimizer.initial_damping,
            optimizer.small_step,
        ),
        initialization=InitializationSettings(
            min_seconds=initialization.min_seconds,
            max_seconds=initialization.max_seconds,
            min_landmarks=initialization.min_landmarks,
            max_scale_sigma=initialization.max_scale_sigma,
            bias_sigma=np.repeat(bias_sigma, 3),
            optimizer=OptimizerSettings(
                optimizer.initial_max_iterations,
                optimizer.initial_relative_decrease,
                optimizer.initial_damping,
            ),
        ),
        attitude_bias_sigma=inertial.gyroscope_g_sensitivity * inertial.gravity,
    )


def _window(config: Config, calibration: Calibration, noise: InertialNoise) -> WindowSettings:
    declared, inertial, visual = calibration.noise, config.inertial, config.visual
    focal = 0.5 * (calibration.camera.fx + calibration.camera.fy)
    prior = config.motion_prior
    walk = inertial.walk_inflation * np.repeat([declared.gyroscope_walk, declared.accelerometer_walk], 3)
    bearing_damping = (focal / visual.bearing_sigma_px) ** 2
    return WindowSettings(
        gravity_w=np.array([0.0, 0.0, -inertial.gravity]),
        motion_model=motion_model_named(prior.kind, prior.space),
        root_density=_root_density(prior),
        bias_walk=np.maximum(walk, 1e-9),
        scheme=SCHEMES[inertial.scheme],
        noise=noise,
        noise_inflation=inertial.noise_inflation,
        T_b_c=calibration.T_b_c,
        robust_scale=visual.robust_scale,
        gate=visual.gate_sigma,
        landmark_dof=3 if visual.estimate_bearing else 1,
        landmark_damping=np.array([1.0 / visual.inverse_depth_sigma**2, bearing_damping, bearing_damping]),
        bearing_sigma=visual.pixel_sigma / focal,
        min_observations=visual.min_observations,
        frozen_linearization=config.window.frozen_linearization,
        calibration=_calibration(config.calibration, visual.estimate_bearing),
        imu=_correction(config.calibration, SCHEMES[inertial.scheme], prior.kind),
    )


def _calibration(config: CalibrationConfig, refines_bearing: bool) -> CalibrationSettings:
    """Which parameters of the camera are estimated.

    A fixed bearing was interpolated to its knot with the time offset at that time: the offset cannot change
    afterwards.
    """
    offset = config.estimate_time_offset and refines_bearing
    chosen = [offset, *[config.estimate_extrinsic_rotation] * 3]
    rotation = np.radians([config.extrinsic_rotation_sigma_deg, config.extrinsic_rotation_walk_deg])
    return CalibrationSettings(
        columns=np.flatnonzero(chosen),
        sigma=np.append(config.time_offset_sigma_s, np.full(3, rotation[0])),
        walk=np.append(config.time_offset_walk, np.full(3, rotation[1])),
        tail=_ROTATION_TAIL * float(rotation[0]),
    )


def _correction(config: CalibrationConfig, scheme: Scheme, prior: str) -> CorrectionSettings:
    """Which parameters of the IMU are estimated: increments do not show how they change with scale factors,
    and with white noise on acceleration as the prior, its errors in lively motion would look like them."""
    if not (config.estimate_imu_scale and scheme.direct and prior == "wnoj"):
        return AS_READ
    return correction_settings(config.imu_scale_sigma, config.imu_misalignment_sigma, config.imu_scale_walk)


def _root_density(prior: MotionPriorConfig) -> FloatArray:
    """Square root (6,) of the power spectral density of the quantity that the prior models as white noise."""
    if prior.kind == "wnoa":
        return np.repeat([prior.angular_acceleration_density, prior.linear_acceleration_density], 3)
    return np.repeat([prior.angular_jerk_density, prior.linear_jerk_density], 3)
