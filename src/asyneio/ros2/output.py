# SPDX-License-Identifier: Apache-2.0
"""Steps of the live engine as ROS poses."""

from __future__ import annotations

from collections.abc import Callable

from asyneio.live.chunks import Sensor
from asyneio.live.step import LiveStep
from asyneio.ros2.poses import PosesInOdom, RosPose
from asyneio.types import FloatArray


class RosOutput:
    """Publishes every pose and keeps the newest step. See `live.step.Output`.

    Attributes:
        last: the newest step; None before the first one.

    Args:
        T_base_imu: (4,4), maps IMU to base coordinates.
        publish: called with every pose, in the thread of the engine.
    """

    def __init__(self, T_base_imu: FloatArray, publish: Callable[[RosPose], None]) -> None:
        self._poses, self._publish = PosesInOdom(T_base_imu), publish
        self.last: LiveStep | None = None

    def begin(self, sensor: Sensor) -> None:
        """See `Output`."""

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        self.last = step
        for estimate in step.estimates:
            self._publish(self._poses.convert(estimate))

    def end(self) -> None:
        """See `Output`."""

    def notes(self) -> tuple[str, ...]:
        """See `Output`."""
        return ()
