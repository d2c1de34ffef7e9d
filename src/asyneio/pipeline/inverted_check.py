# SPDX-License-Identifier: Apache-2.0
"""Whether the accelerometer is inverted: asked only after a run that did not initialize.

The samples alone cannot show it: both signs of the specific force give a magnitude and a rotation of gravity
that agree with the gyroscope. With the tracks it is observable. Their motion, times a positive scale, must
have the measured acceleration; inverted readings require a negative scale, with all features behind the
camera. Therefore the start of the recording is repeated with the opposite sign. If this initializes and keeps
tracking, the sign is the cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from asyneio.errors import AsyneioError
from asyneio.pipeline.packets import packets
from asyneio.pipeline.summarize import Grid
from asyneio.pipeline.track_source import ReplayedStream
from asyneio.types import NS_PER_S, EventRecording, Health, RecordArray, Recording

if TYPE_CHECKING:
    from asyneio.pipeline.run import Estimator

#: Part of the recording that is repeated, at its start [s].
_SPAN_S = 30.0
#: Time without interruption in the state TRACKING that confirms the opposite sign [s].
_TRACKING_S = 2.0


def inverted_accelerometer(
    recording: Recording | EventRecording,
    observations: RecordArray,
    grid: Grid,
    create: Callable[[], Estimator],
) -> str:
    """Why a run did not initialize, if the accelerometer is inverted, as a phrase; empty otherwise.

    Args:
        recording: of the run.
        observations: of the run (OBSERVATION_DTYPE, IMU clock), ascending.
        grid: of the run.
        create: creates an estimator with the settings and the calibration of the run.
    """
    accelerometer = recording.accelerometer.copy()
    accelerometer["xyz"] *= -1.0
    opposite = replace(recording, accelerometer=accelerometer)
    packet_s = grid.interval_ns / NS_PER_S
    tracking, needed = 0, round(_TRACKING_S / packet_s)
    total = min(grid.total, round(_SPAN_S / packet_s))
    source, estimator = ReplayedStream(observations, grid.ends_ns()[: total + 1]), create()
    try:
        for packet in packets(opposite, grid.start_ns, grid.interval_ns, total, source):
            _, report = estimator.process(packet)
            tracking = tracking + 1 if report.health is Health.TRACKING else 0
            if tracking >= needed:
                return (
                    "the accelerometer is inverted: with the opposite sign of all its axes, the estimator "
                    "initializes and tracks; expected specific force, which points up (+9.81 m/s^2) when "
                    "stationary: multiply the readings by -1"
                )
    except AsyneioError:
        pass
    return ""
