"""Typed, frozen defaults. A file only overrides; an unknown key is an error; the resolved copy is saved.

Components receive the section they need, never the whole tree. Seconds here, nanoseconds inside.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from asyneio.errors import ConfigError

#: Of a file that is something else altogether, a few mistakes are enough.
_MOST_ERRORS = 4


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FrontendConfig(_Section):
    """From events to feature tracks (Algorithm 1)."""

    tracker: Literal["gradient", "haste"] = Field("gradient", description="how features are followed")
    max_features: int = Field(100, ge=8, le=1000, description="alive at a time (fts_max)")
    min_interval_s: float = Field(
        0.02, ge=0.0, description="least time between two observations of a feature (t_min)"
    )
    max_silence_s: float = Field(
        0.3, gt=0.0, description="a feature that has not moved for so long is released (t_max)"
    )
    max_delay_s: float = Field(
        0.06, ge=0.0, description="how long after its stamp an observation may come; the estimates' latency"
    )
    spacing: float = Field(
        1.0 / 24.0,
        ge=0.0,
        le=0.25,
        description="no new corner nearer to an active feature than this share of the sensor's width, "
        "or than 10 px",
    )
    max_load: float = Field(
        0.0,
        ge=0.0,
        description="share of a processor core that tracking may use, by nominal costs; beyond it events, "
        "and then features, are shed and counted; 0: nothing is shed",
    )


class WindowConfig(_Section):
    """Sliding window."""

    knot_interval_s: float = Field(0.1, gt=0.0, le=1.0, description="time between knots")
    length_s: float = Field(1.5, gt=0.0, le=20.0, description="time spanned by the knots in the window")
    frozen_linearization: bool = Field(
        False, description="first-estimates Jacobians for every pose that the marginal prior touches"
    )


class MotionPriorConfig(_Section):
    """What the motion between two knots is like; densities are square roots of power spectral ones, per axis.

    The jerk densities belong to `wnoj`, the acceleration densities to `wnoa`.
    """

    kind: Literal["wnoj", "wnoa"] = Field("wnoj", description="white noise on jerk, or on acceleration")
    space: Literal["se3", "so3xr3"] = Field(
        "se3", description="position and rotation regressed together, or the position on its own"
    )
    angular_jerk_density: float = Field(30.0, gt=0.0, description="rad/s^3/sqrt(Hz)")
    linear_jerk_density: float = Field(30.0, gt=0.0, description="m/s^3/sqrt(Hz)")
    angular_acceleration_density: float = Field(10.0, gt=0.0, description="rad/s^2/sqrt(Hz)")
    linear_acceleration_density: float = Field(10.0, gt=0.0, description="m/s^2/sqrt(Hz)")


class InertialConfig(_Section):
    """How inertial samples enter the window, and how far the IMU's noise figures are trusted."""

    scheme: Literal["gpif", "gpp", "preint", "extpreint"] = Field(
        "gpif",
        description="every sample a factor; GP preintegration; discrete preintegration; the same with "
        "fitted rates",
    )
    noise_inflation: float = Field(
        5.0,
        gt=0.0,
        description="factor on the declared white-noise densities that is believed until more is known; what "
        "the samples show raises it (`imu_noise` in summary.json)",
    )
    walk_inflation: float = Field(2.0, gt=0.0, description="factor on the bias walks")
    initial_gyroscope_bias_sigma: float = Field(
        0.1, gt=0.0, description="rad/s; data sheets give turn-on biases of 0.02 to 0.1, and up to 0.35"
    )
    initial_accelerometer_bias_sigma: float = Field(
        0.15,
        gt=0.0,
        description="m/s^2; data sheets give turn-on biases of 0.2 to 0.8 as limits, and up to 0.6 a start "
        "bears; a larger sigma leaves its scale unknown for longer",
    )
    gravity: float = Field(9.81, gt=9.7, lt=9.9, description="m/s^2")


class VisualConfig(_Section):
    """Feature observations and landmarks."""

    pixel_sigma: float = Field(0.5, gt=0.0, description="standard deviation of an observation, pixels")
    robust_scale: float = Field(
        0.6, gt=0.0, description="scale of the Cauchy cost in standard deviations; large: least squares"
    )
    gate_sigma: float = Field(8.0, gt=0.0, description="observations further off than this are ignored")
    min_observations: int = Field(3, ge=2, description="observations a landmark needs before it is used")
    estimate_bearing: bool = Field(
        True, description="refine the anchor bearing too (3 dof); False: inverse depth only, as in the paper"
    )
    bearing_sigma_px: float = Field(50.0, gt=0.0, description="weak prior on the anchor bearing")
    inverse_depth_sigma: float = Field(3.0, gt=0.0, description="weak prior on inverse depth, 1/m")


