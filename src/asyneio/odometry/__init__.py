"""The odometry: takes packets, returns estimates. It knows no files, clocks or viewers."""

from asyneio.odometry.odometry import Odometry

__all__ = ["Odometry"]
