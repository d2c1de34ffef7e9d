# SPDX-License-Identifier: Apache-2.0
"""Fills ROS 2 messages with results. Works on any object with the fields of the message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from asyneio.live.step import LiveStep
from asyneio.ros2.poses import RosPose
from asyneio.types import NS_PER_S, FloatArray, Health

#: Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = b"\x00", b"\x01", b"\x02", b"\x03"
_LEVELS = {Health.TRACKING: OK, Health.DEGRADED: WARN, Health.INITIALIZING: WARN, Health.LOST: ERROR}


@dataclass(frozen=True)
class Frames:
    """Names of the frames."""

    odom: str = "odom"
    base: str = "base_link"


@dataclass(frozen=True)
class Status:
    """State of the odometry: one of the levels above, a text, and values by name."""

    level: bytes
    message: str
    values: Mapping[str, str]


def fill_odometry(message: Any, pose: RosPose, frames: Frames) -> Any:
    """Fill and return a nav_msgs/Odometry."""
    _fill_header(message.header, pose.t_ns, frames.odom)
    message.child_frame_id = frames.base
    _fill_xyz(message.pose.pose.position, pose.position)
    _fill_quaternion(message.pose.pose.orientation, pose.quaternion)
    message.pose.covariance = pose.pose_covariance.ravel()
    _fill_xyz(message.twist.twist.linear, pose.linear)
    _fill_xyz(message.twist.twist.angular, pose.angular)
    message.twist.covariance = pose.twist_covariance.ravel()
    return message


def fill_transform(message: Any, pose: RosPose, frames: Frames) -> Any:
    """Fill and return a geometry_msgs/TransformStamped from odom to base."""
    _fill_header(message.header, pose.t_ns, frames.odom)
    message.child_frame_id = frames.base
    _fill_xyz(message.transform.translation, pose.position)
    _fill_quaternion(message.transform.rotation, pose.quaternion)
    return message


def fill_diagnostics(
    message: Any, status: Status, t_ns: int, new_status: Callable[[], Any], new_value: Callable[[], Any]
) -> Any:
    """Fill and return a diagnostic_msgs/DiagnosticArray.

    Args:
        message: the array.
        status: of the odometry.
        t_ns: present ROS time.
        new_status: makes an empty DiagnosticStatus.
        new_value: makes an empty KeyValue.
    """
    _fill_header(message.header, t_ns, "")
    filled = new_status()
    filled.level, filled.name, filled.message = status.level, "asyneio: odometry", status.message
    filled.hardware_id = "asyneio"
    filled.values = []
    for key, text in status.values.items():
        value = new_value()
        value.key, value.value = key, text
        filled.values.append(value)
    message.status = [filled]
    return message


def status_of(step: LiveStep, counts: Mapping[str, int]) -> Status:
    """The state after a step of the live engine, with further counts by name."""
    report, shed = step.report, step.shed
    reason = f": {report.reason}" if report.reason else ""
    values = {
        "segment": str(report.segment),
        "knots": str(report.knots),
        "landmarks": str(report.landmarks),
        "observations": str(report.observations),
        "rejected observations": str(report.rejected),
        "stationary": str(report.stationary),
        "latency [ms]": f"{1e3 * step.latency_s:.0f}",
        "waiting [ms]": f"{1e3 * step.backlog_s:.0f}",
        "shed events": str(shed.all_events()),
        "shed features": str(shed.features),
        "shed observations": str(shed.observations),
        "late rows": str(shed.late_events + shed.late_samples),
        **{name: str(count) for name, count in counts.items()},
    }
    return Status(_LEVELS[report.health], f"{report.health}{reason}", values)


def _fill_header(header: Any, t_ns: int, frame: str) -> None:
    header.stamp.sec, header.stamp.nanosec = divmod(int(t_ns), NS_PER_S)
    header.frame_id = frame


def _fill_xyz(target: Any, values: FloatArray) -> None:
    target.x, target.y, target.z = (float(value) for value in values)


def _fill_quaternion(target: Any, xyzw: FloatArray) -> None:
    target.x, target.y, target.z, target.w = (float(value) for value in xyzw)
