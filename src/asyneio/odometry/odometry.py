# SPDX-License-Identifier: Apache-2.0
"""Asynchronous event-inertial odometry (Fig. 2): takes packets, returns the estimates that each completes."""

from __future__ import annotations

import numpy as np

from asyneio.config import Config
from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.solver.covariance import joint_covariance
from asyneio.inertial.repeats import RenewedPackets
from asyneio.odometry.arguments import check_constructor, check_packet
from asyneio.odometry.attitude import AttitudeFilter
from asyneio.odometry.blas import with_one_blas_thread
from asyneio.odometry.health.monitor import Step
from asyneio.odometry.health.state_machine import HealthStatus
from asyneio.odometry.initializer.initialize import Waiting, initialize, retry_ns
from asyneio.odometry.initializer.known_state import checked
from asyneio.odometry.learned_noise import LearnedNoise
from asyneio.odometry.memory import keep_freed_memory
from asyneio.odometry.outputs import (
    camera_of,
    estimate_of,
    landmarks_of,
    newest_estimate,
    reported,
    trajectory_of,
)
from asyneio.odometry.propagated_trajectory import PropagatedTrajectory
from asyneio.odometry.propagation import predict_knot
from asyneio.odometry.segment import Segment, Tracking
from asyneio.odometry.settings import resolve
from asyneio.odometry.transitions import TransitionLog
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.types import (
    NS_PER_S,
    Attitude,
    Calibration,
    CalibrationEstimate,
    Estimate,
    FloatArray,
    Health,
    InitialState,
    Packet,
    RecordArray,
    StepReport,
)


