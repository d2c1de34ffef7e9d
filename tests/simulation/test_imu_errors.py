"""What each error of a real IMU does to the readings, one at a time, against its definition."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import welch

from asyneio.errors import SimulationError
from asyneio.simulation import (
    EVENT_SCENARIOS,
    IDEAL_IMU,
    IMU_SENSORS,
    SCENARIOS,
    AnalyticMotion,
    ImuSensor,
    Scenario,
    Sinusoids,
    StreamErrors,
    Vibration,
    imu_named,
    with_imu,
)
from asyneio.simulation.imu import corrupt, draw_bias, sample_times, specific_force_b
from asyneio.simulation.imu_errors import StreamRandomness, draw_unit
from asyneio.simulation.imu_filter import sampled
from asyneio.simulation.rig import InertialRun, simulate_inertial
from asyneio.types import FloatArray, ImuNoise

NO_NOISE = ImuNoise(0.0, 0.0, 0.0, 0.0)
GRAVITY = 9.81
#: A gyroscope of an MPU-6150, and its accelerometer.
FILTERED = StreamErrors(bandwidth_hz=188.0, delay_s=1.9e-3)
LATER = StreamErrors(bandwidth_hz=184.0, delay_s=2.0e-3)


def at_rest() -> AnalyticMotion:
    """A body that lies still, tilted."""
    zero = np.zeros((6, 1))
    return AnalyticMotion(Sinusoids(zero, zero, zero, np.array([0.0, 0.0, 0.0, 0.3, -0.2, 1.0])))


def swaying(frequency_hz: float) -> AnalyticMotion:
    """A body that goes to and fro along x and turns to and fro about z, both by 0.2."""
    amplitude = np.zeros((6, 1))
    amplitude[[0, 5]] = 0.2
    return AnalyticMotion(Sinusoids(amplitude, np.full((6, 1), frequency_hz), np.zeros((6, 1))))


def run(
    gyroscope: StreamErrors | None = None,
    accelerometer: StreamErrors | None = None,
    motion: AnalyticMotion | None = None,
    **changes: object,
) -> InertialRun:
    """Four seconds of an IMU at 1 kHz with these errors and, unless changed, no noise."""
    imu = ImuSensor("test", NO_NOISE, gyroscope or StreamErrors(), accelerometer or StreamErrors())
    scenario = Scenario(
        imu=imu,
        noise=NO_NOISE,
        duration_s=4.0,
        start_ns=0,
        gravity=GRAVITY,
        accelerometer_rate_hz=1000.0,
        accelerometer_offset_s=0.0,
        initial_gyroscope_bias_sigma=0.0,
        initial_accelerometer_bias_sigma=0.0,
    )
    scenario = dataclasses.replace(scenario, **changes)  # type: ignore[arg-type]
    rngs = np.random.default_rng(11), np.random.default_rng(12)
    return simulate_inertial(scenario, motion or at_rest(), *rngs)


def amplitude_and_delay(t_s: FloatArray, values: FloatArray, hz: float) -> tuple[float, float]:
    """Of a sine of known frequency in samples (N,), by least squares; the delay is that of sin(2 pi f t)."""
    angle = 2.0 * np.pi * hz * t_s
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
    sine, cosine, _ = np.linalg.lstsq(columns, values)[0]
    return float(np.hypot(sine, cosine)), float(-np.arctan2(cosine, sine) / (2.0 * np.pi * hz))


def butterworth(hz: float, bandwidth_hz: float) -> float:
    """Gain of a filter of second order."""
    return float(1.0 / np.sqrt(1.0 + (hz / bandwidth_hz) ** 4))


def test_without_errors_it_is_the_ideal_sensor() -> None:
    scenario = dataclasses.replace(with_imu(SCENARIOS["moderate"], IDEAL_IMU), duration_s=2.0)
    motion = swaying(1.0)
    found = simulate_inertial(scenario, motion, np.random.default_rng(3), np.random.default_rng(4))
    for spec, seed, records in (
        (scenario.gyroscope, 3, found.gyroscope),
        (scenario.accelerometer, 4, found.accelerometer),
    ):
        t_ns = sample_times(spec, 2.0)
        ideal = (
            motion.angular_velocity_b(t_ns / 1e9)
            if seed == 3
            else specific_force_b(motion, t_ns / 1e9, scenario.gravity)
        )
        rng = np.random.default_rng(seed)
        expected = corrupt(ideal, t_ns, draw_bias(spec, t_ns, rng), spec, rng)
        np.testing.assert_array_equal(records["t_ns"], scenario.start_ns + t_ns)
        np.testing.assert_array_equal(records["xyz"], expected)


def test_noise_keeps_its_density_below_the_bandwidth_and_falls_off_above_it() -> None:
    density = 2e-3
    rng = np.random.default_rng(1)
    values = sampled(lambda t: np.zeros((t.size, 3)), 0.0, 1000.0, 200_000, FILTERED, density, rng)
    hz, power = welch(values, fs=1000.0, nperseg=1000, axis=0)
    # A density is of the two-sided spectrum: a sample deviates by it times the root of the rate.
    found = np.sqrt(power.mean(axis=1) / 2.0) / density
    assert found[(hz >= 5.0) & (hz <= 60.0)].mean() == pytest.approx(1.0, abs=0.02)
    for at in (188.0, 300.0, 400.0):
        # What lies as far above the rate is folded back.
        expected = np.hypot(butterworth(at, 188.0), butterworth(1000.0 - at, 188.0))
        assert found[np.abs(hz - at) <= 10.0].mean() == pytest.approx(expected, rel=0.08), at


@pytest.mark.parametrize(
    ("order", "delay_s", "expected"),
    # sqrt(2) and 2 over the angular frequency: sums of the time constants of a Butterworth filter's poles.
    [(2, None, 1.19721e-3), (3, None, 1.69314e-3), (2, 1.9e-3, 1.9e-3), (3, 5e-3, 5e-3)],
)
def test_slow_motion_is_late_by_the_group_delay(order: int, delay_s: float | None, expected: float) -> None:
    errors = StreamErrors(bandwidth_hz=188.0, order=order, delay_s=delay_s)

    def two_hertz(t_s: FloatArray) -> FloatArray:
        return np.sin(2.0 * np.pi * 2.0 * t_s)[:, None] * np.ones(3)

    values = sampled(two_hertz, 0.25, 1000.0, 3000, errors, 0.0, np.random.default_rng(1))
    gain, late_s = amplitude_and_delay(0.25 + np.arange(3000) / 1000.0, values[:, 0], 2.0)
    assert gain == pytest.approx(1.0, abs=1e-4)
    assert late_s == pytest.approx(expected, abs=2e-6)


def test_the_time_shift_contains_the_delay_of_the_gyroscope_only() -> None:
    found = run(FILTERED, LATER, swaying(2.0))
    t_s = found.gyroscope["t_ns"] / 1e9
    # The angle is a sine; its rate is a quarter of a period ahead of it.
    _, late_s = amplitude_and_delay(t_s, found.gyroscope["xyz"][:, 2], 2.0)
    assert late_s + 0.125 == pytest.approx(0.0, abs=3e-6)
    shifted = run(StreamErrors(delay_s=0.0), LATER, swaying(2.0))
    exact = run(motion=swaying(2.0))
    for accelerometer, expected_s in ((found, 0.1e-3), (shifted, 2.0e-3)):
        moved = accelerometer.accelerometer["xyz"][1:-1, 0]
        truth = exact.accelerometer["xyz"][:, 0]
        # First order in the delay: what is read is the truth less its slope times the delay.
        slope = (truth[2:] - truth[:-2]) / 2e-3
        late_s = -float(slope @ (moved - truth[1:-1]) / (slope @ slope))
        assert late_s == pytest.approx(expected_s, rel=0.02)


def test_readings_are_whole_steps_within_full_scale() -> None:
    errors = StreamErrors(full_scale=2.0, quantum=1e-3)
    noisy = dataclasses.replace(NO_NOISE, accelerometer_density=0.02)
    readings = run(accelerometer=errors, noise=noisy).accelerometer["xyz"]
    steps = readings / 1e-3
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    # A converter of two's complement ends one step short on the positive side; z is gravity.
    assert readings[:, 2].max() == pytest.approx(2.0 - 1e-3, abs=1e-12)
    free = run(accelerometer=StreamErrors(), noise=noisy).accelerometer["xyz"]
    inside = np.abs(free) < 1.99
    assert np.abs((readings - free)[inside]).max() <= 0.5e-3 + 1e-12
    negative = run(accelerometer=errors, gravity=-GRAVITY).accelerometer["xyz"]
    assert negative[:, 2].min() == -2.0


def test_a_sensor_slower_than_its_reader_repeats_its_readings() -> None:
    """57 % of the samples of the real `IMU_rotDisk` repeat: 2332 readings a second of a sensor at 1 kHz."""
    errors = StreamErrors(update_rate_hz=1000.0)
    noisy = dataclasses.replace(NO_NOISE, gyroscope_density=1e-4)
    readings = run(errors, gyroscope_rate_hz=2332.0, noise=noisy).gyroscope["xyz"]
    repeats = np.all(readings[1:] == readings[:-1], axis=1)
    assert repeats.mean() == pytest.approx(1.0 - 1000.0 / 2332.0, abs=2e-3)
    # What is new is noise of the density, at the rate of the sensor.
    new = readings[1:][~repeats]
    assert new.std() == pytest.approx(1e-4 * np.sqrt(1000.0), rel=0.03)


def test_a_held_reading_is_old_by_at_most_one_renewal() -> None:
    errors = StreamErrors(update_rate_hz=200.0)
    readings = run(errors, motion=swaying(1.0)).gyroscope
    truth = run(motion=swaying(1.0)).gyroscope
    steepest = 0.2 * (2.0 * np.pi) ** 2
    age = np.abs(readings["xyz"][:, 2] - truth["xyz"][:, 2]).max() / steepest
    assert 0.004 < age <= 0.005 + 1e-6


def test_scale_and_misalignment_have_the_spread_of_the_tolerance() -> None:
    errors = StreamErrors(scale_sigma=0.01, misalignment_sigma=0.004)
    rng = np.random.default_rng(5)
    units = [
        draw_unit(errors, StreamRandomness.spawned(rng), axes) for axes in (True, False) for _ in range(800)
    ]
    gains = np.array([unit.gain for unit in units])
    off = ~np.eye(3, dtype=bool)
    assert (np.diagonal(gains, axis1=1, axis2=2) - 1.0).std() == pytest.approx(0.01, rel=0.05)
    for half in (gains[:800], gains[800:]):
        assert half[:, off].std() == pytest.approx(0.004, rel=0.05)
    # Axes that a calibration has found are not turned; the other sensor's may be.
    np.testing.assert_allclose(gains[:800], np.swapaxes(gains[:800], 1, 2), atol=1e-15)
    assert np.abs(gains[800:] - np.swapaxes(gains[800:], 1, 2)).max() > 0.01


def test_a_body_at_rest_reads_gravity_times_the_scale() -> None:
    errors = StreamErrors(scale_sigma=0.01, misalignment_sigma=0.004)
    readings = run(accelerometer=errors).accelerometer["xyz"]
    exact = run().accelerometer["xyz"]
    parent = np.random.default_rng(12)
    gain = draw_unit(errors, StreamRandomness.spawned(parent), defines_axes=False).gain
    np.testing.assert_allclose(readings, exact @ gain.T, atol=1e-12)
    assert 0.01 < np.abs(readings - exact).max() < 0.5


def test_specific_force_turns_a_sensitive_gyroscope() -> None:
    sensitive = StreamErrors(g_sensitivity_sigma=2e-4)
    gyroscope = run(sensitive, motion=swaying(1.0)).gyroscope["xyz"]
    found = gyroscope - run(motion=swaying(1.0)).gyroscope["xyz"]
    force = run(motion=swaying(1.0)).accelerometer["xyz"]
    matrix, residual, *_ = np.linalg.lstsq(force, found)
    assert residual.max() < 1e-20
    assert 2e-5 < np.abs(matrix).max() < 8e-4


def test_vibration_goes_through_the_filter() -> None:
    shaken = Vibration(87.0, (3.0, 1.0), (0.15, 0.05))
    found = run(FILTERED, LATER, vibration=shaken)
    t_s = found.gyroscope["t_ns"] / 1e9
    for hz, acceleration, rate in ((87.0, 3.0, 0.15), (174.0, 1.0, 0.05)):
        for axis in range(3):
            gain, _ = amplitude_and_delay(t_s, found.gyroscope["xyz"][:, axis], hz)
            assert gain == pytest.approx(rate * butterworth(hz, 188.0), rel=0.01)
            gain, _ = amplitude_and_delay(t_s, found.accelerometer["xyz"][:, axis], hz)
            assert gain == pytest.approx(acceleration * butterworth(hz, 184.0), rel=0.01)
    np.testing.assert_array_equal(found.truth.at([10**9]).angular_velocity_b, np.zeros((1, 3)))


def test_vibration_above_half_the_rate_is_aliased() -> None:
    wide = StreamErrors(bandwidth_hz=330.0)
    shaken = Vibration(174.0, (3.0,), (0.0,))
    found = run(accelerometer=wide, vibration=shaken, accelerometer_rate_hz=200.0).accelerometer
    gain, _ = amplitude_and_delay(found["t_ns"] / 1e9, found["xyz"][:, 0], 26.0)
    assert gain == pytest.approx(3.0 * butterworth(174.0, 330.0), rel=0.01)


def test_the_bias_drifts_with_temperature_and_the_truth_says_so() -> None:
    found = run(StreamErrors(temperature_sigma=1e-3), StreamErrors(temperature_sigma=1e-2))
    for records, bias in (
        (found.gyroscope, found.truth.bias_gyroscope),
        (found.accelerometer, found.truth.bias_accelerometer),
    ):
        exact = run().gyroscope if records is found.gyroscope else run().accelerometer
        np.testing.assert_allclose(records["xyz"] - exact["xyz"], bias.at(records["t_ns"]), atol=1e-12)
        # Two kelvins in the end, with a time constant of 300 s.
        warmer = 2.0 * (1.0 - np.exp(-np.array([1.0, 4.0]) / 300.0))
        drift = bias.at(np.array([10**9, 4 * 10**9]))
        np.testing.assert_allclose(drift[1] / drift[0], warmer[1] / warmer[0], rtol=1e-6)
        assert np.abs(drift[1]).max() > 0.0


def test_stamps_are_late_jitter_and_miss() -> None:
    errors = StreamErrors(stamp_delay_s=2.5e-3, stamp_jitter_s=50e-6, lost_share=0.1)
    found, exact = run(errors, motion=swaying(1.0)).gyroscope, run(motion=swaying(1.0)).gyroscope
    # The readings tell which samples they are: late ones beyond the end are cut off.
    index = np.searchsorted(exact["t_ns"], found["t_ns"] - 2_500_000 - 500_000)
    late_s = (found["t_ns"] - exact["t_ns"][index]) / 1e9
    np.testing.assert_array_equal(found["xyz"], exact["xyz"][index])
    assert late_s.mean() == pytest.approx(2.5e-3, abs=5e-6)
    assert late_s.std() == pytest.approx(50e-6, rel=0.05)
    assert 1.0 - found.size / exact.size == pytest.approx(0.1, abs=0.02)
    assert np.all(np.diff(found["t_ns"]) > 0)


def test_jitter_as_large_as_the_period_leaves_stamps_ascending() -> None:
    found = run(StreamErrors(stamp_jitter_s=2e-3)).gyroscope
    assert np.all(np.diff(found["t_ns"]) > 0)
    assert found["t_ns"][0] >= 0
    assert found["t_ns"][-1] <= 4 * 10**9


def test_switching_one_error_off_leaves_the_others_as_they_were() -> None:
    noise = ImuNoise(1e-4, 1e-3, 1e-5, 1e-4)
    full = StreamErrors(
        bandwidth_hz=188.0,
        update_rate_hz=800.0,
        scale_sigma=0.01,
        misalignment_sigma=0.01,
        g_sensitivity_sigma=1e-4,
        temperature_sigma=1e-3,
        stamp_jitter_s=1e-5,
        lost_share=0.1,
    )
    base = run(full, full, noise=noise)
    without_losses = run(dataclasses.replace(full, lost_share=0.0), full, noise=noise)
    kept = np.isin(without_losses.gyroscope["t_ns"], base.gyroscope["t_ns"])
    np.testing.assert_array_equal(without_losses.gyroscope[kept], base.gyroscope)
    without_scale = run(dataclasses.replace(full, scale_sigma=0.0), full, noise=noise)
    # At rest, scale has nothing to act on in a gyroscope.
    np.testing.assert_array_equal(without_scale.gyroscope["xyz"], base.gyroscope["xyz"])
    np.testing.assert_array_equal(without_scale.accelerometer, base.accelerometer)
    stepped = run(dataclasses.replace(full, quantum=1e-3), full, noise=noise)
    assert np.abs(stepped.gyroscope["xyz"] - base.gyroscope["xyz"]).max() <= 0.5e-3 + 1e-12
    cold = run(dataclasses.replace(full, temperature_sigma=0.0), full, noise=noise)
    np.testing.assert_array_equal(cold.gyroscope["t_ns"], base.gyroscope["t_ns"])
    difference = cold.gyroscope["xyz"] - base.gyroscope["xyz"]
    assert 0.0 < np.abs(difference).max() < 2e-4
    shaken = run(full, full, noise=noise, vibration=Vibration(87.0, (0.0,), (0.0,)))
    np.testing.assert_array_equal(shaken.gyroscope, base.gyroscope)


@pytest.mark.parametrize("name", IMU_SENSORS)
def test_named_sensors_say_where_their_figures_are_from_and_read_their_motion(name: str) -> None:
    sensor = imu_named(name.lower().replace("-", ""))
    assert sensor.sources
    scenario = dataclasses.replace(with_imu(SCENARIOS["moderate"], sensor), duration_s=2.0, start_ns=0)
    assert scenario.noise == sensor.noise
    motion = swaying(0.5)
    found = simulate_inertial(scenario, motion, np.random.default_rng(3), np.random.default_rng(4))
    for records, ideal, errors, bias in (
        (found.gyroscope, motion.angular_velocity_b, sensor.gyroscope, found.truth.bias_gyroscope),
        (
            found.accelerometer,
            lambda t: specific_force_b(motion, t, scenario.gravity),
            sensor.accelerometer,
            found.truth.bias_accelerometer,
        ),
    ):
        truth = ideal(records["t_ns"] / 1e9) + bias.at(records["t_ns"])
        off = np.abs((records["xyz"] - truth).mean(axis=0)).max()
        largest = np.abs(truth).max()
        assert off < 4.0 * largest * (errors.scale_sigma + errors.misalignment_sigma) + 0.05 * largest


def test_the_suite_has_the_imu_of_its_camera() -> None:
    assert EVENT_SCENARIOS["suite_boxes_6dof"].imu is IMU_SENSORS["MPU-6150"]
    assert SCENARIOS["moderate"].imu is not IDEAL_IMU
    assert SCENARIOS["noise_free"].imu is IDEAL_IMU


def test_the_simulated_mpu6150_is_like_a_real_one(data_dir: Path) -> None:
    """Steps, and how the noise falls off above the bandwidth, of the camera's IMU in shapes_rotation."""
    table = np.loadtxt(data_dir / "ecd_shapes_rotation_imu" / "imu.txt", skiprows=2000, max_rows=10_000)
    scenario = with_imu(
        dataclasses.replace(SCENARIOS["moderate"], duration_s=10.0, accelerometer_rate_hz=1000.0),
        imu_named("MPU-6150"),
    )
    found = simulate_inertial(scenario, swaying(0.5), np.random.default_rng(3), np.random.default_rng(4))
    for records, columns, errors in (
        (found.accelerometer, slice(1, 4), scenario.imu.accelerometer),
        (found.gyroscope, slice(4, 7), scenario.imu.gyroscope),
    ):
        real = table[:, columns]
        assert np.diff(np.unique(real[:, 0])).min() == pytest.approx(errors.quantum, rel=2e-3)
        falls = []
        for values in (real, records["xyz"]):
            hz, power = welch(values, fs=1000.0, nperseg=1000, window="blackmanharris", axis=0)
            # Less what quantisation adds.
            density = np.sqrt(np.maximum(power.mean(axis=1) - errors.quantum**2 / 12.0 / 500.0, 0.0))
            bands = [
                np.median(density[(hz >= low) & (hz < low + 40.0)]) for low in (80.0, 180.0, 240.0, 320.0)
            ]
            falls.append(np.array(bands[1:]) / bands[0])
        # Measured: within 0.16 of each other; without a filter the ratios are one.
        np.testing.assert_allclose(falls[1], falls[0], atol=0.2)


@pytest.mark.parametrize(
    "change",
    [
        {"full_scale": 0.0},
        {"quantum": -1.0},
        {"bandwidth_hz": 0.0},
        {"update_rate_hz": 0.0},
        {"lost_share": 1.0},
        {"scale_sigma": float("nan")},
    ],
)
def test_impossible_errors_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(SimulationError, match="expected no negative value"):
        StreamErrors(**change)


def test_a_delay_shorter_than_the_filters_own_is_refused() -> None:
    with pytest.raises(SimulationError, match="at least the filter's own delay"):
        run(StreamErrors(bandwidth_hz=20.0, delay_s=1e-3))


def test_impossible_vibration_is_refused() -> None:
    with pytest.raises(SimulationError, match="equal numbers of amplitudes"):
        Vibration(87.0, (1.0,), (0.1, 0.2))


def test_an_unknown_imu_is_refused_with_those_there_are() -> None:
    with pytest.raises(SimulationError, match="expected one of ideal, MPU-6150"):
        imu_named("MPU-1")
