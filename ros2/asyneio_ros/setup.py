"""Installation of the ROS 2 package by colcon."""

from setuptools import setup

setup(
    name="asyneio_ros",
    version="0.1.0",
    packages=["asyneio_ros"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/asyneio_ros"]),
        ("share/asyneio_ros", ["package.xml"]),
        ("share/asyneio_ros/launch", ["launch/odometry.launch.py"]),
        ("share/asyneio_ros/config", ["config/asyneio.yaml"]),
    ],
    install_requires=["setuptools", "asyneio"],
    zip_safe=True,
    license="Apache-2.0",
    entry_points={"console_scripts": ["odometry = asyneio_ros.node:main"]},
)
