"""The ROS 2 node: subscriptions, parameters and publishers; everything else is in `asyneio.ros2`."""

from __future__ import annotations

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosidl_runtime_py.utilities import get_message
from sensor_msgs.msg import Imu
from tf2_ros import TransformBroadcaster

from asyneio.errors import AsyneioError
from asyneio.ros2.messages import fill_diagnostics, fill_odometry, fill_transform
from asyneio.ros2.odometry_thread import OdometryThread
from asyneio.ros2.parameters import parameter_defaults, resolve_parameters
from asyneio.ros2.poses import RosPose

#: Drivers publish with best effort; a deep queue bridges pauses of the executor.
_SENSORS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


class AsyneioNode(Node):
    """Topics: `events` and `imu` in; `odometry`, `/tf` and `/diagnostics` out."""

    def __init__(self) -> None:
        super().__init__("asyneio")
        # An integer in a parameter file is accepted for a real number; asyneio checks the values.
        any_type = ParameterDescriptor(dynamic_typing=True)
        for name, default in parameter_defaults().items():
            self.declare_parameter(name, default, any_type)
        values = {name: self.get_parameter(name).value for name in parameter_defaults()}
        self._settings = resolve_parameters(values)
        for note in self._settings.notes:
            self.get_logger().info(note)
        self._odometry = self.create_publisher(Odometry, "odometry", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._tf = TransformBroadcaster(self) if self._settings.publish_tf else None
        self._thread = OdometryThread(self._settings, self._publish, self.get_logger().info)
        events = get_message(self._settings.events_type)
        self.create_subscription(events, "events", self._thread.put_events, _SENSORS, raw=True)
        self.create_subscription(Imu, "imu", self._thread.put_imu, _SENSORS, raw=True)
        self.create_timer(1.0, self._diagnose)
        self._thread.start()

    def _publish(self, pose: RosPose) -> None:
        frames = self._settings.frames
        self._odometry.publish(fill_odometry(Odometry(), pose, frames))
        if self._tf is not None:
            self._tf.sendTransform(fill_transform(TransformStamped(), pose, frames))

    def _diagnose(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        status = self._thread.status()
        self._diagnostics.publish(
            fill_diagnostics(DiagnosticArray(), status, now_ns, DiagnosticStatus, KeyValue)
        )

    def destroy_node(self) -> None:
        """Process what has arrived, then end."""
        self._thread.stop()
        super().destroy_node()


def main() -> int:
    """Run the node until it is shut down; returns the exit status."""
    rclpy.init()
    try:
        node = AsyneioNode()
    except AsyneioError as error:
        rclpy.logging.get_logger("asyneio").fatal(str(error))
        rclpy.try_shutdown()
        return 1
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0
