# SPDX-License-Identifier: Apache-2.0
"""Estimates as ROS poses: `odom` to `base_link` (REP-105), with covariances as the messages order them.

`nav_msgs/Odometry` orders covariances as (x, y, z, rotation about x, y, z). That of the pose is along the
fixed axes of `header.frame_id`, that of the twist in `child_frame_id`. An estimate has the error state
`[phi, rho]` of a right perturbation, in the frame of the IMU (docs/conventions.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import ConfigError
from asyneio.state import NU, OMEGA, PHI, RHO
from asyneio.types import NS_PER_S, Estimate, FloatArray


@dataclass(frozen=True)
class RosPose:
    """One estimate in ROS conventions.

    `position` (3,) [m] and `quaternion` (4,) xyzw of base in odom; `linear` (3,) [m/s] and `angular` (3,)
    [rad/s] in the base frame; covariances (6,6) in the order of the messages.
    """

    t_ns: int
    segment: int
    position: FloatArray
    quaternion: FloatArray
    pose_covariance: FloatArray
    linear: FloatArray
    angular: FloatArray
    twist_covariance: FloatArray


@dataclass
class _Odom:
    """The odometry frame of a segment: yaw and position of its world, and variance from before."""

    T_o_w: FloatArray = field(default_factory=lambda: np.eye(4))
    variance: FloatArray = field(default_factory=lambda: np.zeros((6, 6)))


class PosesInOdom:
    """Converts estimates. `odom` is continuous: a new segment begins at position and yaw of the last pose.

    While the state was lost the base moved on. Its displacement is unknown; the covariance of position grows
    by the square of last speed times elapsed time.

    Args:
        T_base_imu: (4,4), maps IMU to base coordinates.
    """

    def __init__(self, T_base_imu: FloatArray) -> None:
        self._T_base_imu = T_base_imu
        self._T_imu_base = np.linalg.inv(T_base_imu)
        self._adjoint = _adjoint(T_base_imu)
        self._odom = _Odom()
        self._last: RosPose | None = None

    def convert(self, estimate: Estimate) -> RosPose:
        """An estimate, later than all before."""
        T_w_base = estimate.T_w_b @ self._T_imu_base
        if self._last is not None and estimate.segment != self._last.segment:
            self._continue(T_w_base, estimate.t_ns, self._last)
        T = self._odom.T_o_w @ T_w_base
        C_b_w = estimate.T_w_b[:3, :3].T
        twist = self._adjoint @ np.concatenate([estimate.angular_velocity_b, C_b_w @ estimate.velocity_w])
        pose = RosPose(
            t_ns=estimate.t_ns,
            segment=estimate.segment,
            position=T[:3, 3].copy(),
            quaternion=Rotation.from_matrix(T[:3, :3]).as_quat(),
            pose_covariance=self._pose_covariance(estimate.covariance, T[:3, :3]),
            linear=twist[3:],
            angular=twist[:3],
            twist_covariance=self._twist_covariance(estimate.covariance),
        )
        self._last = pose
        return pose

    def _pose_covariance(self, covariance: FloatArray, C_o_base: FloatArray) -> FloatArray:
        own = self._adjoint @ covariance[PHI : RHO + 3, PHI : RHO + 3] @ self._adjoint.T
        J = np.zeros((6, 6))
        # Rows (position, rotation) of the message, columns [phi, rho] of the error state.
        J[:3, 3:] = J[3:, :3] = C_o_base
        return J @ own @ J.T + self._odom.variance

    def _twist_covariance(self, covariance: FloatArray) -> FloatArray:
        own = self._adjoint @ covariance[OMEGA : NU + 3, OMEGA : NU + 3] @ self._adjoint.T
        order = [3, 4, 5, 0, 1, 2]
        return own[np.ix_(order, order)]

    def _continue(self, T_w_base: FloatArray, t_ns: int, last: RosPose) -> None:
        """Place the world of a new segment so that position and yaw of the base continue."""
        before = Rotation.from_quat(last.quaternion).as_matrix()
        turn = _yaw(before) - _yaw(T_w_base[:3, :3])
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
        T[:3, 3] = last.position - T[:3, :3] @ T_w_base[:3, 3]
        moved_m = float(np.linalg.norm(last.linear)) * (t_ns - last.t_ns) / NS_PER_S
        variance = np.zeros((6, 6))
        variance[:3, :3] = last.pose_covariance[:3, :3] + moved_m**2 * np.eye(3)
        variance[5, 5] = last.pose_covariance[5, 5]
        self._odom = _Odom(T, variance)


def transform_of(values: list[float]) -> FloatArray:
    """(4,4) from `[x, y, z, qx, qy, qz, qw]`.

    Raises:
        ConfigError: other than seven finite numbers, or a quaternion of another norm than 1.
    """
    numbers = np.asarray(values, dtype=np.float64)
    unit = numbers.shape == (7,) and abs(float(np.linalg.norm(numbers[3:])) - 1.0) < 1e-3
    if not unit or not np.isfinite(numbers).all():
        raise ConfigError(
            f"found {values} for base_from_imu; expected seven numbers x, y, z [m], qx, qy, qz, qw with a "
            "quaternion of norm 1"
        )
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3]
    return T


def _adjoint(T: FloatArray) -> FloatArray:
    """(6,6), maps twists and error states [rotation, translation] by T."""
    C, r = T[:3, :3], T[:3, 3]
    cross = np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
    found = np.zeros((6, 6))
    found[:3, :3] = found[3:, 3:] = C
    found[3:, :3] = cross @ C
    return found


def _yaw(C: FloatArray) -> float:
    return float(np.arctan2(C[1, 0], C[0, 0]))
