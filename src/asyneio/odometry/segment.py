# SPDX-License-Identifier: Apache-2.0
"""A segment: everything that the odometry forgets when it loses track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from asyneio.config import Config
from asyneio.estimation.problem.problem import States
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution
from asyneio.estimation.window import Window
from asyneio.inertial.noise import InertialNoise
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.health.monitor import HealthMonitor
from asyneio.odometry.initializer.consensus import TrackConsensus
from asyneio.odometry.intervals import Interval
from asyneio.odometry.moving_objects import WARY_NS, WARY_SHARE, optimize_warily
from asyneio.odometry.outliers import without_outliers
from asyneio.odometry.stationary import StationaryDetector
from asyneio.types import Calibration, Estimate, Packet, RecordArray


@dataclass
class Tracking:
    """The estimator of a segment that is initialized.

    Attributes:
        window: the sliding window.
        solution: of the newest optimisation.
        newest: estimate of the newest knot.
    """

    window: Window
    solution: Solution
    newest: Estimate

    def extend(self, interval: Interval, knot: States, stationary: bool, noise: InertialNoise) -> None:
        """Append the predicted `knot` (K = 1) and the measurements of the interval before it."""
        streams = interval.streams
        self.window.extend(interval.end_ns, knot, *streams, interval.observations, stationary, noise)
        if not stationary:
            self.window.revert_zero_velocity(interval.start_ns)

    def optimize(self, settings: OptimizerSettings, buffer: MeasurementBuffer) -> Solution:
        """Optimise the window and reject outliers, in the window and in the buffer; the solution.

        Raises:
            EstimationError: as `Window.optimize`.
        """
        knot_ns = int(self.window.t_ns[-1])
        share = buffer.rejected_share(knot_ns - WARY_NS, knot_ns)
        # A fixed bearing is off by its noise, which changes the velocity as an object does.
        if share > WARY_SHARE and self.window.refines_bearings:
            self.window, solution, removed = optimize_warily(self.window, settings)
            buffer.reject(removed)
        else:
            solution = self.window.optimize(settings)
        window = self.window
        self.solution, outliers = without_outliers(window, solution, settings)
        buffer.reject(outliers)
        window.remove_tracks(buffer.reject_by_neighbours(window.landmarks.track, knot_ns))
        buffer.drop_until(knot_ns)
        return self.solution

    def figures(self) -> dict[str, Any]:
        """Fields of `StepReport` that describe window and optimisation."""
        window, report = self.window, self.solution.report
        return {
            "knots": window.knots,
            "landmarks": len(window.landmarks),
            "observations": window.observations,
            "iterations": report.iterations,
            "cost": report.cost,
            "rejected": report.rejected,
        }

    def marginalize_to(self, window_s: float) -> None:
        """Marginalise the oldest knots until the window spans at most `window_s`."""
        while self.window.span_s() > window_s + 1e-6:
            self.window.marginalize_oldest()


class Segment:
    """Measurements and state from the first packet after a loss to the next loss.

    A new segment refers to nothing of the one before it, so that nothing wrong enters its initialization.
    What remains valid after a loss is not kept here: the learned noise and the attitude.

    Attributes:
        number: of the segment, from 0.
        buffer: measurements that the window has not taken yet.
        stationary: decides whether the sensor is stationary.
        health: decides how far the estimates can be trusted.
        tracking: window and solution; None before the segment is initialized.
        consensus: of the tracks and the IMU, before the segment is initialized.
        attempts: number of attempts to initialize in motion that failed.
        next_attempt_ns: time of the next attempt to initialize; None before the first.
        waiting_reason: why the newest attempt to initialize did not succeed.
    """

    def __init__(self, number: int, config: Config, calibration: Calibration) -> None:
        inertial, pixel_sigma = config.inertial, config.visual.pixel_sigma
        bias_sigma = [inertial.initial_gyroscope_bias_sigma, inertial.initial_accelerometer_bias_sigma]
        self.number = number
        self.buffer = MeasurementBuffer(calibration.camera, pixel_sigma, calibration.noise)
        self.stationary = StationaryDetector(inertial, calibration, pixel_sigma)
        self.health = HealthMonitor(config.health, calibration, np.repeat(bias_sigma, 3))
        self.tracking: Tracking | None = None
        self.consensus = TrackConsensus()
        self.attempts = 0
        self.next_attempt_ns: int | None = None
        self.waiting_reason = "collecting measurements"

    def append(self, packet: Packet, rates_hz: tuple[float, float]) -> tuple[RecordArray, RecordArray]:
        """Add a packet; returns its gated samples, as `MeasurementBuffer.append`."""
        samples = self.buffer.append(packet, rates_hz)
        self.health.append(packet, self.buffer.raw)
        return samples

    def due_knots(self, newest_ns: int, interval_ns: int) -> range:
        """Times [ns] of the knots after the one at `newest_ns` that the measurements cover."""
        end_ns = newest_ns if self.buffer.end_ns is None else self.buffer.end_ns
        return range(newest_ns + interval_ns, end_ns + 1, interval_ns)
