"""A fake estimator on a straight path: fast, and able to fail in the same ways as the real one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.config import Config
from asyneio.errors import EstimationError
from asyneio.types import (
    Attitude,
    Calibration,
    CalibrationEstimate,
    Estimate,
    Health,
    InitialState,
    Packet,
    StepReport,
)
from tests.io.recordings import make_estimate


class FakeOdometry:
    """Initializes after the third packet, then returns one estimate per packet."""

    start_after = 3

    def __init__(
        self, config: Config, calibration: Calibration, initial_state: InitialState | None = None
    ) -> None:
        self.seen = 0
        self._rng = np.random.default_rng(0)

    def calibration(self) -> CalibrationEstimate | None:
        return CalibrationEstimate(-3.1e-3, np.eye(3), np.array([2e-4, 0.0, 0.0, 0.0])) if self.seen else None

    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        self.seen += 1
        if self.seen <= self.start_after:
            return [], StepReport(packet.t_end_ns, Health.INITIALIZING, "too few feature tracks")
        return self.track(packet)

    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        report = StepReport(packet.t_end_ns, Health.TRACKING, knots=10, landmarks=40, rejected=2)
        return [make_estimate(packet.t_end_ns, self._rng)], report


class NeverStarts(FakeOdometry):
    start_after = 10**9


class LosesTrack(FakeOdometry):
    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        if self.seen > 20:
            return [], StepReport(packet.t_end_ns, Health.LOST, "speed of 80 m/s")
        return super().track(packet)


class SkipsAWhile(FakeOdometry):
    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        if 20 <= self.seen < 30:
            return [], StepReport(packet.t_end_ns, Health.LOST, "no features")
        return super().track(packet)


class StartsAgain(FakeOdometry):
    """Lost at the 20th packet; a second segment from the 26th on, with its own world frame."""

    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        if self.seen < 20:
            return super().track(packet)
        if self.seen == 20:
            return [], StepReport(packet.t_end_ns, Health.LOST, "the stream is cut")
        if self.seen < 26:
            attitude = Attitude(packet.t_end_ns, np.eye(3), 0.01)
            report = StepReport(packet.t_end_ns, Health.INITIALIZING, "again", segment=1, attitude=attitude)
            return [], report
        estimates, report = super().track(packet)
        moved = np.eye(4)
        moved[:3, 3] = [5.0, -3.0, 1.0]
        return [replace(e, T_w_b=moved @ e.T_w_b, segment=1) for e in estimates], replace(report, segment=1)


class Degraded(FakeOdometry):
    """Complete, but degraded for four packets."""

    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        estimates, report = super().track(packet)
        if 8 <= self.seen < 12:
            report = replace(report, health=Health.DEGRADED, reason="no observations for 0.20 s")
        return estimates, report


class Diverges(FakeOdometry):
    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        estimates, report = super().track(packet)
        return [replace(estimate, T_w_b=np.full((4, 4), np.nan)) for estimate in estimates], report


class Raises(FakeOdometry):
    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        if self.seen > 20:
            raise EstimationError("the system is singular")
        return super().track(packet)
