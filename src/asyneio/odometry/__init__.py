"""The odometry: packets in, estimates out. No files, no clocks, no viewers."""

from asyneio.odometry.odometry import Odometry

__all__ = ["Odometry"]
