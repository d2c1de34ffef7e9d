"""The whole recording and its truth."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import SimulationError
from asyneio.simulation import IDEAL_IMU, SCENARIOS, SceneKind, Simulation, simulate, with_imu
from asyneio.simulation.scene import draw_landmarks
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, OBSERVATION_DTYPE

SHORT = dataclasses.replace(with_imu(SCENARIOS["moderate"], IDEAL_IMU), duration_s=2.0)


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate(SHORT)


def test_the_recording_is_what_a_reader_delivers(run: Simulation) -> None:
    recording = run.recording
    assert recording.observations.dtype == OBSERVATION_DTYPE
    for stream, rate, offset_ns in (
        (recording.gyroscope, 1000.0, 0),
        (recording.accelerometer, 190.0, 1_700_000),
    ):
        assert stream.dtype == INERTIAL_DTYPE
        assert stream["t_ns"][0] == SHORT.start_ns + offset_ns
        assert abs(np.diff(stream["t_ns"]).mean() * rate / NS_PER_S - 1.0) < 1e-6
    for t_ns in (recording.observations["t_ns"], recording.gyroscope["t_ns"]):
        assert t_ns.min() >= SHORT.start_ns
        assert t_ns.max() <= SHORT.start_ns + 2 * NS_PER_S


def test_camera_stamps_become_imu_stamps_by_adding_the_timeshift(run: Simulation) -> None:
    stamped = run.observations_in_camera_clock()
    shift = run.recording.calibration.timeshift_ns
    assert shift == 2_400_000
    np.testing.assert_array_equal(stamped["t_ns"] + shift, run.recording.observations["t_ns"])


def test_ground_truth_is_the_truth(run: Simulation) -> None:
    poses = run.recording.ground_truth
    assert poses is not None
    truth = run.truth.at(poses.t_ns)
    np.testing.assert_allclose(poses.position, truth.T_w_b[:, :3, 3])
    C = Rotation.from_quat(poses.quaternion).as_matrix()
    np.testing.assert_allclose(C, truth.T_w_b[:, :3, :3], atol=1e-12)
    assert poses.t_ns[-1] - poses.t_ns[0] == 2 * NS_PER_S


def test_generalized_acceleration_is_the_derivative_of_the_body_velocity(run: Simulation) -> None:
    middle = np.arange(1, 40, dtype=np.int64) * 50_000_000 + SHORT.start_ns
    step_ns = 100_000

    def body_velocity(t_ns: np.ndarray) -> np.ndarray:
        state = run.truth.at(t_ns)
        nu = np.einsum("nji,nj->ni", state.T_w_b[:, :3, :3], state.velocity_w)
        return np.hstack([state.angular_velocity_b, nu])

    slope = (body_velocity(middle + step_ns) - body_velocity(middle - step_ns)) / 2e-4
    np.testing.assert_allclose(run.truth.at(middle).generalized_acceleration, slope, atol=1e-5)


def test_readings_minus_truth_leave_the_bias_and_noise(run: Simulation) -> None:
    gyroscope = run.recording.gyroscope
    truth = run.truth.at(gyroscope["t_ns"])
    noise = gyroscope["xyz"] - truth.angular_velocity_b - truth.bias_gyroscope
    sigma = SHORT.noise.gyroscope_density * np.sqrt(1000.0)
    assert np.all(np.abs(noise.mean(axis=0)) < 4.0 * sigma / np.sqrt(len(noise)))
    assert np.abs(truth.bias_gyroscope).max() > 0.0


@pytest.mark.slow
def test_the_same_scenario_gives_the_same_arrays(run: Simulation) -> None:
    again = simulate(SHORT)
    for name in ("observations", "gyroscope", "accelerometer"):
        assert np.array_equal(getattr(run.recording, name), getattr(again.recording, name))
    other = simulate(dataclasses.replace(SHORT, seed=1))
    assert not np.array_equal(run.recording.gyroscope["xyz"], other.recording.gyroscope["xyz"])
    assert not np.array_equal(run.landmarks_w, other.landmarks_w)


def test_changing_the_tracks_leaves_everything_else(run: Simulation) -> None:
    tracks = dataclasses.replace(SHORT.tracks, pixel_sigma=2.0, features_alive=20)
    other = simulate(dataclasses.replace(SHORT, tracks=tracks))
    assert np.array_equal(run.recording.gyroscope, other.recording.gyroscope)
    assert np.array_equal(run.recording.accelerometer, other.recording.accelerometer)
    np.testing.assert_array_equal(run.landmarks_w, other.landmarks_w)


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_every_ready_made_scenario_sees_its_scene(name: str) -> None:
    run = simulate(dataclasses.replace(SCENARIOS[name], duration_s=1.5))
    assert run.scenario.name == name
    observed = np.bincount(run.recording.observations["id"])
    assert observed.size >= run.scenario.tracks.features_alive
    assert np.median(observed) >= 3


def test_one_imu_rate_is_declared_and_two_are_not() -> None:
    synchronous = simulate(dataclasses.replace(SCENARIOS["synchronous_imu"], duration_s=0.5)).recording
    assert synchronous.calibration.noise.rate_hz == 200.0
    np.testing.assert_array_equal(synchronous.gyroscope["t_ns"], synchronous.accelerometer["t_ns"])
    separate = simulate(dataclasses.replace(SHORT, duration_s=0.5)).recording
    assert separate.calibration.noise.rate_hz is None


def test_another_mounting_of_the_imu_sees_the_same_pixels() -> None:
    short = dataclasses.replace(SCENARIOS["noise_free"], duration_s=0.5)
    T_b_c = np.eye(4)
    T_b_c[:3, :3] = Rotation.from_euler("XYZ", [1.0, -0.5, 2.0]).as_matrix()
    # Without a lever arm the camera's path does not depend on how the IMU is turned.
    straight, turned = (simulate(dataclasses.replace(short, T_b_c=T)) for T in (np.eye(4), T_b_c))
    first, second = straight.recording.observations, turned.recording.observations
    np.testing.assert_allclose(first["u"], second["u"], atol=1e-4)
    assert np.abs(straight.recording.gyroscope["xyz"] - turned.recording.gyroscope["xyz"]).max() > 0.1


def test_scenes_are_where_they_say() -> None:
    rng = np.random.default_rng(0)
    plane = draw_landmarks("plane", 500, rng)
    assert np.all(plane[:, 0] == 2.5)
    distance = np.linalg.norm(draw_landmarks("near_far", 500, rng), axis=1)
    assert 200 < (distance < 2.0).sum() < 300
    assert distance.min() >= 1.3
    assert (distance > 6.0).sum() == 500 - (distance < 2.0).sum()
    room = draw_landmarks("room", 3000, rng)
    assert np.linalg.matrix_rank(room - room.mean(axis=0)) == 3
    assert {kind.value for kind in SceneKind} == {"room", "plane", "near_far"}


def test_impossible_requests_are_refused(run: Simulation) -> None:
    with pytest.raises(SimulationError, match="expected times within the run"):
        run.truth.at(SHORT.start_ns - 1)
    with pytest.raises(SimulationError, match="expected both positive"):
        dataclasses.replace(SHORT, duration_s=0.0)
    with pytest.raises(SimulationError, match="scene 'cave' is unknown; expected one of room"):
        simulate(dataclasses.replace(SHORT, scene="cave"))
    with pytest.raises(SimulationError, match="0 landmarks; expected a positive number"):
        draw_landmarks("room", 0, np.random.default_rng(0))
