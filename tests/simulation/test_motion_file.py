"""Motion from a file: smooth, with exact derivatives, and an IMU that agrees with it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import SimulationError
from asyneio.simulation.events.source import set_stage
from asyneio.simulation.imu_sensors import IDEAL_IMU
from asyneio.simulation.motion_file import SplineMotion, load_motion
from asyneio.simulation.rig import simulate_inertial
from asyneio.simulation.scenario import NOISE_FREE
from tests.simulation.event_worlds import small_scenario

T_S = np.linspace(0.0, 3.0, 61)


def write_euroc(file: Path, seconds: float = 6.0) -> None:
    """A slow loop with a turning attitude, which passes where the quaternion's sign is arbitrary."""
    t = np.arange(0.0, seconds, 0.005)
    around = np.column_stack([np.sin(0.8 * t), 1.2 * np.cos(0.6 * t), 0.3 * np.sin(1.1 * t)])
    position = around + np.array([5.0, -3.0, 1.0])
    xyzw = Rotation.from_euler("zyx", np.column_stack([0.9 * t, 1.4 + 0.2 * np.sin(t), 0.1 * t])).as_quat()
    xyzw[len(t) // 3 :] *= -1.0
    stamps = 1_400_000_000_000_000_000 + np.rint(t * 1e9).astype(np.int64)
    rows = [
        f"{s},{','.join(f'{value:.7f}' for value in (*p, q[3], *q[:3]))},0,0,0"
        for s, p, q in zip(stamps, position, xyzw, strict=True)
    ]
    file.write_text("\n".join(["#timestamp,p,p,p,q,q,q,q,v,v,v", *rows]), encoding="utf-8")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_euroc(tmp_path / "state.csv")
    return tmp_path / "state.csv"


def check_derivatives(motion: SplineMotion) -> None:
    h = 1e-5
    before, after = motion.T_w_b(T_S - h), motion.T_w_b(T_S + h)
    slope = (after - before) / (2.0 * h)
    np.testing.assert_allclose(motion.velocity_w(T_S), slope[:, :3, 3], atol=1e-6)
    spin = np.einsum("nji,njk->nik", motion.T_w_b(T_S)[:, :3, :3], slope[:, :3, :3])
    rate = np.column_stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])
    np.testing.assert_allclose(motion.angular_velocity_b(T_S), rate, atol=1e-6)
    acceleration = (motion.velocity_w(T_S + h) - motion.velocity_w(T_S - h)) / (2.0 * h)
    np.testing.assert_allclose(motion.acceleration_w(T_S), acceleration, atol=1e-5)
    second = (motion.angular_velocity_b(T_S + h) - motion.angular_velocity_b(T_S - h)) / (2.0 * h)
    np.testing.assert_allclose(motion.angular_acceleration_b(T_S), second, atol=1e-5)


def test_derivatives_are_those_of_the_poses(file: Path) -> None:
    check_derivatives(load_motion(file, 1.0, 3.0, np.eye(3)))


def test_the_motion_is_the_file_moved_and_turned(file: Path) -> None:
    motion = load_motion(file, 1.0, 3.0, np.eye(3))
    t = T_S + 1.0
    original = np.column_stack([np.sin(0.8 * t), 1.2 * np.cos(0.6 * t), 0.3 * np.sin(1.1 * t)])
    way = motion.T_w_b(T_S)[:, :3, 3]
    # Distances and heights stay as they were.
    np.testing.assert_allclose(
        np.linalg.norm(way - way[0], axis=1), np.linalg.norm(original - original[0], axis=1), atol=1e-4
    )
    np.testing.assert_allclose(way[:, 2] - way[0, 2], original[:, 2] - original[0, 2], atol=1e-4)
    np.testing.assert_allclose(way.min(axis=0) + way.max(axis=0), 0.0, atol=0.02)


def test_the_imu_reads_the_derivatives_of_the_spline(file: Path) -> None:
    scenario = small_scenario(
        world="hall",
        motion_scale=1.0,
        motion_file=file,
        motion_offset_s=1.0,
        duration_s=3.0,
        imu=IDEAL_IMU,
        noise=NOISE_FREE,
        initial_gyroscope_bias_sigma=0.0,
        initial_accelerometer_bias_sigma=0.0,
    )
    motion = set_stage(scenario, np.random.SeedSequence(0).spawn(2)).motion
    rng = np.random.default_rng(0)
    run = simulate_inertial(scenario, motion, rng, rng)
    t_s = (run.gyroscope["t_ns"] - scenario.start_ns) * 1e-9
    np.testing.assert_allclose(run.gyroscope["xyz"], motion.angular_velocity_b(t_s), atol=1e-12)
    C_w_b = motion.T_w_b(t_s)[:, :3, :3]
    felt = np.einsum("nij,nj->ni", C_w_b, run.accelerometer["xyz"])
    upwards = np.array([0.0, 0.0, 9.81])
    np.testing.assert_allclose(felt, motion.acceleration_w(t_s) + upwards, atol=1e-9)


def test_what_cannot_be_used_is_refused(file: Path, tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match=r"holds 6\.0 s of motion"):
        load_motion(file, 4.0, 3.0, np.eye(3))
    with pytest.raises(SimulationError, match="cannot be read"):
        load_motion(tmp_path / "absent.csv", 0.0, 1.0, np.eye(3))
    gap = tmp_path / "gap.csv"
    lines = file.read_text(encoding="utf-8").split("\n")
    gap.write_text("\n".join(lines[:300] + lines[400:]), encoding="utf-8")
    with pytest.raises(SimulationError, match=r"gap of 0\.5"):
        load_motion(gap, 0.0, 1.0, np.eye(3))
    with pytest.raises(SimulationError, match="keeps its size"):
        dataclasses.replace(small_scenario(), motion_file=file, motion_scale=0.5)


@pytest.mark.parametrize("name", ["V1_02_medium.csv", "indoor_forward_5_snapdragon_with_gt.txt"])
def test_real_motion_stays_level_and_smooth(data_dir: Path, name: str) -> None:
    motion = load_motion(data_dir / "motion_profiles" / name, 2.0, 15.0, np.eye(3))
    check_derivatives(motion)
    C_w_c = motion.T_w_b(np.linspace(0.0, 15.0, 301))[:, :3, :3]
    # The body is the camera here: its y axis points down, its z axis ahead on average.
    assert C_w_c[:, 2, 1].mean() < -0.9
    assert abs(C_w_c[:, 1, 2].mean()) < 0.05 < C_w_c[:, 0, 2].mean()
    assert np.abs(motion.acceleration_w(T_S)).max() < 15.0
