"""Asynchronous event-inertial odometry (Fig. 2): one packet in, the estimates it made possible out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.config import Config
from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.covariance import joint_covariance, newest_covariance
from asyneio.estimation.optimizer import Solution
from asyneio.estimation.window import Window
from asyneio.odometry.intake import Intake, until
from asyneio.odometry.propagated_trajectory import PropagatedTrajectory, rate_at_end
from asyneio.odometry.propagation import predict_knot
from asyneio.odometry.settings import Settings, resolve
from asyneio.odometry.start import RETRY_NS, try_start
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.types import NS_PER_S, Calibration, Estimate, FloatArray, Health, Packet, RecordArray, StepReport


class Odometry:
    """Feature tracks and inertial samples in, metric states with covariance out, causal.

    The world frame has z up and its origin and yaw at the first knot.
    """

    def __init__(self, config: Config, calibration: Calibration) -> None:
        self._config = config
        self._calibration = calibration
        self._intake = Intake(calibration.camera, config.visual.pixel_sigma)
        self._settings: Settings | None = None
        self._window: Window | None = None
        self._solution: Solution | None = None
        self._next_attempt_ns = 0
        self._failure = ""
        self.origin: Estimate | None = None

    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Take a packet (times ascending, after all earlier packets); return the newest states it gives."""
        self._intake.append(packet)
        if self._failure:
            return [], StepReport(packet.t_end_ns, Health.LOST, self._failure)
        if self._window is None:
            return self._try_start(packet.t_end_ns)
        estimates: list[Estimate] = []
        try:
            while (knot_ns := self._next_knot_ns()) is not None:
                self._advance(knot_ns)
                estimates.append(self._newest())
                self._slide()
        except (EstimationError, InertialError) as error:
            self._failure = str(error)
            return estimates, StepReport(packet.t_end_ns, Health.LOST, self._failure)
        return estimates, self._report(packet.t_end_ns)

    def trajectory(self) -> GPTrajectory | PropagatedTrajectory:
        """The continuous-time trajectory through the present window, with covariance.

        Under the scheme GPP, which has no kinematic prior, one that propagates each knot.

        Raises:
            EstimationError: the odometry has not started.
        """
        window, _, settings = self._active()
        solution = self._solved()
        dropped = len(solution.problem.states.r) - window.knots
        if settings.window.scheme.propagates:
            return PropagatedTrajectory(
                window.t_ns,
                window.states,
                window.preintegrations,
                settings.window.gravity_w,
                lambda knot: joint_covariance(solution, knot + dropped)[:24, :24],
                settings.window.noise_inflation,
            )
        return GPTrajectory(
            window.t_ns,
            window.states.C,
            window.states.r,
            window.states.varpi,
            settings.window.root_density,
            bias=window.states.bias,
            joint_covariance=lambda knot: joint_covariance(solution, knot + dropped),
            motion_model=settings.window.motion_model,
        )

    def _advance(self, knot_ns: int) -> None:
        """Predict the knot, add what was measured since the last one, optimise."""
        window, intake, settings = self._active()
        from_ns = int(window.t_ns[-1])
        # A packet may reach beyond the knot: its first guess uses nothing later than itself.
        streams = (until(intake.gyroscope, knot_ns), until(intake.accelerometer, knot_ns))
        knot = predict_knot(window.states, from_ns, knot_ns, streams, settings.window.gravity_w)
        window.extend(knot_ns, knot, *streams, intake.observations.between(from_ns, knot_ns))
        window.add_landmarks()
        self._solution = window.optimize(settings.optimizer)
        intake.drop_until(knot_ns)

    def _slide(self) -> None:
        """Marginalise until the window has its length."""
        window, _, settings = self._active()
        while window.span_s() > settings.window_s + 1e-6:
            window.marginalize_oldest()

    def _next_knot_ns(self) -> int | None:
        window, intake, settings = self._active()
        knot_ns = int(window.t_ns[-1]) + settings.knot_interval_ns
        return knot_ns if intake.end_ns is not None and knot_ns <= intake.end_ns else None

    def _active(self) -> tuple[Window, Intake, Settings]:
        if self._window is None or self._settings is None:
            raise EstimationError("the odometry has not started; expected packets until it is initialised")
        return self._window, self._intake, self._settings

    def _solved(self) -> Solution:
        if self._solution is None:
            raise EstimationError("no solution yet; expected an optimised window")
        return self._solution

    def _try_start(self, t_ns: int) -> tuple[list[Estimate], StepReport]:
        if t_ns < self._next_attempt_ns:
            return [], StepReport(t_ns, Health.INITIALIZING, "collecting measurements")
        self._next_attempt_ns = t_ns + RETRY_NS
        self._intake.drop_until(t_ns - round(self._config.initialization.max_seconds * NS_PER_S))
        self._settings = resolve(
            self._config,
            self._calibration,
            _rate_hz(self._intake.gyroscope),
            _rate_hz(self._intake.accelerometer),
        )
        started = try_start(self._intake, self._settings)
        if isinstance(started, str):
            return [], StepReport(t_ns, Health.INITIALIZING, started)
        self._window, self._solution = started.window, started.solution
        self.origin = _estimate(self._window, 0, joint_covariance(self._solution, 0)[:24, :24])
        self._intake.drop_until(int(self._window.t_ns[-1]))
        estimate = self._newest()
        self._slide()
        return [estimate], self._report(t_ns)

    def _newest(self) -> Estimate:
        window, _, settings = self._active()
        estimate = _estimate(window, -1, newest_covariance(self._solved()))
        if settings.window.scheme.propagates:
            # No unknown of this window; what the increments say is better than what was predicted.
            rate = rate_at_end(window.preintegrations[-1], window.states.bias[-1])
            estimate = replace(estimate, angular_velocity_b=rate)
        return estimate

    def _report(self, t_ns: int) -> StepReport:
        window, _, _ = self._active()
        r = self._solved().report
        return StepReport(
            t_ns,
            Health.TRACKING,
            knots=window.knots,
            landmarks=len(window.landmarks),
            observations=window.observations,
            iterations=r.iterations,
            cost=r.cost,
            rejected=r.rejected,
        )


def _estimate(window: Window, k: int, covariance: FloatArray) -> Estimate:
    """Knot k of the window as an `Estimate`."""
    states = window.states
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = states.C[k], states.r[k]
    return Estimate(
        t_ns=int(window.t_ns[k]),
        T_w_b=T,
        velocity_w=states.C[k] @ states.varpi[k, 0, 3:],
        angular_velocity_b=states.varpi[k, 0, :3].copy(),
        generalized_acceleration=states.varpi[k, 1].copy(),
        bias_gyroscope=states.bias[k, :3].copy(),
        bias_accelerometer=states.bias[k, 3:].copy(),
        covariance=covariance,
    )


def _rate_hz(samples: RecordArray) -> float:
    """Median rate of a stream; 1 Hz where there are fewer than two samples."""
    if len(samples) < 2:
        return 1.0
    return 1e9 / float(max(np.median(np.diff(samples["t_ns"])), 1.0))