class CalibrationConfig(_Section):
    """Refining what the calibration says of the camera, from the start on."""

    estimate_time_offset: bool = Field(
        True,
        description="time of the camera against the IMU, on top of the calibrated shift; "
        "never without visual.estimate_bearing",
    )
    estimate_extrinsic_rotation: bool = Field(False, description="rotation of the camera in the body")
    time_offset_sigma_s: float = Field(0.005, gt=0.0, description="how far the calibrated shift may be off")
    extrinsic_rotation_sigma_deg: float = Field(
        1.0, gt=0.0, description="how far the calibrated rotation may be off, per axis"
    )
    time_offset_walk: float = Field(
        2e-4,
        ge=0.0,
        description="how the offset may drift, s/sqrt(s): a pixel's delay changes with the light",
    )
    extrinsic_rotation_walk_deg: float = Field(
        0.002, ge=0.0, description="how the rotation may drift, deg/sqrt(s): a mount that warms up"
    )
    estimate_imu_scale: bool = Field(
        False,
        description="scale factors and misalignment of gyroscope and accelerometer, for an IMU that was not "
        "calibrated to better than 1 %; only where every sample is a factor (inertial.scheme gpif)",
    )
    imu_scale_sigma: float = Field(0.01, gt=0.0, description="how far a scale factor may be off, 1 is 100 %")
    imu_misalignment_sigma: float = Field(
        0.007, gt=0.0, description="how much of an axis another one may see, 1 is 100 % (so radians)"
    )
    imu_scale_walk: float = Field(
        1e-5, ge=0.0, description="how scale factors and misalignment may drift, 1/sqrt(s)"
    )


class OptimizerConfig(_Section):
    """Levenberg-Marquardt."""

    max_iterations: int = Field(4, ge=1, description="per knot while tracking")
    initial_max_iterations: int = Field(12, ge=1, description="for the joint optimisation at the start")
    relative_decrease: float = Field(
        1e-2, gt=0.0, description="stop when the cost falls by less than this, or just as the model foretold"
    )
    initial_relative_decrease: float = Field(1e-5, gt=0.0, description="the same, at the start")
    initial_damping: float = Field(
        1e-9,
        gt=0.0,
        description="relative to the diagonal, after the first refused step; scale is a soft direction "
        "among stiff ones, and 1e-6 already stops it",
    )


class InitializationConfig(_Section):
    """Start from the data alone."""

    min_seconds: float = Field(1.0, gt=0.0, description="shortest span tried")
    max_seconds: float = Field(4.0, gt=0.0, description="longest span tried; what is older is dropped")
    min_landmarks: int = Field(15, ge=4)
    max_scale_sigma: float = Field(0.1, gt=0.0, description="largest relative standard deviation of scale")


class HealthConfig(_Section):
    """When the estimator calls itself degraded or lost; what does not depend on the rig is in `health`."""

    max_visual_gap_s: float = Field(0.1, gt=0.0, description="degraded when no observation came for longer")
    max_inertial_gap_s: float = Field(
        0.05, gt=0.0, description="degraded when a sensor of the IMU paused longer"
    )
    lost_inertial_gap_s: float = Field(
        0.5, gt=0.0, description="lost when it paused longer: nothing ties the poses across"
    )
    patience_s: float = Field(
        1.0,
        ge=0.0,
        description="lost when measurements contradict the estimate, or it is useless, for so long",
    )
    recovery_s: float = Field(0.5, ge=0.0, description="without complaint until degraded becomes tracking")
    max_speed: float = Field(30.0, gt=0.0, description="m/s; lost beyond")
    max_velocity_sigma: float = Field(1.0, gt=0.0, description="m/s; an estimate known no better is useless")
    max_tilt_sigma_deg: float = Field(5.0, gt=0.0, description="the same for roll and pitch")


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
        base: sections of values that go before the defaults and after the file.

    Raises:
        ConfigError: the file is missing, is not a mapping, or holds an unknown key or a wrong value.
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
    """The resolved configuration as YAML, every key written out."""
    return yaml.safe_dump(config.model_dump(), sort_keys=False)


def _read(path: Path) -> dict[Any, Any]:
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            f"cannot read the configuration {path}: {error.strerror}; check the path"
        ) from error
    except Exception as error:
        # PyYAML's constructors let IndexError, ValueError, RecursionError and others out.
        raise ConfigError(
            f"{path} is not valid YAML: {' '.join(str(error).split())[:200]}; "
            "expected sections with settings, as in config.yaml of a run"
        ) from error
    if raw is None:
        return {}
    if not isinstance(raw, dict):
        raise ConfigError(f"{path} holds a {type(raw).__name__}; expected a mapping of sections")
    return raw


def _explained(location: tuple[str, ...], kind: str, message: str) -> str:
    """One complaint; an unknown key with the nearest that is known, here or in another section."""
    where = ".".join(location)
    if kind != "extra_forbidden":
        return f"{where}: {message}"
    sections = {name: tuple(type(section).model_fields) for name, section in Config()}
    known = sections.get(location[0], ()) if len(location) > 1 else tuple(sections)
    elsewhere = [f"{name}.{location[-1]}" for name, fields in sections.items() if location[-1] in fields]
    close = elsewhere or difflib.get_close_matches(location[-1], known, n=1, cutoff=0.5)
    meant = f"did you mean {close[0]}?" if close else f"expected one of {', '.join(known)}"
    return f"{where} is no setting; {meant}"


def differences(first: Config, second: Config) -> dict[str, tuple[Any, Any]]:
    """Settings that differ: `section.name`, and both values."""
    return {
        f"{name}.{key}": (value, getattr(getattr(second, name), key))
        for name, section in first
        for key, value in section
        if value != getattr(getattr(second, name), key)
    }
