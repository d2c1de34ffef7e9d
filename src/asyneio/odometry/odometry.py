"""Asynchronous event-inertial odometry (Fig. 2): one packet in, the estimates it made possible out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.config import Config
from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.solver.covariance import joint_covariance
from asyneio.estimation.solver.optimizer import Solution
from asyneio.estimation.window import Window
from asyneio.inertial.repeats import RenewedPackets
from asyneio.odometry.attitude import AttitudeFilter
from asyneio.odometry.blas import one_blas_thread
from asyneio.odometry.buffer import MeasurementBuffer, until
from asyneio.odometry.health.metrics import sample_gap_s
from asyneio.odometry.health.monitor import Advance, HealthMonitor
from asyneio.odometry.initializer.initialize import RETRY_NS, attempt_start
from asyneio.odometry.initializer.known_state import checked
from asyneio.odometry.learned_noise import LearnedNoise
from asyneio.odometry.memory import keep_freed_memory
from asyneio.odometry.outliers import optimize_without_outliers
from asyneio.odometry.outputs import camera_of, estimate_of, newest_estimate, trajectory_of
from asyneio.odometry.propagated_trajectory import PropagatedTrajectory
from asyneio.odometry.propagation import predict_knot
from asyneio.odometry.settings import Settings, resolve
from asyneio.odometry.stationary import StationaryDetector
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.types import (
    NS_PER_S,
    Attitude,
    Calibration,
    CalibrationEstimate,
    Estimate,
    Health,
    InitialState,
    Packet,
    StepReport,
)

#: The end of a rest is noticed late: what was said of the stretch before it [ns] is taken back.
_REST_DOUBT_NS = 200_000_000


class Odometry:
    """Feature tracks and inertial samples in, metric states with covariance out, causal.

    The world frame has z up and its origin and yaw at the first knot. Where nothing connects a state with the
    one before, or it can no longer be trusted, the segment ends (LOST) and the next start begins another,
    with a world of its own.

    Args:
        config: all settings.
        calibration: of the rig.
        initial_state: where it is known: the first segment begins there, in the world of that state, and what
            was measured before it is left out. `process` raises `EstimationError` where the inertial samples
            do not reach back to it.

    Raises:
        EstimationError: `initial_state` is no state.
    """

    def __init__(
        self, config: Config, calibration: Calibration, initial_state: InitialState | None = None
    ) -> None:
        keep_freed_memory()
        self._first_state = None if initial_state is None else checked(initial_state)
        self._config = config
        self._calibration = calibration
        self._segment = 0
        self._inertial_rejected = 0
        self._packet_ns: int | None = None
        self._noise = LearnedNoise(config.inertial, calibration.noise, config.window.knot_interval_s)
        self._renewed = RenewedPackets()
        self._begin_segment()
        self._attitude = AttitudeFilter(config.inertial, calibration.noise.gyroscope_walk)
        self._upright: Attitude | None = None

    def _begin_segment(self) -> None:
        """Forget everything but how noisy the sensors are: nothing from before may enter the next start."""
        config, calibration = self._config, self._calibration
        self._intake = MeasurementBuffer(calibration.camera, config.visual.pixel_sigma, calibration.noise)
        self._rest = StationaryDetector(config.inertial, calibration, config.visual.pixel_sigma)
        inertial = config.inertial
        bias_sigma = [inertial.initial_gyroscope_bias_sigma, inertial.initial_accelerometer_bias_sigma]
        self._watch = HealthMonitor(config.health, calibration, np.repeat(bias_sigma, 3))
        self._gated = 0.0
        self._latest: Estimate | None = None
        self._settings: Settings | None = None
        self._window: Window | None = None
        self._solution: Solution | None = None
        self._next_attempt_ns: int | None = None
        self._refusal = "collecting measurements"
        self.origin: Estimate | None = None

    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Take a packet and return the newest states it gives; one from before the last ends the segment.

        States of a step that turns out LOST are not given out. BLAS uses one thread meanwhile.
        """
        with one_blas_thread():
            return self._process(packet)

    def _process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        packet = self._renewed.passed(packet)
        before_ns, self._packet_ns = self._packet_ns, packet.t_end_ns
        if before_ns is not None and packet.t_end_ns < before_ns:
            back_s = (before_ns - packet.t_end_ns) / NS_PER_S
            estimates: list[Estimate] = []
            report = self._interrupted(packet, f"time jumps back by {back_s:.3f} s")
        else:
            estimates, report = self._step(packet, before_ns)
        posed = report.health in (Health.TRACKING, Health.DEGRADED)
        return estimates, replace(
            report,
            still=self._rest.still,
            attitude=None if posed else self._upright,
            refused=self._intake.refused_share(packet.observations["id"]),
            noise=self._noise.estimate(),
            inertial_rejected=self._inertial_rejected,
        )

    def _step(self, packet: Packet, before_ns: int | None) -> tuple[list[Estimate], StepReport]:
        """Start, or advance by the knots that the packet completes; `before_ns`: end of the packet before."""
        self._take(packet)
        renewed = self._watch.see(packet)
        if self._window is not None:
            return self._track(packet.t_end_ns)
        if renewed:
            return [], self._interrupted(packet, "all feature tracks were replaced at once")
        gap_s = 0.0 if before_ns is None else self._gap_s(before_ns, packet.t_end_ns)
        if gap_s > self._config.health.lost_inertial_gap_s:
            return [], self._interrupted(packet, f"no inertial samples for {gap_s:.2f} s")
        return self._try_start(packet.t_end_ns)

    def _take(self, packet: Packet) -> None:
        self._noise.append(*self._intake.append(packet, self._renewed.rates_hz))
        samples = len(packet.gyroscope) + len(packet.accelerometer)
        # Kept apart from the buffer, which a lost segment discards.
        self._inertial_rejected = self._intake.gated
        self._gated = self._intake.gated / max(samples, 1)
        self._rest.append(packet)
        streams = packet.gyroscope, packet.accelerometer
        self._upright = self._attitude.update(*streams, packet.t_end_ns, self._noise.now())

    def _track(self, t_ns: int) -> tuple[list[Estimate], StepReport]:
        """All knots that the intake covers."""
        estimates: list[Estimate] = []
        health, reason = self._watch.state()
        try:
            while (knot_ns := self._next_knot_ns()) is not None:
                advance = self._advance(knot_ns)
                estimate = self._newest()
                health, reason = self._watch.judge(estimate, advance)
                if health is Health.LOST:
                    break
                estimates.append(estimate)
                self._slide()
        except (EstimationError, InertialError) as error:
            health, reason = Health.LOST, str(error)
        if health is Health.LOST:
            report = StepReport(t_ns, health, reason, segment=self._segment)
            self._segment += 1
            self._begin_segment()
            return estimates, report
        return estimates, self._report(t_ns, health, reason)

    def _interrupted(self, packet: Packet, reason: str) -> StepReport:
        """The stream does not go on where it was: begin again with this packet."""
        health = Health.INITIALIZING if self._window is None else Health.LOST
        report = StepReport(packet.t_end_ns, health, reason, segment=self._segment)
        self._segment += health is Health.LOST
        self._begin_segment()
        self._attitude = AttitudeFilter(self._config.inertial, self._calibration.noise.gyroscope_walk)
        self._take(packet)
        return report

    def trajectory(self) -> GPTrajectory | PropagatedTrajectory:
        """The continuous-time trajectory through the present window, with covariance.

        Under the scheme GPP, which has no kinematic prior, one that propagates each knot.

        Raises:
            EstimationError: the odometry has not started.
        """
        window, _, settings = self._active()
        return trajectory_of(window, self._solved(), settings)

    def calibration(self) -> CalibrationEstimate | None:
        """What is believed of the camera now; None before the present segment has started."""
        return None if self._window is None else camera_of(self._window, self._solved())

    def _advance(self, knot_ns: int) -> Advance:
        """Predict the knot, add what was measured since the last one, optimise."""
        window, intake, settings = self._active()
        from_ns = int(window.t_ns[-1])
        # A packet may reach beyond the knot: its first guess uses nothing later than itself.
        streams = (until(intake.gyroscope, knot_ns), until(intake.accelerometer, knot_ns))
        observations = intake.observations.between(from_ns, knot_ns)
        gap_s = self._gap_s(from_ns, knot_ns)
        knot = predict_knot(window.states, from_ns, knot_ns, streams, settings.window.gravity_w)
        known = window.states.r
        self._noise.learn_until(knot_ns)
        still = self._rest.judge(from_ns, knot_ns, self._latest, self._noise.at_rest())
        window.extend(knot_ns, knot, *streams, observations, still, self._noise.now())
        if not still:
            window.revert_zero_velocity(from_ns - _REST_DOUBT_NS)
        window.add_landmarks()
        self._solution, outliers = optimize_without_outliers(window, settings.optimizer)
        intake.refuse(outliers)
        window.remove_tracks(intake.refuse_doubtful(window.landmarks.track, knot_ns))
        intake.drop_until(knot_ns)
        return Advance(
            solution=self._solution,
            known=known,
            stamps=observations.t_ns,
            gap_s=gap_s,
            gated=self._gated,
            saturated=intake.saturated,
            still=still,
        )

    def _gap_s(self, start_ns: int, end_ns: int) -> float:
        return sample_gap_s((self._intake.gyroscope, self._intake.accelerometer), start_ns, end_ns)

    def _slide(self) -> None:
        """Marginalise until the window has its length."""
        window, _, settings = self._active()
        while window.span_s() > settings.window_s + 1e-6:
            window.marginalize_oldest()

    def _next_knot_ns(self) -> int | None:
        window, intake, settings = self._active()
        knot_ns = int(window.t_ns[-1]) + settings.knot_interval_ns
        return knot_ns if intake.end_ns is not None and knot_ns <= intake.end_ns else None

    def _active(self) -> tuple[Window, MeasurementBuffer, Settings]:
        if self._window is None or self._settings is None:
            raise EstimationError("the odometry has not started; expected packets until it is initialised")
        return self._window, self._intake, self._settings

    def _solved(self) -> Solution:
        if self._solution is None:
            raise EstimationError("no solution yet; expected an optimised window")
        return self._solution

    def _try_start(self, t_ns: int) -> tuple[list[Estimate], StepReport]:
        self._noise.learn_until(t_ns)
        self._rest.judge(t_ns, t_ns, None, self._noise.at_rest())
        if self._first_state is None and self._next_attempt_ns is not None and t_ns < self._next_attempt_ns:
            return [], self._initializing(t_ns, self._refusal)
        self._next_attempt_ns = t_ns + RETRY_NS
        self._intake.drop_until(t_ns - round(self._config.initialization.max_seconds * NS_PER_S))
        self._settings = resolve(self._config, self._calibration, self._noise.now())
        started = attempt_start(self._intake, self._settings, self._rest.rest, self._first_state)
        if isinstance(started, str):
            self._refusal = started
            return [], self._initializing(t_ns, started)
        self._first_state = None
        self._window, self._solution = started.window, started.solution
        covariance = joint_covariance(self._solution, 0)[:24, :24]
        self.origin = estimate_of(self._window, 0, covariance, self._segment)
        self._intake.drop_until(int(self._window.t_ns[-1]))
        estimate = self._newest()
        self._slide()
        return [estimate], self._report(t_ns, Health.TRACKING)

    def _initializing(self, t_ns: int, reason: str) -> StepReport:
        return StepReport(t_ns, Health.INITIALIZING, reason, segment=self._segment)

    def _newest(self) -> Estimate:
        window, _, settings = self._active()
        self._latest = newest_estimate(window, self._solved(), settings, self._segment)
        return self._latest

    def _report(self, t_ns: int, health: Health, reason: str = "") -> StepReport:
        window, _, _ = self._active()
        r = self._solved().report
        return StepReport(
            t_ns,
            health,
            reason,
            segment=self._segment,
            knots=window.knots,
            landmarks=len(window.landmarks),
            observations=window.observations,
            iterations=r.iterations,
            cost=r.cost,
            rejected=r.rejected,
        )
