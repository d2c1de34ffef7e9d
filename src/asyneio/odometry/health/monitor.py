# SPDX-License-Identifier: Apache-2.0
"""Health of one segment: combines what packets, window and estimate show."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from asyneio.config import HealthConfig
from asyneio.estimation.solver.covariance import relative_scale_sigma
from asyneio.estimation.solver.optimizer import Solution
from asyneio.odometry.health.continuity import Continuity, Jumps, field_of_view
from asyneio.odometry.health.metrics import ScaleChanges, velocity_revision, with_estimate
from asyneio.odometry.health.state_machine import HealthMetrics, HealthStateMachine, HealthStatus
from asyneio.odometry.intervals import Interval
from asyneio.odometry.raw_measurements import RawMeasurements
from asyneio.types import NS_PER_S, Calibration, Estimate, FloatArray, Packet

#: Time [ns] after which an initialization is confirmed during which a moving object was in view: the tracks
#: that it was estimated from have left the window.
_CONFIRMED_NS = 3 * NS_PER_S // 2


class Step(NamedTuple):
    """What one knot added to the window.

    `interval` before the knot; `stationary` in it; `positions` (K,3) [m] of the earlier knots before, and
    `solution` after the optimisation; `estimate` of the new knot; `rejected_tracks`, the share of the
    interval's new tracks that were rejected.
    """

    interval: Interval
    stationary: bool
    positions: FloatArray
    solution: Solution
    estimate: Estimate
    rejected_tracks: float = 0.0


class HealthMonitor:
    """Takes every packet and every knot of a segment.

    Attributes:
        scene_changed: whether the newest packet shows another scene than the packets before it.
    """

    def __init__(self, config: HealthConfig, calibration: Calibration, bias_sigma: FloatArray) -> None:
        """`bias_sigma` (6,) of the prior on the first biases."""
        self._state = HealthStateMachine(config)
        self._continuity = Continuity(field_of_view(calibration.camera))
        self._C_b_c = calibration.T_b_c[:3, :3]
        self._jumps = Jumps()
        self._scale_changes = ScaleChanges()
        self._bias_sigma = bias_sigma
        self._max_scale_sigma = config.max_scale_sigma
        self._scale_uncertain = False
        self._unconfirmed_until_ns = 0
        #: The newest estimate; None after a stationary interval.
        self._previous: Estimate | None = None
        self._packet_ns: int | None = None
        self._observed_ns: int | None = None
        self.scene_changed = False
        #: Fields of `StepReport`: normalized squared residuals of the newest interval.
        self.nis: dict[str, Any] = {}

    @property
    def status(self) -> HealthStatus:
        """Health after the newest knot, and the reason."""
        return HealthStatus(self._state.health, self._state.reason)

    def begin(self, first: Estimate, scale_sigma: float, object_in_view: bool = False) -> HealthStatus:
        """Health after an initialization: its newest estimate, its relative standard deviation of scale, and
        whether a moving object was in view."""
        self._previous = first
        self._scale_uncertain = scale_sigma > self._max_scale_sigma
        if object_in_view:
            self._unconfirmed_until_ns = first.t_ns + _CONFIRMED_NS
        return self._state.update(
            first.t_ns, HealthMetrics(scale_sigma=scale_sigma, unconfirmed=object_in_view)
        )

    def append(self, packet: Packet, raw: RawMeasurements) -> None:
        """Take a packet; `raw` ends with its samples."""
        span_s = 0.0 if self._packet_ns is None else (packet.t_end_ns - self._packet_ns) / NS_PER_S
        rates = packet.gyroscope["xyz"]
        turn_b = rates.mean(axis=0) * span_s if len(rates) else np.zeros(3)
        seen = packet.observations
        self._jumps.update(raw)
        replaced = self._continuity.all_replaced(
            packet.t_end_ns, seen["t_ns"], seen["id"], turn_b @ self._C_b_c
        )
        self.scene_changed = replaced and self._jumps.recent(packet.t_end_ns)
        self._packet_ns = packet.t_end_ns

    def update(self, step: Step) -> HealthStatus:
        """Health after a knot, and the reason."""
        t_ns, interval = step.estimate.t_ns, step.interval
        stamps = interval.observations.t_ns
        if len(stamps):
            self._observed_ns = int(stamps[-1])
        # Nothing is observed while stationary, and nothing is missing.
        elif self._observed_ns is None or step.stationary:
            self._observed_ns = t_ns
        positions = step.solution.problem.states.r[: len(step.positions)]
        revision = 0.0
        if self._previous is not None and not step.stationary:
            revision = velocity_revision(self._previous, step.solution.problem.states)
        self._previous = None if step.stationary else step.estimate
        scale_sigma = relative_scale_sigma(step.solution) if self._scale_uncertain else 0.0
        self._scale_uncertain = scale_sigma > self._max_scale_sigma
        metrics = HealthMetrics(
            since_vision_s=(t_ns - self._observed_ns) / NS_PER_S,
            inertial_gap_s=interval.gap_s,
            rejected_samples=interval.rejected_samples,
            rejected_tracks=step.rejected_tracks,
            saturated=interval.saturated,
            scene_changed=self.scene_changed,
            scale_change=self._scale_changes.add(t_ns, step.positions, positions),
            velocity_revision=revision,
            scale_sigma=scale_sigma,
            unconfirmed=t_ns < self._unconfirmed_until_ns,
            stationary=step.stationary,
        )
        metrics = with_estimate(metrics, step.solution, step.estimate, self._bias_sigma)
        self.nis = {"visual_nis": metrics.visual_ratio, "inertial_nis": metrics.inertial_ratio}
        return self._state.update(t_ns, metrics)
