"""Frames and covariances of the published poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from asyneio.errors import ConfigError
from asyneio.live.step import LiveStep
from asyneio.ros2.messages import Frames, Status, fill_diagnostics, fill_odometry, fill_transform, status_of
from asyneio.ros2.poses import PosesInOdom, transform_of
from asyneio.types import Estimate, FloatArray, Health, StepReport
from tests.ros2.messages import empty, frozen

BASE_FROM_IMU = [0.3, -0.1, 0.2, *Rotation.from_rotvec([0.4, -0.8, 1.1]).as_quat().tolist()]
T_BASE_IMU = transform_of(BASE_FROM_IMU)


def estimate(rng: np.random.Generator, t_ns: int = 10**18 + 7, segment: int = 0) -> Estimate:
    root = 0.01 * rng.normal(size=(24, 24))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    vectors = rng.normal(size=(4, 3))
    return Estimate(
        t_ns, T, vectors[0], vectors[1], np.zeros(6), vectors[2], vectors[3], root @ root.T, segment
    )


def exponential(xi: FloatArray) -> FloatArray:
    """exp of [phi, rho], by the matrix exponential."""
    hat = np.zeros((4, 4))
    hat[:3, :3] = [[0, -xi[2], xi[1]], [xi[2], 0, -xi[0]], [-xi[1], xi[0], 0]]
    hat[:3, 3] = xi[3:]
    return np.asarray(expm(hat))


def test_pose_covariance_is_that_of_perturbed_poses(rng: np.random.Generator) -> None:
    """Central differences of position and rotation vector in odom, for each direction of the error state."""
    given = estimate(rng)
    pose = PosesInOdom(T_BASE_IMU).convert(given)
    C = Rotation.from_quat(pose.quaternion)
    step, J = 1e-6, np.zeros((6, 6))
    for k in range(6):
        moved = []
        for sign in (1.0, -1.0):
            perturbed = replace(given, T_w_b=given.T_w_b @ exponential(sign * step * np.eye(6)[k]))
            at = PosesInOdom(T_BASE_IMU).convert(perturbed)
            turn = (Rotation.from_quat(at.quaternion) * C.inv()).as_rotvec()
            moved.append(np.concatenate([at.position, turn]))
        J[:, k] = (moved[0] - moved[1]) / (2.0 * step)
    np.testing.assert_allclose(pose.pose_covariance, J @ given.covariance[:6, :6] @ J.T, atol=1e-9)
    np.testing.assert_allclose(pose.position, (given.T_w_b @ np.linalg.inv(T_BASE_IMU))[:3, 3], atol=1e-12)


def test_twist_is_the_motion_of_the_base(rng: np.random.Generator) -> None:
    """Against differences of base poses along a short motion with the velocities of the estimate."""
    given = estimate(rng)
    pose = PosesInOdom(T_BASE_IMU).convert(given)
    nu = given.T_w_b[:3, :3].T @ given.velocity_w
    xi, dt = np.concatenate([given.angular_velocity_b, nu]), 1e-6
    after, before = (
        PosesInOdom(T_BASE_IMU).convert(replace(given, T_w_b=given.T_w_b @ exponential(sign * dt * xi)))
        for sign in (1.0, -1.0)
    )
    C = Rotation.from_quat(pose.quaternion)
    linear = C.inv().apply(after.position - before.position) / (2.0 * dt)
    turn = (Rotation.from_quat(before.quaternion).inv() * Rotation.from_quat(after.quaternion)).as_rotvec()
    np.testing.assert_allclose(pose.linear, linear, atol=1e-7)
    np.testing.assert_allclose(pose.angular, turn / (2.0 * dt), atol=1e-7)


@pytest.mark.slow
def test_twist_covariance_by_sampling(rng: np.random.Generator) -> None:
    given = estimate(rng)
    pose = PosesInOdom(T_BASE_IMU).convert(given)
    draws = rng.multivariate_normal(np.zeros(6), given.covariance[6:12, 6:12], size=4000)
    C_w_b = given.T_w_b[:3, :3]
    found = []
    for omega, nu in draws.reshape(-1, 2, 3):
        rate, velocity = given.angular_velocity_b + omega, given.velocity_w + C_w_b @ nu
        drawn = PosesInOdom(T_BASE_IMU).convert(replace(given, angular_velocity_b=rate, velocity_w=velocity))
        found.append(np.concatenate([drawn.linear, drawn.angular]))
    scale = float(np.abs(pose.twist_covariance).max())
    np.testing.assert_allclose(np.cov(np.array(found).T), pose.twist_covariance, atol=0.1 * scale)


def test_odom_continues_in_a_new_segment(rng: np.random.Generator) -> None:
    poses = PosesInOdom(T_BASE_IMU)
    first = poses.convert(estimate(rng))
    given = estimate(rng, first.t_ns + 2 * 10**9, segment=1)
    second = poses.convert(given)
    np.testing.assert_allclose(second.position, first.position, atol=1e-9)
    yaw = [Rotation.from_quat(p.quaternion).as_matrix()[:2, 0] for p in (first, second)]
    assert np.arctan2(*yaw[0][::-1]) == pytest.approx(np.arctan2(*yaw[1][::-1]))
    moved_m = 2.0 * float(np.linalg.norm(first.linear))
    assert (np.diag(second.pose_covariance)[:3] > moved_m**2).all()
    # Motion within the new segment is that of the estimates.
    third = estimate(rng, second.t_ns + 10**8, segment=1)
    moved = poses.convert(third).position - second.position
    in_world = [PosesInOdom(T_BASE_IMU).convert(one).position for one in (given, third)]
    assert np.linalg.norm(moved) == pytest.approx(np.linalg.norm(in_world[1] - in_world[0]))


def test_messages_have_the_types_of_ros(rng: np.random.Generator) -> None:
    pose, frames = PosesInOdom(T_BASE_IMU).convert(estimate(rng)), Frames("odom", "base_link")
    kind = "nav_msgs/msg/Odometry"
    odometry = frozen(kind, fill_odometry(empty(kind), pose, frames))
    stamp = odometry.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == pose.t_ns
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    np.testing.assert_array_equal(odometry.pose.covariance.reshape(6, 6), pose.pose_covariance)
    np.testing.assert_array_equal(odometry.twist.covariance.reshape(6, 6), pose.twist_covariance)
    assert odometry.twist.twist.linear.x == pose.linear[0]
    kind = "geometry_msgs/msg/TransformStamped"
    transform = frozen(kind, fill_transform(empty(kind), pose, frames))
    assert transform.transform.translation.y == pose.position[1]
    assert transform.transform.rotation.w == pose.quaternion[3]


@pytest.mark.parametrize(("health", "level"), [(Health.TRACKING, 0), (Health.DEGRADED, 1), (Health.LOST, 2)])
def test_diagnostics(health: Health, level: int) -> None:
    status = status_of(LiveStep(StepReport(1, health, "no events", segment=3)), {"damaged messages": 4})
    assert isinstance(status, Status)
    kind, item = "diagnostic_msgs/msg/DiagnosticArray", "diagnostic_msgs/msg/DiagnosticStatus"
    filled = fill_diagnostics(
        empty(kind), status, 5 * 10**9, lambda: empty(item), lambda: empty("diagnostic_msgs/msg/KeyValue")
    )
    found = frozen(kind, filled).status[0]
    assert (found.level, found.message) == (level, f"{health}: no events")
    assert {value.key: value.value for value in found.values}["damaged messages"] == "4"


@pytest.mark.parametrize("values", [[0.0] * 7, [0.0] * 6, [0, 0, 0, 0, 0, 0, np.nan]])
def test_a_wrong_transform_is_rejected(values: list[float]) -> None:
    with pytest.raises(ConfigError, match="seven numbers"):
        transform_of(values)
