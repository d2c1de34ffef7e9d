"""Watches over one segment: puts together what stream and window tell, and asks for the health."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.config import HealthConfig
from asyneio.estimation.solver.optimizer import Solution
from asyneio.odometry.health.continuity import Continuity, Jumps, field_of_view
from asyneio.odometry.health.metrics import Observed, ScaleChanges, measure_health
from asyneio.odometry.health.state_machine import HealthStateMachine
from asyneio.types import NS_PER_S, Calibration, Estimate, FloatArray, Health, IntArray, Packet


@dataclass(frozen=True)
class Advance:
    """What one knot brought.

    `solution`: of the window. `known` (K,3) [m]: positions of the knots before it, before it was solved;
    `stamps` [ns] of the observations since the knot before; `gap_s`, `gated`, `saturated`, `still` as in
    `HealthMetrics`.
    """

    solution: Solution
    known: FloatArray
    stamps: IntArray
    gap_s: float
    gated: float = 0.0
    saturated: bool = False
    still: bool = False


class HealthMonitor:
    """Sees every packet and every knot of a segment.

    Args:
        config: the section `health`.
        calibration: for the camera's field of view and axes.
        bias_sigma: (6,) of the prior on the first biases.
    """

    def __init__(self, config: HealthConfig, calibration: Calibration, bias_sigma: FloatArray) -> None:
        self._monitor = HealthStateMachine(config)
        self._continuity = Continuity(field_of_view(calibration.camera))
        self._C_b_c = calibration.T_b_c[:3, :3]
        self._jumps = Jumps()
        self._scale_changes = ScaleChanges()
        self._bias_sigma = bias_sigma
        self._packet_ns: int | None = None
        self._observed_ns: int | None = None
        self._renewed = False

    def see(self, packet: Packet) -> bool:
        """Whether a packet shows another scene than those before it."""
        span_s = 0.0 if self._packet_ns is None else (packet.t_end_ns - self._packet_ns) / NS_PER_S
        rates = packet.gyroscope["xyz"]
        turn_b = rates.mean(axis=0) * span_s if len(rates) else np.zeros(3)
        seen = packet.observations
        self._jumps.see(packet.gyroscope, packet.accelerometer)
        replaced = self._continuity.renewed(packet.t_end_ns, seen["t_ns"], seen["id"], turn_b @ self._C_b_c)
        self._renewed = replaced and self._jumps.lately(packet.t_end_ns)
        self._packet_ns = packet.t_end_ns
        return self._renewed

    def state(self) -> tuple[Health, str]:
        """Health after the newest knot, and why."""
        return self._monitor.health, self._monitor.reason

    def judge(self, estimate: Estimate, advance: Advance) -> tuple[Health, str]:
        """Health after a knot, and why."""
        t_ns = estimate.t_ns
        if len(advance.stamps):
            self._observed_ns = int(advance.stamps[-1])
        # At rest nothing is seen, and nothing is missed.
        elif self._observed_ns is None or advance.still:
            self._observed_ns = t_ns
        observed = Observed(
            since_vision_s=(t_ns - self._observed_ns) / NS_PER_S,
            inertial_gap_s=advance.gap_s,
            renewed=self._renewed,
            scale_change=self._scale_changes.add(
                t_ns, advance.known, advance.solution.problem.states.r[: len(advance.known)]
            ),
            gated=advance.gated,
            saturated=advance.saturated,
            still=advance.still,
        )
        vitals = measure_health(advance.solution, estimate, observed, self._bias_sigma)
        return self._monitor.update(t_ns, vitals)
