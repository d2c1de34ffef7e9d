# SPDX-License-Identifier: Apache-2.0
"""The odometry: takes packets, returns estimates. It knows no files, clocks or viewers."""

from asyneio.odometry.odometry import Odometry

__all__ = ["Odometry"]
