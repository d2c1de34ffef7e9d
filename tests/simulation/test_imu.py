"""Sample times, noise statistics, and consistency of ideal readings with the motion."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import SimulationError
from asyneio.simulation import SCENARIOS, AnalyticMotion, Simulation, Sinusoids, simulate
from asyneio.simulation.imu import StreamSpec, corrupt, draw_bias, sample_times, specific_force_b

SPEC = StreamSpec(rate_hz=190.0, offset_s=0.0017, density=5e-3, walk=5e-4, initial_bias_sigma=0.05)


@pytest.fixture(scope="module")
def noise_free() -> Simulation:
    return simulate(dataclasses.replace(SCENARIOS["noise_free"], duration_s=3.0))


def test_times_start_at_the_offset_and_never_drift() -> None:
    t_ns = sample_times(SPEC, 10.0)
    assert t_ns[0] == 1_700_000
    expected = 1_700_000 + np.arange(t_ns.size) * 1e9 / 190.0
    assert np.abs(t_ns - expected).max() <= 0.5 + 1e-3
    assert 10_000_000_000 - t_ns[-1] < 1e9 / 190.0
    whole = sample_times(dataclasses.replace(SPEC, rate_hz=200.0, offset_s=0.0), 2.0)
    assert whole[-1] == 2_000_000_000


def test_a_body_at_rest_reads_gravity_upwards() -> None:
    zero = np.zeros((6, 1))
    tilt = np.array([0.0, 0.0, 0.0, 0.3, -0.2, 1.0])
    motion = AnalyticMotion(Sinusoids(zero, zero, zero, tilt))
    up_b = Rotation.from_euler("ZYX", [1.0, -0.2, 0.3]).inv().apply([0.0, 0.0, 9.7])
    np.testing.assert_allclose(specific_force_b(motion, np.zeros(1), 9.7)[0], up_b, atol=1e-14)


def test_ideal_gyroscope_integrates_to_the_true_attitude(noise_free: Simulation) -> None:
    gyroscope = noise_free.recording.gyroscope
    t_s = np.diff(gyroscope["t_ns"]) * 1e-9
    omega = 0.5 * (gyroscope["xyz"][1:] + gyroscope["xyz"][:-1])
    attitude = Rotation.identity()
    for step in Rotation.from_rotvec(omega * t_s[:, None]):
        attitude = attitude * step
    C = noise_free.truth.at(gyroscope["t_ns"][[0, -1]]).T_w_b[:, :3, :3]
    error = Rotation.from_matrix(C[0].T @ C[1]).inv() * attitude
    assert error.magnitude() < 1e-6


def test_ideal_accelerometer_integrates_to_the_true_velocity(noise_free: Simulation) -> None:
    accelerometer = noise_free.recording.accelerometer
    truth = noise_free.truth.at(accelerometer["t_ns"])
    t_s = (truth.t_ns - truth.t_ns[0]) * 1e-9
    acceleration_w = np.einsum("nij,nj->ni", truth.T_w_b[:, :3, :3], accelerometer["xyz"]) - [0.0, 0.0, 9.81]
    gained = np.trapezoid(acceleration_w, t_s, axis=0)
    np.testing.assert_allclose(gained, truth.velocity_w[-1] - truth.velocity_w[0], atol=2e-4)


def test_white_noise_has_density_times_root_rate() -> None:
    t_ns = sample_times(SPEC, 200.0)
    rng = np.random.default_rng(5)
    still = dataclasses.replace(SPEC, walk=0.0, initial_bias_sigma=0.0)
    readings = corrupt(np.zeros((t_ns.size, 3)), t_ns, draw_bias(still, t_ns, rng), still, rng)
    count = readings.size
    expected = 5e-3 * np.sqrt(190.0)
    # Four standard deviations of a sample standard deviation.
    assert abs(readings.std() / expected - 1.0) < 4.0 / np.sqrt(2.0 * count)


def test_bias_walk_grows_with_the_root_of_time() -> None:
    t_ns = sample_times(SPEC, 5.0)
    rng = np.random.default_rng(6)
    ends = np.array([draw_bias(SPEC, t_ns, rng).value[[0, -1]] for _ in range(400)])
    assert abs(ends[:, 0].std() / 0.05 - 1.0) < 4.0 / np.sqrt(2400.0)
    walked = ends[:, 1] - ends[:, 0]
    assert abs(walked.std() / (5e-4 * np.sqrt(t_ns[-1] * 1e-9)) - 1.0) < 4.0 / np.sqrt(2400.0)


def test_bias_is_linear_between_samples_and_held_after_them() -> None:
    t_ns = sample_times(SPEC, 1.0)
    bias = draw_bias(SPEC, t_ns, np.random.default_rng(7))
    middle = (bias.t_ns[3] + bias.t_ns[4]) // 2
    np.testing.assert_allclose(bias.at(np.array([middle]))[0], bias.value[3:5].mean(axis=0), atol=1e-9)
    np.testing.assert_array_equal(bias.at(np.array([t_ns[-1] + 10**9]))[0], bias.value[-1])


@pytest.mark.parametrize("change", [{"rate_hz": 0.0}, {"offset_s": -0.1}, {"offset_s": 2.0}])
def test_impossible_streams_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(SimulationError, match="expected a positive rate and 0 <= offset < duration"):
        sample_times(dataclasses.replace(SPEC, **change), 1.0)
