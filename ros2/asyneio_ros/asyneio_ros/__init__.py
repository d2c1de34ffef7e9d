"""ROS 2 node of asyneio."""
