# SPDX-License-Identifier: Apache-2.0
"""Typed, frozen settings with defaults. A file overrides defaults; an unknown key is an error.

Each run saves the resolved settings. Components receive the section they need, not the whole tree. Settings
are in seconds, the code in nanoseconds.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from asyneio.errors import ConfigError
from asyneio.safe_yaml import MAX_BYTES, UnsafeYamlError, load_yaml

#: Largest number of errors that are reported for a file.
_MOST_ERRORS = 4


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FrontendConfig(_Section):
    """From events to feature tracks (Algorithm 1)."""

    tracker: Literal["gradient", "haste"] = Field("gradient", description="method that follows features")
    max_features: int = Field(
        100, ge=8, le=1000, description="largest number of features at a time (fts_max)"
    )
    min_interval_s: float = Field(
        0.05, ge=0.0, description="shortest time between two observations of a feature (t_min)"
    )
    max_silence_s: float = Field(
        0.3, gt=0.0, description="a feature without an observation for this time is released (t_max)"
    )
    max_delay_s: float = Field(
        0.06,
        ge=0.0,
        description="longest delay of an observation after its timestamp; the latency of the estimates",
    )
    spacing: float = Field(
        1.0 / 24.0,
        ge=0.0,
        le=0.25,
        description="least distance of a new corner from an active feature, as a share of the sensor's "
        "width; at least 10 px",
    )
    max_load: float = Field(
        0.0,
        ge=0.0,
        description="share of a processor core that tracking may use, by nominal costs; beyond it events, "
        "and then features, are dropped and counted; 0: nothing is dropped",
    )


class WindowConfig(_Section):
    """Sliding window."""

    knot_interval_s: float = Field(0.1, gt=0.0, le=1.0, description="time between knots")
    length_s: float = Field(
        1.5, gt=0.0, le=20.0, description="time between the first and the last knot of the window"
    )
    frozen_linearization: bool = Field(
        False, description="first-estimates Jacobians for every pose in the marginal prior"
    )


class MotionPriorConfig(_Section):
    """Gaussian-process prior on the motion; densities are square roots of power spectral densities, per axis.

    The prior `wnoj` uses the jerk densities, `wnoa` the acceleration densities.
    """

    kind: Literal["wnoj", "wnoa"] = Field("wnoj", description="white noise on jerk, or on acceleration")
    space: Literal["se3", "so3xr3"] = Field(
        "se3", description="pose on SE(3), or rotation and position separately"
    )
    angular_jerk_density: float = Field(30.0, gt=0.0, description="rad/s^3/sqrt(Hz)")
    linear_jerk_density: float = Field(30.0, gt=0.0, description="m/s^3/sqrt(Hz)")
    angular_acceleration_density: float = Field(10.0, gt=0.0, description="rad/s^2/sqrt(Hz)")
    linear_acceleration_density: float = Field(10.0, gt=0.0, description="m/s^2/sqrt(Hz)")


class InertialConfig(_Section):
    """How inertial samples enter the window, and how far the declared noise of the IMU is trusted."""

    scheme: Literal["gpif", "gpp", "preint", "extpreint"] = Field(
        "gpif",
        description="every sample a factor (gpif); GP preintegration (gpp); discrete preintegration "
        "(preint); discrete preintegration with fitted rates (extpreint)",
    )
    noise_inflation: float = Field(
        5.0,
        gt=0.0,
        description="factor on the declared white-noise densities; noise learned from the samples increases "
        "it (`imu_noise` in summary.json)",
    )
    walk_inflation: float = Field(2.0, gt=0.0, description="factor on the declared bias random walks")
    initial_gyroscope_bias_sigma: float = Field(
        0.1, gt=0.0, description="rad/s; data sheets give turn-on biases of 0.02 to 0.1, and up to 0.35"
    )
    initial_accelerometer_bias_sigma: float = Field(
        0.15,
        gt=0.0,
        description="m/s^2; data sheets give limits of 0.2 to 0.8 for turn-on biases, and the initialization "
        "tolerates up to 0.6; with a larger sigma, scale remains unknown for longer",
    )
    gyroscope_g_sensitivity: float = Field(
        1e-4,
        ge=0.0,
        description="rad/s per m/s^2, standard deviation: the bias of a gyroscope changes with the attitude; "
        "data sheets of consumer sensors give 0.1 deg/s per g (1.8e-4); not estimated, but part of the "
        "reported uncertainty of the bias",
    )
    gravity: float = Field(9.81, gt=9.7, lt=9.9, description="m/s^2")


class VisualConfig(_Section):
    """Feature observations and landmarks."""

    pixel_sigma: float = Field(0.5, gt=0.0, description="standard deviation of an observation, pixels")
    robust_scale: float = Field(
        0.6, gt=0.0, description="scale of the Cauchy cost in standard deviations; large: least squares"
    )
    gate_sigma: float = Field(
        8.0, gt=0.0, description="observations beyond this number of standard deviations are rejected"
    )
    min_observations: int = Field(
        3, ge=2, description="observations of a track before its landmark is initialized"
    )
    estimate_bearing: bool = Field(
        True,
        description="estimate the anchor bearing too (3 dof); False: inverse depth only, as in the paper",
    )
    bearing_sigma_px: float = Field(50.0, gt=0.0, description="weak prior on the anchor bearing")
    inverse_depth_sigma: float = Field(3.0, gt=0.0, description="weak prior on inverse depth, 1/m")


class CalibrationConfig(_Section):
    """Online calibration of camera and IMU."""

    estimate_time_offset: bool = Field(
        True,
        description="estimate the clock offset between camera and IMU, added to the calibrated shift; "
        "requires visual.estimate_bearing",
    )
    estimate_extrinsic_rotation: bool = Field(
        True, description="estimate the rotation of the camera in the body"
    )
    time_offset_sigma_s: float = Field(
        0.005, gt=0.0, description="standard deviation of the calibrated shift"
    )
    extrinsic_rotation_sigma_deg: float = Field(
        0.3,
        gt=0.0,
        description="standard deviation of the calibrated rotation, per axis; the tails of the prior are "
        "those of a Cauchy distribution, so that errors of several degrees are found too",
    )
    time_offset_walk: float = Field(
        2e-4,
        ge=0.0,
        description="random walk of the offset, s/sqrt(s): the delay of a pixel changes with the light",
    )
    extrinsic_rotation_walk_deg: float = Field(
        0.002, ge=0.0, description="random walk of the rotation, deg/sqrt(s): a mount that warms up"
    )
    estimate_imu_scale: bool = Field(
        True,
        description="estimate scale factors and misalignment of gyroscope and accelerometer; only with "
        "inertial.scheme gpif and motion_prior.kind wnoj",
    )
    imu_scale_sigma: float = Field(
        0.01,
        gt=0.0,
        description="standard deviation of a scale factor, 1 is 100 %; data sheets give tolerances of 1 to "
        "3 %, for an IMU calibrated at the factory 0.2 to 1 %",
    )
    imu_misalignment_sigma: float = Field(
        0.007,
        gt=0.0,
        description="standard deviation of the sensitivity to another axis, 1 is 100 % (or radians); data "
        "sheets give tolerances of 0.5 to 2 %",
    )
    imu_scale_walk: float = Field(
        1e-5, ge=0.0, description="random walk of scale factors and misalignment, 1/sqrt(s)"
    )


class OptimizerConfig(_Section):
    """Levenberg-Marquardt."""

    max_iterations: int = Field(4, ge=1, description="per knot while tracking")
    initial_max_iterations: int = Field(
        12, ge=1, description="for the joint optimisation of the initialization"
    )
    relative_decrease: float = Field(
        1e-2,
        gt=0.0,
        description="stop when the cost decreases by less than this share, or as the model predicts",
    )
    small_step: float = Field(
        5e-3,
        ge=0.0,
        description="stop also when a step turns no knot by more than this [rad] and moves none by more than "
        "this share of the median distance of the landmarks; while tracking, without moving objects",
    )
    initial_relative_decrease: float = Field(1e-5, gt=0.0, description="the same, for the initialization")
    initial_damping: float = Field(
        1e-9,
        gt=0.0,
        description="relative to the diagonal, after the first rejected step; scale is a weakly constrained "
        "direction, and 1e-6 already prevents its convergence",
    )


class InitializationConfig(_Section):
    """Initialization from the data alone."""

    min_seconds: float = Field(1.0, gt=0.0, description="shortest span that is used")
    max_seconds: float = Field(
        4.0, gt=0.0, description="longest span that is used; older measurements are dropped"
    )
    min_landmarks: int = Field(15, ge=4, description="least number of tracks with parallax")
    max_scale_sigma: float = Field(0.1, gt=0.0, description="largest relative standard deviation of scale")


class HealthConfig(_Section):
    """Limits beyond which the state is DEGRADED or LOST; limits that suit every sensor are constants."""

    max_visual_gap_s: float = Field(
        0.1, gt=0.0, description="DEGRADED after a longer time without observations"
    )
    max_inertial_gap_s: float = Field(
        0.05, gt=0.0, description="DEGRADED after a longer time without samples of a sensor of the IMU"
    )
    lost_inertial_gap_s: float = Field(
        0.5, gt=0.0, description="LOST after a longer time without samples: nothing connects the poses"
    )
    patience_s: float = Field(
        1.0,
        ge=0.0,
        description="LOST after measurements contradict the estimate, or it is useless, for this time",
    )
    recovery_s: float = Field(
        0.5, ge=0.0, description="time without a finding until DEGRADED becomes TRACKING"
    )
    max_speed: float = Field(30.0, gt=0.0, description="m/s; LOST beyond")
    max_velocity_sigma: float = Field(
        1.0, gt=0.0, description="m/s; an estimate with a larger standard deviation is useless"
    )
    max_tilt_sigma_deg: float = Field(5.0, gt=0.0, description="the same for roll and pitch, deg")
    max_scale_sigma: float = Field(
        0.1,
        gt=0.0,
        description="DEGRADED after an initialization in motion until the relative standard deviation of "
        "scale is smaller",
    )


class Config(_Section):
    """All settings of the estimator."""

    frontend: FrontendConfig = FrontendConfig()
    window: WindowConfig = WindowConfig()
    motion_prior: MotionPriorConfig = MotionPriorConfig()
    inertial: InertialConfig = InertialConfig()
    visual: VisualConfig = VisualConfig()
    calibration: CalibrationConfig = CalibrationConfig()
    optimizer: OptimizerConfig = OptimizerConfig()
    initialization: InitializationConfig = InitializationConfig()
    health: HealthConfig = HealthConfig()


def load_config(path: Path | None, base: Mapping[str, Mapping[str, Any]] | None = None) -> Config:
    """Read a YAML file of overrides. `None` gives the defaults.

    Args:
        path: the file.
        base: sections of values that take precedence over the defaults, but not over the file.

    Raises:
        ConfigError: the file is missing, is not a mapping, or contains an unknown key or an invalid value.
    """
    given = _read(path) if path is not None else {}
    merged: dict[Any, Any] = {name: dict(section) for name, section in (base or {}).items()}
    for name, section in given.items():
        both = isinstance(section, dict) and isinstance(merged.get(name), dict)
        merged[name] = {**merged[name], **section} if both else section
    try:
        return Config.model_validate(merged)
    except ValidationError as error:
        lines = [_explained(tuple(map(str, e["loc"])), e["type"], e["msg"]) for e in error.errors()]
        more = f"; and {len(lines) - _MOST_ERRORS} more" if len(lines) > _MOST_ERRORS else ""
        raise ConfigError(
            f"{path or 'the settings'}: {'; '.join(lines[:_MOST_ERRORS])}{more}; "
            "expected names and values as `asyneio config show` prints them"
        ) from error


def dump_config(config: Config) -> str:
    """The resolved configuration as YAML, with every key."""
    return yaml.safe_dump(config.model_dump(), sort_keys=False)


def _read(path: Path) -> dict[Any, Any]:
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise UnsafeYamlError(f"is larger than {MAX_BYTES // 1024} KiB")
        raw = load_yaml(data.decode("utf-8-sig"))
    except OSError as error:
        raise ConfigError(
            f"cannot read the configuration {path}: {error.strerror}; check the path"
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path} is not text in UTF-8 ({error.reason}); expected a configuration"
        ) from error
    except UnsafeYamlError as error:
        raise ConfigError(
            f"{path} {error}; expected sections with settings, as in config.yaml of a run"
        ) from error
    if raw is None:
        return {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{path} contains a {type(raw).__name__}; expected a mapping of sections")
    return raw


def _explained(location: tuple[str, ...], kind: str, message: str) -> str:
    """One error; for an unknown key with the most similar known key, of this or another section."""
    where = ".".join(location)
    if kind != "extra_forbidden":
        return f"{where}: {message}"
    sections = {name: tuple(type(section).model_fields) for name, section in Config()}
    known = sections.get(location[0], ()) if len(location) > 1 else tuple(sections)
    elsewhere = [f"{name}.{location[-1]}" for name, fields in sections.items() if location[-1] in fields]
    close = elsewhere or difflib.get_close_matches(location[-1], known, n=1, cutoff=0.5)
    meant = f"did you mean {close[0]}?" if close else f"expected one of {', '.join(known)}"
    return f"unknown setting {where}; {meant}"


def differences(first: Config, second: Config) -> dict[str, tuple[Any, Any]]:
    """Settings that differ, as `section.name`, and their values in both."""
    return {
        f"{name}.{key}": (value, getattr(getattr(second, name), key))
        for name, section in first
        for key, value in section
        if value != getattr(getattr(second, name), key)
    }