class Odometry:
    """Feature tracks and inertial samples in; metric states with covariance out. Causal.

    The world frame has z up; its origin and yaw are those of the first knot. Where nothing connects a state
    with the previous one, or the state cannot be trusted any more, the segment ends (LOST), and the next
    initialization begins a new segment with a world frame of its own.

    Args:
        config: all settings.
        calibration: of camera and IMU.
        initial_state: a known state: the first segment begins there, in the world frame of that state, and
            earlier measurements are ignored. `process` raises `EstimationError` where the inertial samples do
            not reach back to it.

    Raises:
        ConfigError: `config` is not a Config.
        EstimationError: `initial_state` is not a valid state.
        CalibrationError: `calibration` is not a Calibration, or a noise density of the IMU is not positive.
    """

    def __init__(
        self, config: Config, calibration: Calibration, initial_state: InitialState | None = None
    ) -> None:
        check_constructor(config, calibration, initial_state)
        keep_freed_memory()
        self._initial_state = None if initial_state is None else checked(initial_state)
        self._config = config
        self._calibration = calibration
        self._packet_ns: int | None = None
        self._renewed = RenewedPackets()
        self._noise = LearnedNoise(config.inertial, calibration.noise, config.window.knot_interval_s)
        self._settings = resolve(config, calibration, self._noise.now())
        self._attitude_filter = AttitudeFilter(config.inertial, calibration.noise.gyroscope_walk)
        self._attitude: Attitude | None = None
        self._segment = Segment(0, config, calibration)
        self._log = TransitionLog()
        #: Of the newest packet; the buffer that counts them does not outlive a loss.
        self._rejected_samples = 0

    @with_one_blas_thread
    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Take a packet; return the estimates of the knots that it completes, and a report.

        A knot after which the state is LOST gives no estimate. A packet that ends before the previous one
        ended begins a new segment.

        Raises:
            RecordingError: `packet` is not a Packet.
        """
        check_packet(packet)
        packet = self._renewed.passed(packet)  # drop repeated readings of held samples
        interruption = self._append(packet)  # gate samples, undistort observations once
        if interruption:  # the clock was set back, samples are missing, or the scene changed
            return [], self._restart(packet, interruption)
        segment, tracking, settings = self._segment, self._segment.tracking, self._settings
        if tracking is None:
            return self._initialize(packet)  # from a known state, stationary or in motion
        estimates, status = list[Estimate](), segment.health.status
        try:
            for knot_ns in segment.due_knots(tracking.newest.t_ns, settings.knot_interval_ns):
                interval = segment.buffer.interval(tracking.newest.t_ns, knot_ns)
                before, gravity_w = tracking.window.states, settings.window.gravity_w
                knot = predict_knot(before, interval.start_ns, knot_ns, interval.streams, gravity_w)
                stationary = self._is_stationary(interval.start_ns, knot_ns, tracking.newest)
                tracking.extend(interval, knot, stationary, self._noise.now())  # factors (17), (20), (31)
                tracking.window.add_landmarks()  # (33)
                solution = tracking.optimize(settings.optimizer, segment.buffer)  # (39), chi-square test
                newest = newest_estimate(tracking.window, solution, settings, segment.number, stationary)
                tracking.newest = newest
                rejected = segment.buffer.contradicting_share_of_new(interval.start_ns, knot_ns)
                step = Step(interval, stationary, before.r, solution, newest, rejected)
                status = segment.health.update(step)
                if status.health is Health.LOST:
                    break
                estimates.append(reported(newest, settings))
                tracking.marginalize_to(settings.window_s)  # square-root prior
        except (EstimationError, InertialError) as error:
            status = HealthStatus(Health.LOST, str(error))
        if status.health is Health.LOST:
            self._segment = Segment(segment.number + 1, self._config, self._calibration)
        return estimates, self._report(packet, status, segment.number)

    def _append(self, packet: Packet) -> str:
        """Add a packet to the segment, or return why it does not continue the ones before."""
        before_ns, self._packet_ns = self._packet_ns, packet.t_end_ns
        if before_ns is not None and packet.t_end_ns < before_ns:
            return f"timestamps jump back by {(before_ns - packet.t_end_ns) / NS_PER_S:.3f} s"
        gated = self._segment.append(packet, self._renewed.rates_hz)
        self._rejected_samples = self._segment.buffer.rejected_samples + self._renewed.duplicates
        interruption = self._interruption(before_ns, packet.t_end_ns)
        if not interruption:
            self._learn(packet, gated)
        return interruption

    def _interruption(self, before_ns: int | None, end_ns: int) -> str:
        """Why the newest packet does not continue those before, in a segment that is not initialized."""
        segment = self._segment
        if segment.tracking is not None:
            return ""  # the health monitor decides
        if segment.health.scene_changed:
            return "all feature tracks were replaced at once"
        gap_s = 0.0 if before_ns is None else segment.buffer.gap_s(before_ns, end_ns)
        lost = gap_s > self._config.health.lost_inertial_gap_s
        return f"no inertial samples for {gap_s:.2f} s" if lost else ""

    def _learn(self, packet: Packet, gated: tuple[RecordArray, RecordArray]) -> None:
        """Update what outlives a segment: the learned noise by gated, the attitude by raw samples."""
        self._noise.append(*gated)
        streams = packet.gyroscope, packet.accelerometer
        self._attitude = self._attitude_filter.update(*streams, packet.t_end_ns, self._noise.now())

    def _restart(self, packet: Packet, reason: str) -> StepReport:
        """Begin a new segment, and a new attitude, with a packet that does not continue those before."""
        ended = self._segment
        lost = ended.tracking is not None
        self._segment = Segment(ended.number + lost, self._config, self._calibration)
        walk = self._calibration.noise.gyroscope_walk
        self._attitude_filter = AttitudeFilter(self._config.inertial, walk)
        self._learn(packet, self._segment.append(packet, self._renewed.rates_hz))
        status = HealthStatus(Health.LOST if lost else Health.INITIALIZING, reason)
        return self._report(packet, status, ended.number)

    def _is_stationary(self, start_ns: int, end_ns: int, known: Estimate | None) -> bool:
        """Whether the sensor was stationary in an interval, by the noise learned until its end."""
        self._noise.learn_until(end_ns)
        segment, noise = self._segment, self._noise.when_stationary()
        return segment.stationary.update(segment.buffer.raw, start_ns, end_ns, known, noise)

    def _initialize(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """The first estimate of a segment, or, in the report, the reason why not yet."""
        segment, t_ns = self._segment, packet.t_end_ns
        self._is_stationary(t_ns, t_ns, None)
        initial, due_ns = self._initial_state, segment.next_attempt_ns
        if initial is None and due_ns is not None and t_ns < due_ns:
            return [], self._waiting(packet)
        segment.buffer.drop_until(t_ns - round(self._settings.initialization.max_seconds * NS_PER_S))
        # Only the noise has been learned since the settings were resolved.
        settings = self._settings.with_noise(self._noise.now())
        phase, consensus = segment.stationary.phase, segment.consensus
        first = initialize(segment.buffer, settings, phase, initial, consensus)
        if isinstance(first, Waiting):
            segment.waiting_reason = first.reason
            segment.attempts += first.attempted
            segment.next_attempt_ns = t_ns + retry_ns(segment.attempts)
            return [], self._waiting(packet)
        self._initial_state = None
        window, solution = first.window, first.solution
        origin = estimate_of(window, 0, joint_covariance(solution, 0)[:24, :24], segment.number)
        segment.buffer.drop_until(int(window.t_ns[-1]))
        newest = newest_estimate(window, solution, settings, segment.number)
        segment.tracking = Tracking(window, solution, newest)
        segment.tracking.marginalize_to(settings.window_s)
        status = segment.health.begin(newest, first.scale_sigma, first.object_in_view)
        return [reported(newest, settings)], self._report(packet, status, segment.number, origin)

    def _waiting(self, packet: Packet) -> StepReport:
        status = HealthStatus(Health.INITIALIZING, self._segment.waiting_reason)
        return self._report(packet, status, self._segment.number)

    def _report(
        self, packet: Packet, status: HealthStatus, number: int, origin: Estimate | None = None
    ) -> StepReport:
        """Report of a step of segment `number`, which a loss has replaced by then; changes are logged."""
        segment = self._segment
        has_pose = status.health in (Health.TRACKING, Health.DEGRADED)
        report = StepReport(
            packet.t_end_ns,
            status.health,
            status.reason,
            segment=number,
            stationary=segment.stationary.stationary,
            attitude=None if has_pose else self._attitude,
            outlier_share=segment.buffer.outlier_share(packet.observations["id"]),
            inertial_rejected=self._rejected_samples,
            noise=self._noise.estimate(),
            origin=origin,
            **({} if segment.tracking is None else segment.tracking.figures()),
            **segment.health.nis,
        )
        self._log.update(report)
        return report

    def trajectory(self) -> GPTrajectory | PropagatedTrajectory:
        """The continuous-time trajectory through the present window, with covariance.

        Under the scheme GPP, which has no kinematic prior, a trajectory that propagates each knot.

        Raises:
            EstimationError: the present segment is not initialized.
        """
        tracking = self._segment.tracking
        if tracking is None:
            raise EstimationError(
                "the odometry is not initialized; process packets until a report shows TRACKING"
            )
        return trajectory_of(tracking.window, tracking.solution, self._settings)

    def landmarks(self) -> FloatArray:
        """Positions (N,3) [m] of the window's landmarks in the world frame; none before initialization."""
        tracking = self._segment.tracking
        return np.empty((0, 3)) if tracking is None else landmarks_of(tracking.window)

    def calibration(self) -> CalibrationEstimate | None:
        """The present estimate of the calibration; None before the present segment is initialized."""
        tracking = self._segment.tracking
        return None if tracking is None else camera_of(tracking.window, tracking.solution)
