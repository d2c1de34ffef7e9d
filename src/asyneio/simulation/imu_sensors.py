# SPDX-License-Identifier: Apache-2.0
"""Inertial sensors by name, with the errors given by their data sheets and by recordings.

Data sheets give tolerances. A bound (min, max) is interpreted as three standard deviations, a typical value
as one (as defined by Bosch Sensortec: "1 sigma", and "3 sigma" for min and max). `sources` lists the source
of each value; "assumed" marks values without a source.

Camera and IMU are calibrated with the gyroscope, so its axes are the body axes, and its delay is contained in
the calibration's time shift (see `asyneio.simulation.rig`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from asyneio.cameras import MPU6150_NOISE, PRESETS
from asyneio.errors import SimulationError
from asyneio.simulation.imu_errors import StreamErrors
from asyneio.types import ImuNoise

#: Noise of a typical inexpensive MEMS unit.
MEMS_NOISE = ImuNoise(
    gyroscope_density=5e-4,
    accelerometer_density=5e-3,
    gyroscope_walk=2e-5,
    accelerometer_walk=5e-4,
)

_G = 9.80665
_DEG = float(np.pi / 180.0)
_NONE = StreamErrors()


@dataclass(frozen=True)
class ImuSensor:
    """An IMU model.

    Attributes:
        name: name of the model.
        noise: densities and walks, which its calibration declares too.
        gyroscope, accelerometer: errors of the streams [rad/s], [m/s^2].
        gyroscope_bias_sigma, accelerometer_bias_sigma: standard deviations of the initial bias [rad/s],
            [m/s^2].
        warming_k: final increase of the temperature [K].
        warming_s: time constant of the warming [s].
        sources: sources of the values.
    """

    name: str
    noise: ImuNoise
    gyroscope: StreamErrors = _NONE
    accelerometer: StreamErrors = _NONE
    gyroscope_bias_sigma: float = 0.01
    accelerometer_bias_sigma: float = 0.05
    warming_k: float = 2.0
    warming_s: float = 300.0
    sources: Mapping[str, str] = field(default_factory=dict, hash=False)


#: White noise and a random-walk bias only.
IDEAL_IMU = ImuSensor("ideal", MEMS_NOISE, sources={"noise": "assumed: an inexpensive MEMS unit"})

_WARM = "assumed: a camera that is nearly warm and warms by another 2 K with a time constant of 300 s"

_MPU6150 = ImuSensor(
    "MPU-6150",
    MPU6150_NOISE,
    StreamErrors(
        full_scale=32768 / 16.4 * _DEG,
        quantum=_DEG / 16.4,
        bandwidth_hz=188.0,
        order=3,
        delay_s=1.9e-3,
        scale_sigma=0.03 / 3.0,
        misalignment_sigma=0.02 / 3.0,
        g_sensitivity_sigma=0.1 * _DEG / _G,
        temperature_sigma=20.0 * _DEG / 65.0 / 3.0,
    ),
    StreamErrors(
        full_scale=16.0 * _G,
        quantum=_G / 2048.0,
        bandwidth_hz=184.0,
        delay_s=2.0e-3,
        scale_sigma=0.03 / 3.0,
        misalignment_sigma=0.02 / 3.0,
        temperature_sigma=35e-3 * _G / 45.0 / 3.0,
    ),
    gyroscope_bias_sigma=20.0 * _DEG / 3.0,
    accelerometer_bias_sigma=60e-3 * _G / 3.0,
    sources={
        "electrical": "MPU-6000/MPU-6050 product specification PS-MPU-6000A-00 rev. 3.4, sections 6.1 and "
        "6.2, whose die the MPU-6150 has: scale +-3 %, cross-axis +-2 %, 0.1 deg/s/g (typical), 16.4 "
        "LSB/(deg/s), 2048 LSB/g; zero rate +-20 deg/s at 25 degrees C and +-20 deg/s over -40 to 85 "
        "(65 K from the middle); zero g +-50 mg (x, y), +-80 mg (z), taken as +-60 mg, +-35 mg over 0 "
        "to 70",
        "range and quantum": "+-2000 deg/s and +-16 g: measured on shapes_rotation of the UZH data set, "
        "whose readings are in steps of 1.065e-3 rad/s and 4.790e-3 m/s^2 and reach 13.1 rad/s and 22.2 "
        "m/s^2",
        "filter": "register map RM-MPU-6000A-00 rev. 4.2, section 4.3, setting 1 (188 Hz and 1.9 ms, 184 Hz "
        "and 2.0 ms), the default of libcaer. Orders: noise in shapes_rotation falls off between 80 and "
        "400 Hz as with a filter of third order (gyroscope) and of second (accelerometer)",
        "noise": "section 6.1 and 6.2: 0.005 deg/s/sqrt(Hz), 400 ug/sqrt(Hz). In shapes_rotation it is 8e-5 "
        "rad/s/sqrt(Hz) and, less than half of what the sheet says, 1.6e-3 m/s^2/sqrt(Hz)",
        "time shift": "stamps late by 2 to 3 ms in shapes_rotation: the delay of the filter and of the "
        "transfer, which are in the calibration's time shift",
        "warming": _WARM,
    },
)

_MPU6500 = ImuSensor(
    "MPU-6500",
    PRESETS["DAVIS346"].noise or MEMS_NOISE,
    StreamErrors(
        full_scale=32768 / 16.4 * _DEG,
        quantum=_DEG / 16.4,
        bandwidth_hz=184.0,
        delay_s=2.9e-3,
        scale_sigma=0.03 / 3.0,
        misalignment_sigma=0.02 / 3.0,
        g_sensitivity_sigma=0.1 * _DEG / _G,
        temperature_sigma=0.24 * _DEG / 3.0,
    ),
    StreamErrors(
        full_scale=16.0 * _G,
        quantum=_G / 2048.0,
        bandwidth_hz=218.1,
        delay_s=1.88e-3,
        scale_sigma=0.03 / 3.0,
        misalignment_sigma=0.02 / 3.0,
        temperature_sigma=0.64e-3 * _G / 3.0,
    ),
    gyroscope_bias_sigma=5.0 * _DEG / 3.0,
    accelerometer_bias_sigma=60e-3 * _G / 3.0,
    sources={
        "electrical": "assumed, in the order of product specification PS-MPU-6500A-01, whose table was not "
        "at hand: +-3 %, +-2 %, +-5 deg/s, 0.24 deg/s/K, +-60 mg, 0.64 mg/K; g-sensitivity of the "
        "MPU-6050",
        "quantum": "16.4 LSB/(deg/s) at +-2000 deg/s (PS-MPU-6500A-01, page 9, by drivers that cite it)",
        "filter": "register map of the MPU-9250, whose inertial die is the MPU-6500: settings 1 (184 Hz, "
        "2.9 ms; 218.1 Hz, 1.88 ms)",
        "warming": _WARM,
    },
)

_BMI160 = ImuSensor(
    "BMI160",
    PRESETS["DVXplorer"].noise or MEMS_NOISE,
    StreamErrors(
        full_scale=2000.0 * _DEG,
        quantum=2000.0 * _DEG / 32768.0,
        bandwidth_hz=254.6,
        scale_sigma=0.01,
        misalignment_sigma=0.02 / 3.0,
        g_sensitivity_sigma=0.1 * _DEG / _G / 3.0,
        temperature_sigma=0.08 * _DEG,
    ),
    StreamErrors(
        full_scale=16.0 * _G,
        quantum=16.0 * _G / 32768.0,
        bandwidth_hz=254.6,
        scale_sigma=0.005,
        misalignment_sigma=0.01 / 3.0,
        temperature_sigma=1.0e-3 * _G,
    ),
    gyroscope_bias_sigma=3.0 * _DEG,
    accelerometer_bias_sigma=40e-3 * _G,
    sources={
        "noise": "README of iniVation's dv-imu-cam-calibration (see the preset DVXplorer)",
        "zero": "product data of the BMI160 (BST-BMI160-DS000): zero rate +-3 deg/s typical (+-10 at most), "
        "0.08 deg/s/K; zero g +-40 mg typical, 1.0 mg/K",
        "scale, cross-axis, g-sensitivity": "assumed, in the order of the BMI088",
        "filter": "assumed: 254.6 Hz, the widest at a rate of 800 Hz",
        "warming": _WARM,
    },
)

_ADIS16448 = ImuSensor(
    "ADIS16448",
    ImuNoise(
        gyroscope_density=0.0135 * _DEG,
        accelerometer_density=0.23e-3 * _G,
        gyroscope_walk=1.9393e-5,
        accelerometer_walk=3.0e-3,
    ),
    StreamErrors(
        full_scale=1000.0 * _DEG,
        quantum=0.04 * _DEG,
        bandwidth_hz=330.0,
        scale_sigma=0.01 / 3.0,
        misalignment_sigma=0.05 * _DEG,
        g_sensitivity_sigma=0.015 * _DEG / _G,
        temperature_sigma=0.005 * _DEG,
    ),
    StreamErrors(
        full_scale=18.0 * _G,
        quantum=0.833e-3 * _G,
        bandwidth_hz=330.0,
        scale_sigma=0.01 / 3.0,
        misalignment_sigma=0.2 * _DEG,
        temperature_sigma=0.15e-3 * _G,
    ),
    gyroscope_bias_sigma=0.5 * _DEG,
    accelerometer_bias_sigma=20e-3 * _G,
    sources={
        "noise": "data sheet ADIS16448 rev. H, table 1: 0.0135 deg/s/sqrt(Hz) and 0.23 mg/sqrt(Hz); walks "
        "of EuRoC's imu0/sensor.yaml",
        "zero rate": "data sheet rev. H, table 1: bias repeatability 0.5 deg/s (1 sigma). EuRoC's V1_01 has "
        "0.08 rad/s, nine times that",
        "quantum": "measured on EuRoC V1_01: 6.98e-4 rad/s (0.04 deg/s) and 8.17e-3 m/s^2 (0.833 mg)",
        "scale, misalignment, g-sensitivity, temperature, zero g, bandwidth": "assumed: of a unit "
        "calibrated at the factory; 0.015 deg/s/g is the ADIS16445's",
        "warming": _WARM,
    },
)

_BMI085 = ImuSensor(
    "BMI085",
    ImuNoise(
        gyroscope_density=0.014 * _DEG,
        accelerometer_density=135e-6 * _G,
        gyroscope_walk=2e-5,
        accelerometer_walk=5e-4,
    ),
    StreamErrors(
        full_scale=2000.0 * _DEG,
        quantum=2000.0 * _DEG / 32768.0,
        bandwidth_hz=116.0,
        scale_sigma=0.01 / 3.0,
        misalignment_sigma=0.01 / 3.0,
        g_sensitivity_sigma=0.1 * _DEG / _G / 3.0,
        temperature_sigma=0.015 * _DEG,
    ),
    StreamErrors(
        full_scale=16.0 * _G,
        quantum=16.0 * _G / 32768.0,
        bandwidth_hz=145.0,
        scale_sigma=0.004,
        misalignment_sigma=0.005 / 3.0,
        temperature_sigma=0.2e-3 * _G,
    ),
    gyroscope_bias_sigma=1.0 * _DEG,
    accelerometer_bias_sigma=20e-3 * _G,
    sources={
        "noise": "data sheet BST-BMI085-DS001: 0.014 deg/s/sqrt(Hz), 135 ug/sqrt(Hz) (z, the noisiest "
        "axis); walks assumed",
        "zero, temperature, g-sensitivity": "BST-BMI088-DS001, electrical specification (same family): +-1 "
        "deg/s, 0.015 deg/s/K, +-20 mg, 0.2 mg/K (typical), 0.1 deg/s/g at most",
        "scale, cross-axis": "assumed: +-1 % and 1 % of the gyroscope, 0.4 % and 0.5 % of the accelerometer",
        "filter": "assumed: 116 Hz (gyroscope at 1000 Hz) and 145 Hz (accelerometer at 400 Hz)",
        "warming": _WARM,
    },
)

#: IMU models by name.
IMU_SENSORS: dict[str, ImuSensor] = {
    sensor.name: sensor for sensor in (IDEAL_IMU, _MPU6150, _MPU6500, _BMI160, _ADIS16448, _BMI085)
}


def imu_named(name: str) -> ImuSensor:
    """The IMU model of a name; case and hyphens are ignored.

    Raises:
        SimulationError: the name is unknown.
    """
    plain = {key.lower().replace("-", ""): sensor for key, sensor in IMU_SENSORS.items()}
    found = plain.get(name.lower().replace("-", ""))
    if found is None:
        raise SimulationError(f"IMU {name!r} is unknown; expected one of {', '.join(IMU_SENSORS)}")
    return found
