"""Start the odometry node: `ros2 launch asyneio_ros odometry.launch.py calibration:=FILE imu:=FILE`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

_PARAMETERS = PathJoinSubstitution([FindPackageShare("asyneio_ros"), "config", "asyneio.yaml"])
_ARGUMENTS = {
    "parameters": (_PARAMETERS, "parameter file of the node"),
    "calibration": ("", "calibration of camera and IMU"),
    "imu": ("", "noise of the IMU"),
    "events_type": ("event_camera_msgs/msg/EventPacket", "type of the event messages"),
    "events_topic": ("/event_camera/events", "topic with the events"),
    "imu_topic": ("/imu/data_raw", "topic with the inertial samples"),
}


def generate_launch_description() -> LaunchDescription:
    """Arguments, and the node."""
    given = {name: LaunchConfiguration(name) for name in _ARGUMENTS}
    node = Node(
        package="asyneio_ros",
        executable="odometry",
        name="asyneio",
        output="screen",
        parameters=[
            given["parameters"],
            {
                "calibration_file": given["calibration"],
                "imu_file": given["imu"],
                "events_type": given["events_type"],
            },
        ],
        remappings=[("events", given["events_topic"]), ("imu", given["imu_topic"])],
    )
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=about)
        for name, (default, about) in _ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, node])
