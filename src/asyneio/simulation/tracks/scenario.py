# SPDX-License-Identifier: Apache-2.0
"""Scenarios: the parameters common to all simulated runs, those of track simulations, and predefined ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.imu import StreamSpec
from asyneio.simulation.imu_sensors import IDEAL_IMU, ImuSensor, imu_named
from asyneio.simulation.imu_sensors import MEMS_NOISE as MEMS_NOISE
from asyneio.simulation.tracks.observations import TrackSpec
from asyneio.simulation.vibration import Vibration
from asyneio.types import CameraIntrinsics, Distortion, FloatArray, ImuNoise

#: Intrinsics published with a DAVIS240C data set (Mueggler et al. 2017).
DAVIS240C = CameraIntrinsics(
    fx=199.0924,
    fy=198.8288,
    cx=132.1921,
    cy=110.7127,
    width=240,
    height=180,
    distortion=Distortion.RADTAN,
    coefficients=(-0.368436, 0.150947, -0.00029613, -0.00075943),
)

_DEFAULT_TRACKS = TrackSpec()
#: The available sensor with the smallest errors and independent streams.
_DEFAULT_IMU = imu_named("BMI085")

#: An IMU without noise.
NOISE_FREE = ImuNoise(0.0, 0.0, 0.0, 0.0)


def davis240c_T_b_c() -> FloatArray:
    """Camera pose in the IMU (4,4) of that DAVIS240C, orthonormalised because only six decimals are
    published."""
    T_b_c = np.array(
        [
            [0.999905, -0.012237, 0.006325, 0.006747],
            [0.012178, 0.999882, 0.009359, 0.000728],
            [-0.006438, -0.009281, 0.999936, 0.034257],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
    U, _, Vt = np.linalg.svd(T_b_c[:3, :3])
    T_b_c[:3, :3] = U @ Vt
    return T_b_c


@dataclass(frozen=True)
class RigScenario:
    """Parameters common to all simulated runs, in seconds, hertz and metres.

    `motion` is a value of `MotionStyle`. `seed` determines all random parts, each of which has its own
    generator. `*_offset_s` is the time of a stream's first sample. `t_imu = t_cam + timeshift_ns`, which
    contains the delay of the gyroscope's filter. `pause_s` is the beginning and end of a stationary phase.

    `imu` contains the errors of the sensor except noise and initial bias, which are given by `noise` and
    `initial_*_bias_sigma`; `with_imu` sets them all. `vibration` affects the IMU but not the events.
    """

    name: str = "moderate"
    motion: str = "moderate"
    duration_s: float = 20.0
    seed: int = 0
    start_ns: int = 1_600_000_000_000_000_000
    camera: CameraIntrinsics = DAVIS240C
    T_b_c: FloatArray = field(default_factory=davis240c_T_b_c)
    timeshift_ns: int = 2_400_000
    imu: ImuSensor = _DEFAULT_IMU
    noise: ImuNoise = _DEFAULT_IMU.noise
    gyroscope_rate_hz: float = 1000.0
    gyroscope_offset_s: float = 0.0
    accelerometer_rate_hz: float = 190.0
    accelerometer_offset_s: float = 0.0017
    initial_gyroscope_bias_sigma: float = _DEFAULT_IMU.gyroscope_bias_sigma
    initial_accelerometer_bias_sigma: float = _DEFAULT_IMU.accelerometer_bias_sigma
    vibration: Vibration | None = None
    gravity: float = 9.81
    ground_truth_rate_hz: float = 200.0
    pause_s: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        # Written so that NaN is rejected too.
        if not (0.0 < self.duration_s <= _LONGEST_S and self.ground_truth_rate_hz > 0.0):
            raise SimulationError(
                f"duration_s = {self.duration_s}, ground_truth_rate_hz = {self.ground_truth_rate_hz}; "
                f"expected both positive, and at most {_LONGEST_S:g} s (a day)"
            )

    @property
    def gyroscope(self) -> StreamSpec:
        """The gyroscope's stream [rad/s]."""
        return StreamSpec(
            self.gyroscope_rate_hz,
            self.gyroscope_offset_s,
            self.noise.gyroscope_density,
            self.noise.gyroscope_walk,
            self.initial_gyroscope_bias_sigma,
        )

    @property
    def accelerometer(self) -> StreamSpec:
        """The accelerometer's stream [m/s^2]."""
        return StreamSpec(
            self.accelerometer_rate_hz,
            self.accelerometer_offset_s,
            self.noise.accelerometer_density,
            self.noise.accelerometer_walk,
            self.initial_accelerometer_bias_sigma,
        )


_LONGEST_S = 86_400.0


_Some = TypeVar("_Some", bound=RigScenario)


def with_imu(scenario: _Some, imu: ImuSensor) -> _Some:
    """The scenario with another IMU: its errors, noise and standard deviations of biases."""
    return replace(
        scenario,
        imu=imu,
        noise=imu.noise,
        initial_gyroscope_bias_sigma=imu.gyroscope_bias_sigma,
        initial_accelerometer_bias_sigma=imu.accelerometer_bias_sigma,
    )


@dataclass(frozen=True)
class Scenario(RigScenario):
    """One simulated run of feature tracks. The pixel noise does not affect motion, scene and IMU.

    `scene` is a value of `SceneKind` with `landmarks` points. `motion_scale` is a factor on the positions of
    the motion; 0 gives a pure rotation. `camera_offset_s` is the beginning of the first track.
    """

    scene: str = "room"
    landmarks: int = 3000
    tracks: TrackSpec = _DEFAULT_TRACKS
    camera_offset_s: float = 0.05
    motion_scale: float = 1.0


_DEFAULT = Scenario()
_SYNCHRONOUS = replace(
    _DEFAULT,
    name="synchronous_imu",
    gyroscope_rate_hz=200.0,
    accelerometer_rate_hz=200.0,
    accelerometer_offset_s=0.0,
)

#: Predefined scenarios by name; change them with `dataclasses.replace`.
SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        _DEFAULT,
        replace(_DEFAULT, name="gentle", motion="gentle"),
        replace(_DEFAULT, name="aggressive", motion="aggressive"),
        replace(_DEFAULT, name="rotation", motion="rotation"),
        replace(_DEFAULT, name="static_start", motion="static_start"),
        replace(_DEFAULT, name="plane", motion="gentle", scene="plane"),
        replace(_DEFAULT, name="near_far", scene="near_far"),
        replace(_DEFAULT, name="outliers", tracks=TrackSpec(outlier_fraction=0.05)),
        replace(_DEFAULT, name="moving_object", tracks=TrackSpec(moving_share=1.0 / 3.0)),
        _SYNCHRONOUS,
        replace(
            _DEFAULT,
            name="noise_free",
            imu=IDEAL_IMU,
            noise=NOISE_FREE,
            tracks=TrackSpec(pixel_sigma=0.0),
            initial_gyroscope_bias_sigma=0.0,
            initial_accelerometer_bias_sigma=0.0,
        ),
    )
}
