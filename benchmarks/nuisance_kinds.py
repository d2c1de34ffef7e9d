"""Nuisances: errors of the IMU, of the calibration and of the pixels, each a change of a sequence with an
ideal IMU.

`KINDS` lists them. A `mild` kind is the mildest of its sort, and part of the combination `all_mild`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.cameras import MPU6150_NOISE
from asyneio.simulation import IDEAL_IMU, IMU_SENSORS, EventScenario, Vibration, with_imu
from asyneio.simulation.imu_errors import StreamErrors
from asyneio.types import EVENT_DTYPE, NS_PER_S, Calibration, RecordArray

ScenarioChange = Callable[[EventScenario], EventScenario]
CalibrationChange = Callable[[Calibration], Calibration]
EventChange = Callable[[RecordArray, EventScenario], RecordArray]

#: The ideal IMU: white noise and bias walk of the MPU-6150, and biases as after a warm-up.
BASE_IMU = replace(IDEAL_IMU, noise=MPU6150_NOISE, gyroscope_bias_sigma=0.01, accelerometer_bias_sigma=0.08)
_MPU6150 = IMU_SENSORS["MPU-6150"]
#: Vibration of rotors: first and second harmonic with equal amplitudes.
_ROTOR_HZ = 87.0


@dataclass(frozen=True)
class Nuisance:
    """A change of a sequence.

    Attributes:
        name, title: name for the command line, and name in tables.
        scenario: change of IMU and vibration; it does not affect the events.
        calibration: change of the calibration given to the estimator.
        events: change of the events (EVENT_DTYPE, camera clock).
        config: settings of the run.
        mild: whether it is the mildest of its sort.
    """

    name: str
    title: str
    scenario: ScenarioChange | None = None
    calibration: CalibrationChange | None = None
    events: EventChange | None = None
    config: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    mild: bool = False


def _errors(gyroscope: Mapping[str, Any], accelerometer: Mapping[str, Any]) -> ScenarioChange:
    """Errors of both streams, in addition to those of the scenario."""

    def change(scenario: EventScenario) -> EventScenario:
        imu = scenario.imu
        imu = replace(
            imu,
            gyroscope=replace(imu.gyroscope, **gyroscope),
            accelerometer=replace(imu.accelerometer, **accelerometer),
        )
        return replace(scenario, imu=imu)

    return change


def _some(names: tuple[str, ...]) -> ScenarioChange:
    """Some of the errors of the MPU-6150."""

    def chosen(errors: StreamErrors) -> dict[str, Any]:
        return {name: getattr(errors, name) for name in names}

    return _errors(chosen(_MPU6150.gyroscope), chosen(_MPU6150.accelerometer))


def _both(**errors: Any) -> ScenarioChange:
    return _errors(errors, errors)


def _sensor(name: str, rate_hz: float = 1000.0) -> ScenarioChange:
    return lambda scenario: replace(
        with_imu(scenario, IMU_SENSORS[name]), gyroscope_rate_hz=rate_hz, accelerometer_rate_hz=rate_hz
    )


def _turn_on(scenario: EventScenario) -> EventScenario:
    return replace(
        scenario,
        initial_gyroscope_bias_sigma=_MPU6150.gyroscope_bias_sigma,
        initial_accelerometer_bias_sigma=_MPU6150.accelerometer_bias_sigma,
    )


def _warming(scenario: EventScenario) -> EventScenario:
    """A cold start: 15 K with a time constant of a minute."""
    warmed = _some(("temperature_sigma",))(scenario)
    return replace(warmed, imu=replace(warmed.imu, warming_k=15.0, warming_s=60.0))


def _vibration(acceleration: float, rate: float) -> ScenarioChange:
    shaken = Vibration(_ROTOR_HZ, (acceleration, acceleration), (rate, rate))
    return lambda scenario: replace(scenario, vibration=shaken)


def _turned(degrees: float) -> CalibrationChange:
    """The camera rotated about an axis unrelated to the motion."""

    def change(calibration: Calibration) -> Calibration:
        T_b_c = calibration.T_b_c.copy()
        turn = Rotation.from_rotvec(np.full(3, np.deg2rad(degrees) / np.sqrt(3.0)))
        T_b_c[:3, :3] = T_b_c[:3, :3] @ turn.as_matrix()
        return replace(calibration, T_b_c=T_b_c)

    return change


def _moved(metres: float) -> CalibrationChange:
    def change(calibration: Calibration) -> Calibration:
        T_b_c = calibration.T_b_c.copy()
        T_b_c[:3, 3] += metres / np.sqrt(3.0)
        return replace(calibration, T_b_c=T_b_c)

    return change


def _longer(share: float) -> CalibrationChange:
    def change(calibration: Calibration) -> Calibration:
        camera = calibration.camera
        camera = replace(camera, fx=camera.fx * (1.0 + share), fy=camera.fy * (1.0 + share))
        return replace(calibration, camera=camera)

    return change


def _late(milliseconds: float) -> CalibrationChange:
    return lambda calibration: replace(
        calibration, timeshift_ns=calibration.timeshift_ns + round(milliseconds * 1e6)
    )


def _rng(scenario: EventScenario, kind: int) -> np.random.Generator:
    return np.random.default_rng([scenario.seed, 80, kind])


def _dropped(share: float) -> EventChange:
    return lambda events, scenario: events[_rng(scenario, 0).random(events.size) >= share]


def _added(events: RecordArray, t_ns: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> RecordArray:
    more = np.zeros(t_ns.size, dtype=EVENT_DTYPE)
    more["t_ns"], more["x"], more["y"], more["p"] = t_ns, x, y, p
    merged = np.concatenate([events, more])
    return merged[np.argsort(merged["t_ns"], kind="stable")]


def _noise(hertz: float) -> EventChange:
    """Noise events with the same rate for every pixel."""

    def change(events: RecordArray, scenario: EventScenario) -> RecordArray:
        rng, camera = _rng(scenario, 1), scenario.camera
        count = rng.poisson(hertz * camera.width * camera.height * scenario.duration_s)
        t_ns = rng.integers(events["t_ns"][0], events["t_ns"][-1], count)
        x, y = rng.integers(0, camera.width, count), rng.integers(0, camera.height, count)
        return _added(events, t_ns, x, y, rng.integers(0, 2, count))

    return change


def _hot_pixels(pixels: int, hertz: float) -> EventChange:
    def change(events: RecordArray, scenario: EventScenario) -> RecordArray:
        rng, camera = _rng(scenario, 2), scenario.camera
        place = rng.choice(camera.width * camera.height, pixels, replace=False)
        which = rng.integers(0, pixels, rng.poisson(pixels * hertz * scenario.duration_s))
        t_ns = rng.integers(events["t_ns"][0], events["t_ns"][-1], which.size)
        y, x = np.divmod(place[which], camera.width)
        return _added(events, t_ns, x, y, np.ones(which.size, dtype=np.int64))

    return change


def _flicker(hertz: float, share: float, spread_s: float = 1e-3) -> EventChange:
    """A lamp: at every rise of its light, a random share of the pixels emits an ON event, and at the fall an
    OFF event.

    This is a model of events only; the simulator has its own model of pixels under a flickering lamp.
    """

    def change(events: RecordArray, scenario: EventScenario) -> RecordArray:
        rng, camera = _rng(scenario, 3), scenario.camera
        first, last = int(events["t_ns"][0]), int(events["t_ns"][-1])
        turns = np.arange(first, last, 0.5 * NS_PER_S / hertz)
        each = round(share * camera.width * camera.height)
        t_ns = np.repeat(turns, each) + rng.normal(0.0, spread_s * NS_PER_S, turns.size * each)
        x, y = rng.integers(0, camera.width, t_ns.size), rng.integers(0, camera.height, t_ns.size)
        on = np.repeat(np.arange(turns.size) % 2, each)
        return _added(events, np.clip(t_ns, first, last).astype(np.int64), x, y, on)

    return change


_IMU_KINDS = (
    Nuisance("quantised", "range and resolution of the MPU-6150", _some(("full_scale", "quantum"))),
    Nuisance("filtered", "low-pass filters of the MPU-6150", _some(("bandwidth_hz", "order", "delay_s"))),
    Nuisance(
        "held",
        "accelerometer updated at a third of its rate",
        _errors({}, {"update_rate_hz": 1000.0 / 3.0}),
        mild=True,
    ),
    Nuisance(
        "scale",
        "scale 1 %, cross-axis 0.7 % (MPU-6150)",
        _some(("scale_sigma", "misalignment_sigma")),
    ),
    Nuisance("g_sensitivity", "0.1 deg/s/g", _some(("g_sensitivity_sigma",))),
    Nuisance("turn_on_bias", "biases of 0.12 rad/s and 0.2 m/s^2", _turn_on),
    Nuisance("warming", "15 K warmer in a minute", _warming, mild=True),
    Nuisance("jitter", "stamps off by 0.2 ms", _both(stamp_jitter_s=2e-4), mild=True),
    Nuisance("lost", "5 % of the samples lost", _both(lost_share=0.05), mild=True),
    Nuisance("mpu6150", "MPU-6150", _sensor("MPU-6150"), mild=True),
    Nuisance("mpu6500", "MPU-6500", _sensor("MPU-6500")),
    Nuisance("bmi160", "BMI160", _sensor("BMI160")),
    Nuisance("adis16448", "ADIS16448 at 200 Hz", _sensor("ADIS16448", 200.0)),
    Nuisance("bmi085", "BMI085", _sensor("BMI085")),
    Nuisance("vibration_low", "1 m/s^2, 0.05 rad/s at 87 and 174 Hz", _vibration(1.0, 0.05), mild=True),
    Nuisance("vibration", "3 m/s^2, 0.15 rad/s at 87 and 174 Hz", _vibration(3.0, 0.15)),
    Nuisance("vibration_high", "10 m/s^2, 0.5 rad/s at 87 and 174 Hz", _vibration(10.0, 0.5)),
)
_CALIBRATION_KINDS = (
    Nuisance("turned_1", "camera rotated by 1 degree", calibration=_turned(1.0), mild=True),
    Nuisance("turned_3", "camera rotated by 3 degrees", calibration=_turned(3.0)),
    Nuisance(
        "turned_3_not_estimated",
        "camera rotated by 3 degrees, rotation not estimated",
        calibration=_turned(3.0),
        config={"calibration": {"estimate_extrinsic_rotation": False}},
    ),
    Nuisance("moved", "camera moved by 2 cm", calibration=_moved(0.02), mild=True),
    Nuisance("focal", "focal length 1 % too long", calibration=_longer(0.01), mild=True),
    Nuisance("late_5", "time shift off by 5 ms", calibration=_late(5.0), mild=True),
    Nuisance("late_15", "time shift off by 15 ms", calibration=_late(15.0)),
)
_EVENT_KINDS = (
    Nuisance("dropped", "40 % of the events lost", events=_dropped(0.4), mild=True),
    Nuisance("noise", "5 noise events per pixel and second", events=_noise(5.0), mild=True),
    Nuisance("hot_pixels", "100 pixels with 1000 events/s", events=_hot_pixels(100, 1000.0), mild=True),
    Nuisance("flicker", "lamp at 100 Hz, 2 % of the pixels", events=_flicker(100.0, 0.02), mild=True),
)


def _all_mild(kinds: tuple[Nuisance, ...], name: str, title: str) -> Nuisance:
    """The mild ones of some kinds together."""
    mild = [kind for kind in kinds if kind.mild]
    # The complete sensor first, because it replaces the errors that the others extend.
    mild.sort(key=lambda kind: kind.name != "mpu6150")

    def scenario(given: EventScenario) -> EventScenario:
        for kind in mild:
            given = kind.scenario(given) if kind.scenario else given
        return given

    def calibration(given: Calibration) -> Calibration:
        for kind in mild:
            given = kind.calibration(given) if kind.calibration else given
        return given

    def events(given: RecordArray, of: EventScenario) -> RecordArray:
        for kind in mild:
            given = kind.events(given, of) if kind.events else given
        return given

    return Nuisance(name, title, scenario, calibration, events)


_SINGLE = (*_IMU_KINDS, *_CALIBRATION_KINDS, *_EVENT_KINDS)
#: Reference of all comparisons.
UNDISTURBED = Nuisance("undisturbed", "undisturbed")
#: All nuisances by name, the undisturbed run first.
KINDS: dict[str, Nuisance] = {
    kind.name: kind
    for kind in (
        UNDISTURBED,
        *_SINGLE,
        _all_mild(_EVENT_KINDS, "events_mild", "all mild ones of the pixels"),
        _all_mild(_SINGLE, "all_mild", "all mild ones together"),
    )
}
