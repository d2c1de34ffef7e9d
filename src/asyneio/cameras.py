# SPDX-License-Identifier: Apache-2.0
"""Camera models by name, with published values and their sources.

A preset provides values that no file contains: sensor size, noise of the built-in IMU and, for the one camera
with published values, intrinsics, extrinsics and time shift. Unpublished values are None. iniVation cameras
have no extrinsic rotation here: the documentation (docs.inivation.com, hardware, advanced usage, IMU) says
that the IMU has the axes of the image sensor, but describes a left-handed frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from asyneio.errors import ConfigError
from asyneio.types import CameraIntrinsics, Distortion, FloatArray, ImuNoise


@dataclass(frozen=True)
class Preset:
    """Published values of a camera model; None where there are none.

    Attributes:
        name: key of the preset.
        title: name for people.
        size: width and height of the sensor [px].
        noise: of the built-in IMU.
        intrinsics: of one unit, with its extrinsics `T_b_c` (4,4), camera to body, and `timeshift_ns`.
        sources: source of each value.
        missing: why there are no extrinsics, and what to do.
        settings: settings that this camera needs, by section of the configuration.
    """

    name: str
    title: str
    size: tuple[int, int]
    noise: ImuNoise | None = None
    intrinsics: CameraIntrinsics | None = None
    T_b_c: FloatArray | None = None
    timeshift_ns: int | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    missing: str = ""
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


#: Noise of the MPU-6150, the IMU of the DAVIS240C. Densities from its data sheet, 0.005 deg/s/sqrt(Hz) and
#: 400 ug/sqrt(Hz); random walks, which the data sheet lacks, from PA-EVIO, a system for this camera.
MPU6150_NOISE = ImuNoise(
    gyroscope_density=8.7e-5,
    accelerometer_density=3.9e-3,
    gyroscope_walk=2.9e-5,
    accelerometer_walk=8e-4,
)

#: MPU-6500, data sheet PS-MPU-6500A-01 (unverified): 0.01 deg/s/sqrt(Hz), 300 ug/sqrt(Hz); walks as MPU-6150.
_MPU6500_NOISE = ImuNoise(
    gyroscope_density=1.75e-4,
    accelerometer_density=2.94e-3,
    gyroscope_walk=MPU6150_NOISE.gyroscope_walk,
    accelerometer_walk=MPU6150_NOISE.accelerometer_walk,
)

_BMI160_NOISE = ImuNoise(
    gyroscope_density=8.09e-5,
    accelerometer_density=1.49e-3,
    gyroscope_walk=2.29e-6,
    accelerometer_walk=8.69e-5,
)
_BMI160_SOURCE = "BMI160 of a DVXplorer, README of iniVation's dv-imu-cam-calibration"

_ULTIMATE_SLAM = "calibration/DAVIS-IJRR17.yaml of Ultimate SLAM (T_B_C of the data set's camera)"
_CALIBRATE = "calibrate camera and IMU together (Kalibr) and pass the file with --calibration"
_NOT_PUBLISHED = f"extrinsics differ between units and are not published: {_CALIBRATE}"

PRESETS: dict[str, Preset] = {
    preset.name: preset
    for preset in (
        Preset(
            "DAVIS240C",
            "DAVIS240C of the UZH event camera data set",
            (240, 180),
            MPU6150_NOISE,
            CameraIntrinsics(
                199.092366542, 198.82882047, 132.192071378, 110.712660011, 240, 180, Distortion.RADTAN,
                (-0.368436311798, 0.150947243557, -0.000296130534385, -0.000759431726241, 0.0),
            ),
            np.array(
                [
                    [0.999905117246, -0.0122374970355, 0.00632456886338, 0.00674696422488],
                    [0.0121780171243, 0.999882045134, 0.00935904469797, 0.0007279224709],
                    [-0.00643835413146, -0.00928113597812, 0.99993620202, 0.0342573613538],
                    [0.0, 0.0, 0.0, 1.0],
                ]
            ),
            2_400_000,
            {
                "noise": "data sheet of the MPU-6150 (densities), PA-EVIO (random walks)",
                "intrinsics": "calib.txt of the data set",
                "extrinsics": _ULTIMATE_SLAM,
                "time shift": "ijrr17.launch of Ultimate SLAM (delay of the IMU's low-pass filter)",
            },
        ),
        Preset(
            "DAVIS346",
            "iniVation DAVIS346",
            (346, 260),
            _MPU6500_NOISE,
            sources={
                "noise": "data sheet of the MPU-6500 (densities, unverified: check them); "
                "random walks of the MPU-6150 (PA-EVIO)"
            },
            missing=_NOT_PUBLISHED,
        ),
        Preset(
            "DVXplorer",
            "iniVation DVXplorer",
            (640, 480),
            _BMI160_NOISE,
            sources={"noise": _BMI160_SOURCE},
            missing=_NOT_PUBLISHED,
        ),
        Preset(
            "DVXplorer-Lite",
            "iniVation DVXplorer Lite",
            (320, 240),
            _BMI160_NOISE,
            sources={"noise": _BMI160_SOURCE},
            missing=_NOT_PUBLISHED,
        ),
        Preset(
            "EVK4",
            "Prophesee EVK4 (IMX636)",
            (1280, 720),
            missing=f"it has no IMU, so noise and extrinsics depend on yours: {_CALIBRATE}",
        ),
    )
}  # fmt: skip


def preset_named(name: str) -> Preset:
    """The preset with this name, in upper or lower case.

    Raises:
        ConfigError: the preset is unknown.
    """
    found = {key.lower(): preset for key, preset in PRESETS.items()}.get(name.lower())
    if found is None:
        raise ConfigError(f"preset {name!r} is unknown; expected one of {', '.join(PRESETS)}")
    return found
