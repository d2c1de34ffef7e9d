"""Paths through recorded poses that agree with the IMU: known motions are found again, the rest refused."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import SimulationError
from asyneio.io import read_inertial_file
from asyneio.io.recording.trajectory_reader import read_trajectory
from asyneio.simulation import draw_motion, simulate_events
from asyneio.simulation.imu import specific_force_b
from asyneio.simulation.path_basis import UniformKnots
from asyneio.simulation.path_fit import PathFit, fit_path
from asyneio.simulation.path_normal import Terms
from asyneio.simulation.path_terms import (
    PathState,
    Readings,
    accelerometer_terms,
    gyroscope_terms,
    pose_terms,
)
from asyneio.simulation.recorded_path import RecordedRun, recorded_run
from asyneio.simulation.spline_motion import SplineMotion
from asyneio.types import INERTIAL_DTYPE, FloatArray, ImuNoise, PoseTrajectory, RecordArray
from tests.simulation.event_worlds import small_scenario

SECONDS, START_NS = 8.0, 1_400_000_000_000_000_000
NOISE = ImuNoise(2e-4, 2e-3, 2e-5, 2e-4)
#: What the IMU's clock is ahead of that of the poses [s]; constant biases.
CLOCK_S = 0.004
BIASES = np.array([[0.02, -0.01, 0.03], [0.1, -0.05, 0.15]])
FORWARD = np.array([1.0, 0.0, 0.0])
Run = tuple[PoseTrajectory, RecordArray, RecordArray]


def stream(t_s: FloatArray, xyz: FloatArray) -> RecordArray:
    records = np.zeros(t_s.size, dtype=INERTIAL_DTYPE)
    records["t_ns"] = START_NS + np.rint(1e9 * t_s).astype(np.int64)
    records["xyz"] = xyz
    return records


def motion_world() -> Rotation:
    """The world of the poses is turned against that of the motion: z is 2 degrees off the vertical."""
    return Rotation.from_rotvec([0.03, 0.02, 0.7])


def recorded(seed: int = 0) -> Run:
    """A known motion as motion capture and an IMU see it: mm, tenths of a degree, white noise, biases."""
    rng = np.random.default_rng(seed)
    motion = draw_motion("moderate", rng, np.eye(3), 1.0)
    t_s = np.arange(0.0, SECONDS, 0.01) + 0.003
    T_w_b = motion.T_w_b(t_s)
    turned = motion_world() * Rotation.from_matrix(T_w_b[:, :3, :3])
    noisy = turned * Rotation.from_rotvec(rng.normal(0.0, 1e-3, (t_s.size, 3)))
    position = motion_world().apply(T_w_b[:, :3, 3]) + rng.normal(0.0, 1e-3, (t_s.size, 3))
    t_ns = START_NS + np.rint(1e9 * (t_s - CLOCK_S)).astype(np.int64)
    quaternion = noisy.as_quat() * rng.choice([-1.0, 1.0], t_s.size)[:, None]
    i_s = np.arange(0.0, SECONDS, 0.005)
    spread = np.sqrt(200.0) * np.array([NOISE.gyroscope_density, NOISE.accelerometer_density])
    ideal = motion.angular_velocity_b(i_s), specific_force_b(motion, i_s, 9.81)
    gyroscope, accelerometer = (
        stream(i_s, xyz + bias + rng.normal(0.0, sigma, xyz.shape))
        for xyz, bias, sigma in zip(ideal, BIASES, spread, strict=True)
    )
    return PoseTrajectory(t_ns, position, quaternion), gyroscope, accelerometer


@pytest.fixture(scope="module")
def run() -> Run:
    return recorded()


@pytest.fixture(scope="module")
def fit(run: Run) -> PathFit:
    return fit_path(*run, NOISE)


def part(run: Run, fit: PathFit, span_s: tuple[float, float | None] = (1.0, 3.0)) -> RecordedRun:
    return recorded_run(fit, run[1], run[2], FORWARD, span_s)


def check_derivatives(motion: SplineMotion, t_s: FloatArray) -> None:
    h = 1e-5
    before, after = motion.T_w_b(t_s - h), motion.T_w_b(t_s + h)
    slope = (after - before) / (2.0 * h)
    np.testing.assert_allclose(motion.velocity_w(t_s), slope[:, :3, 3], atol=1e-6)
    spin = np.einsum("nji,njk->nik", motion.T_w_b(t_s)[:, :3, :3], slope[:, :3, :3])
    rate = np.column_stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])
    np.testing.assert_allclose(motion.angular_velocity_b(t_s), rate, atol=1e-5)
    acceleration = (motion.velocity_w(t_s + h) - motion.velocity_w(t_s - h)) / (2.0 * h)
    np.testing.assert_allclose(motion.acceleration_w(t_s), acceleration, atol=1e-4)
    second = (motion.angular_velocity_b(t_s + h) - motion.angular_velocity_b(t_s - h)) / (2.0 * h)
    np.testing.assert_allclose(motion.angular_acceleration_b(t_s), second, atol=1e-3)


@pytest.mark.parametrize("sensor", [0, 1, 2])
def test_derivatives_of_the_residuals(sensor: int) -> None:
    rng = np.random.default_rng(3)
    knots = UniformKnots(0.1, 5)
    control = rng.normal(0.0, 0.3, (knots.count, 7)) + np.array([0, 0, 0, 0.1, 0.2, 0.3, 0.9])
    state = PathState(control, 0.002, np.array([0.1, 0.2, -9.7]), rng.normal(0.0, 0.1, (2, 3, 3)), 0.25)
    t_s = np.sort(rng.uniform(0.01, 0.48, 12))
    values = rng.normal(size=(12, 3))
    if sensor == 2:
        values = np.hstack([values, Rotation.random(12, rng).as_quat()])
    make = (gyroscope_terms, accelerometer_terms, pose_terms)[sensor]

    def terms(control_step: FloatArray, others_step: FloatArray) -> Terms:
        return make(knots, Readings(t_s, values), state.stepped(control_step, others_step))

    flat, others = np.zeros(control.size), np.zeros(4 + state.biases.size)
    exact = terms(np.zeros_like(control), others)
    rows = np.arange(12)
    h = 1e-6
    for index in range(flat.size):
        step = np.eye(flat.size)[index].reshape(control.shape) * h
        slope = (terms(step, others).r - terms(-step, others).r) / (2.0 * h)
        place = index - 7 * exact.first
        used = (place >= 0) & (place < 42)
        wanted = np.where(used[:, None], exact.J[rows, :, np.clip(place, 0, 41)], 0.0)
        np.testing.assert_allclose(slope, wanted, atol=2e-5)
    for index in range(others.size):
        step = np.eye(others.size)[index] * h
        none = np.zeros_like(control)
        slope = (terms(none, step).r - terms(none, -step).r) / (2.0 * h)
        wanted = np.einsum("nkc,nc->nk", exact.K, exact.columns == index)
        np.testing.assert_allclose(slope, wanted, atol=2e-5)


@pytest.mark.slow
def test_a_known_motion_is_found_again(run: Run, fit: PathFit) -> None:
    motion = draw_motion("moderate", np.random.default_rng(0), np.eye(3), 1.0)
    t_s = np.linspace(0.5, 7.0, 200)
    since_s = (fit.start_ns - START_NS) * 1e-9
    way = motion_world().apply(motion.T_w_b(t_s)[:, :3, 3])
    error = fit.position(t_s - since_s) - way
    # Four times better than a single pose, whose noise is 1 mm an axis.
    assert np.sqrt(np.mean(error**2)) < 2.5e-4
    true = motion_world() * Rotation.from_matrix(motion.T_w_b(t_s)[:, :3, :3])
    turn = (true.inv() * Rotation.from_quat(fit.quaternion(t_s - since_s))).magnitude()
    assert np.sqrt(np.mean(turn**2)) < 4e-4
    assert fit.clock_offset_s == pytest.approx(CLOCK_S, abs=2e-4)
    np.testing.assert_allclose(fit.bias_gyroscope, BIASES[0] + np.zeros((2, 3)), atol=1e-3)
    np.testing.assert_allclose(fit.bias_accelerometer, BIASES[1] + np.zeros((2, 3)), atol=0.03)
    np.testing.assert_allclose(fit.gravity, motion_world().apply([0.0, 0.0, -9.81]), atol=0.03)


def test_what_is_left_over_is_the_noise(fit: PathFit) -> None:
    left = fit.residuals
    assert left.position == pytest.approx(1e-3, rel=0.1)
    assert left.orientation == pytest.approx(1e-3, rel=0.1)
    # One control point takes up one of five samples: sqrt(0.8) = 0.89 of the noise is left.
    assert left.gyroscope_sigmas == pytest.approx(0.89, abs=0.03)
    assert left.accelerometer_sigmas == pytest.approx(0.89, abs=0.03)


def test_a_part_is_upright_and_carries_the_samples_as_they_are(run: Run, fit: PathFit) -> None:
    whole, some = part(run, fit, (0.0, None)), part(run, fit)
    check_derivatives(some.motion, np.linspace(0.0, 3.0, 61))
    t_s = np.linspace(0.0, 3.0, 31)
    way = some.motion.T_w_b(t_s)[:, :3, 3]
    assert np.abs(way.min(axis=0) + way.max(axis=0)).max() < 0.02
    ahead = (some.motion.T_w_b(t_s)[:, :3, :3] @ FORWARD).mean(axis=0)
    assert abs(ahead[1]) < 0.02 < ahead[0]
    # Heights are those of the motion, whose world is not turned.
    motion = draw_motion("moderate", np.random.default_rng(0), np.eye(3), 1.0)
    height = motion.T_w_b(t_s + (some.start_ns - START_NS) * 1e-9)[:, 2, 3]
    np.testing.assert_allclose(np.ptp(way[:, 2] - height), 0.0, atol=5e-3)
    assert some.samples is not None
    assert whole.samples is not None
    inside = (run[1]["t_ns"] >= some.start_ns) & (run[1]["t_ns"] <= some.start_ns + 3_000_000_000)
    assert some.samples.gyroscope.tobytes() == run[1][inside].tobytes()
    assert some.samples.accelerometer.tobytes() == run[2][inside].tobytes()
    # Both are the same motion, but for where the world begins.
    rates = [one.motion.angular_velocity_b(t) for one, t in ((whole, t_s + 1.0), (some, t_s))]
    np.testing.assert_allclose(rates[0], rates[1], atol=1e-9)
    with pytest.raises(SimulationError, match="use a smaller offset or a shorter run"):
        part(run, fit, (6.0, 3.0))


@pytest.mark.slow
def test_a_hybrid_simulation_keeps_samples_and_truth(run: Run, fit: PathFit) -> None:
    some = part(run, fit, (1.0, 0.1))
    simulation = simulate_events(small_scenario(motion_scale=1.0).along(some, NOISE))
    recording, samples = simulation.recording, some.samples
    assert samples is not None
    assert recording.calibration is not None
    assert recording.gyroscope.tobytes() == samples.gyroscope.tobytes()
    assert recording.calibration.noise.rate_hz == pytest.approx(200.0)
    assert recording.events.size > 100
    assert recording.ground_truth is not None
    assert recording.ground_truth.t_ns[0] == some.start_ns
    state = simulation.truth.at(samples.gyroscope["t_ns"])
    left = state.angular_velocity_b + state.bias_gyroscope - samples.gyroscope["xyz"]
    assert np.sqrt(np.mean(left**2)) < 1.3 * np.sqrt(200.0) * NOISE.gyroscope_density
    again = simulate_events(simulation.scenario)
    np.testing.assert_array_equal(again.recording.events, recording.events)
    with pytest.raises(SimulationError, match="cannot be scaled"):
        dataclasses.replace(simulation.scenario, motion_scale=0.5)


@pytest.mark.slow
def test_poses_alone_get_a_simulated_imu(run: Run) -> None:
    poses = run[0]
    fit = fit_path(poses, None, None, NOISE)
    level = recorded_run(fit, None, None, FORWARD, (1.0, 0.2))
    scenario = small_scenario(motion_scale=1.0).along(level, NOISE)
    assert np.isnan(fit.residuals.gyroscope)
    assert scenario.gyroscope_rate_hz == 1000.0
    simulation = simulate_events(scenario)
    # Without an IMU the world of the poses is taken to be upright.
    np.testing.assert_allclose(fit.gravity, [0.0, 0.0, -9.81], atol=1e-6)
    t_s = (simulation.recording.gyroscope["t_ns"] - scenario.start_ns) * 1e-9
    left = simulation.recording.gyroscope["xyz"] - level.motion.angular_velocity_b(t_s)
    assert np.abs(left).max() < 0.1
    gap = PoseTrajectory(*(np.delete(a, slice(300, 320), axis=0) for a in dataclasses.astuple(poses)))
    with pytest.raises(SimulationError, match=r"gap of 0\.21"):
        fit_path(gap, None, None, NOISE)


@pytest.mark.slow
def test_gaps_and_outliers_of_poses_are_bridged(run: Run, fit: PathFit) -> None:
    poses, gyroscope, accelerometer = run
    wrong = poses.position.copy()
    wrong[150:155] += 0.2
    columns = poses.t_ns, wrong, poses.quaternion
    worse = PoseTrajectory(*(np.delete(column, slice(400, 430), axis=0) for column in columns))
    found = fit_path(worse, gyroscope, accelerometer, NOISE)
    t_s = np.linspace(0.5, 7.0, 300)
    assert np.abs(found.position(t_s) - fit.position(t_s)).max() < 0.02
    gap = np.linspace(4.0, 4.3, 30)
    assert np.abs(found.position(gap) - fit.position(gap)).max() < 3e-3


def turned(gyroscope: RecordArray, angle_deg: float) -> RecordArray:
    records = gyroscope.copy()
    C = Rotation.from_rotvec(np.radians(angle_deg) * np.array([0.6, 0.0, 0.8]))
    records["xyz"] = C.apply(gyroscope["xyz"])
    return records


@pytest.mark.slow
def test_what_does_not_agree_is_refused(run: Run) -> None:
    poses, gyroscope, accelerometer = run
    apart = dataclasses.replace(poses, t_ns=poses.t_ns - START_NS)
    with pytest.raises(SimulationError, match="in common; expected both from one run in one clock"):
        fit_path(apart, gyroscope, accelerometer, NOISE)
    degrees = gyroscope.copy()
    degrees["xyz"] *= 180.0 / np.pi
    with pytest.raises(
        SimulationError, match=r"57\.\d times the rates of the poses; it seems to be in deg/s"
    ):
        fit_path(poses, degrees, accelerometer, NOISE)
    with pytest.raises(SimulationError, match=r"rotated by (29\.9|30\.\d) deg relative to the body"):
        fit_path(poses, turned(gyroscope, 30.0), turned(accelerometer, 30.0), NOISE)
    other = recorded(5)
    with pytest.raises(SimulationError, match="correlate by"):
        fit_path(poses, other[1], other[2], NOISE)
    still = dataclasses.replace(poses, quaternion=np.tile([0.0, 0.0, 0.0, 1.0], (poses.t_ns.size, 1)))
    with pytest.raises(SimulationError, match="orientation of the poses never changes"):
        fit_path(still, gyroscope, accelerometer, NOISE)
    in_cm = dataclasses.replace(poses, position=100.0 * poses.position)
    with pytest.raises(SimulationError, match="no smooth path agrees"):
        fit_path(in_cm, gyroscope, accelerometer, NOISE)


@pytest.mark.slow
def test_clocks_that_are_far_apart_are_aligned(run: Run, fit: PathFit) -> None:
    late = dataclasses.replace(run[0], t_ns=run[0].t_ns - 300_000_000)
    found = fit_path(late, run[1], run[2], NOISE)
    assert found.clock_offset_s == pytest.approx(fit.clock_offset_s + 0.3, abs=1e-4)


def excerpt(data_dir: Path, folder: str, files: tuple[str, str], span_s: tuple[float, float]) -> Run:
    poses, _ = read_trajectory(data_dir / folder / files[0])
    samples = read_inertial_file(data_dir / folder / files[1])
    begin, end = (poses.t_ns[0] + np.array(span_s) * 1e9).astype(np.int64)
    use = (poses.t_ns >= begin) & (poses.t_ns <= end)
    streams = [
        s[(s["t_ns"] >= begin) & (s["t_ns"] <= end)] for s in (samples.gyroscope, samples.accelerometer)
    ]
    return PoseTrajectory(poses.t_ns[use], poses.position[use], poses.quaternion[use]), *streams


@pytest.mark.slow
def test_real_flight_and_its_imu_agree(data_dir: Path) -> None:
    files = "groundtruth_20hz_full_state.csv", "imu0_data.csv"
    noise = ImuNoise(1.6968e-4, 2e-3, 1.9393e-5, 3e-3)
    fit = fit_path(*excerpt(data_dir, "euroc_V1_01", files, (40.0, 50.0)), noise)
    left = fit.residuals
    # Rotors: some ten times the noise of the data sheet; the poses are those of a smoother, which agree.
    assert left.gyroscope < 0.04
    assert left.accelerometer < 1.2
    assert left.position < 1e-3
    assert left.orientation < 1e-3
    state = np.loadtxt(data_dir / "euroc_V1_01" / files[0], delimiter=",")[800:1000]
    np.testing.assert_allclose(fit.bias_gyroscope.mean(axis=0), state[:, 11:14].mean(axis=0), atol=2e-3)
    np.testing.assert_allclose(fit.bias_accelerometer.mean(axis=0), state[:, 14:17].mean(axis=0), atol=0.1)


def test_real_hand_held_motion_and_its_imu_agree(data_dir: Path) -> None:
    noise = ImuNoise(8e-5, 1.4e-3, 2.2e-6, 8.6e-5)
    run = excerpt(data_dir, "tumvi_calib", ("groundtruth.tum", "imu.csv"), (0.0, 8.0))
    left = fit_path(*run, noise).residuals
    assert left.gyroscope_sigmas < 2.5
    assert left.accelerometer_sigmas < 2.5
    assert left.position < 1e-3
    assert left.orientation < 5e-3


@pytest.mark.parametrize("name", ["V1_02_medium.csv", "indoor_forward_5_snapdragon_with_gt.txt"])
def test_real_poses_alone_are_smooth(data_dir: Path, name: str) -> None:
    poses, _ = read_trajectory(data_dir / "motion_profiles" / name)
    early = poses.t_ns < poses.t_ns[0] + 20_000_000_000
    poses = PoseTrajectory(poses.t_ns[early], poses.position[early], poses.quaternion[early])
    fit = fit_path(poses, None, None, NOISE)
    motion = recorded_run(fit, None, None, FORWARD, (2.0, 15.0)).motion
    check_derivatives(motion, np.linspace(0.0, 15.0, 61))
    assert fit.residuals.position < 0.01
    assert fit.residuals.orientation < 0.02
    assert np.abs(motion.acceleration_w(np.linspace(0.0, 15.0, 301))).max() < 25.0
