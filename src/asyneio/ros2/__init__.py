# SPDX-License-Identifier: Apache-2.0
"""Live odometry from serialized ROS 2 messages, without ROS: the package `ros2/asyneio_ros` adds the node."""
