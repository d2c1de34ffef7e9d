"""Start from the data alone: motion of a span, warm-up (40), joint optimisation (39), whether to trust it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.problem.problem import States
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.geometry.gravity import upright
from asyneio.initialization.warm_up import warm_up
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.checks import joint_refusal, motion_refusal
from asyneio.odometry.initializer.first_window import Start, filled_window
from asyneio.odometry.initializer.span_motion import SpanMotion, span_motion
from asyneio.odometry.outliers import optimize_without_outliers
from asyneio.odometry.propagation import rates_at
from asyneio.odometry.settings import Settings
from asyneio.types import IntArray

#: Zero priors of the warm-up: rates of any size a person or a drone makes.
_WARM_UP_SIGMA = np.array([10.0, 100.0])


def try_start(intake: MeasurementBuffer, settings: Settings) -> Start | str:
    """A window over what the intake holds, or the reason, in words, why not yet."""
    knots_ns = _knot_times(intake, settings)
    if knots_ns is None:
        return "waiting for inertial samples and feature tracks that overlap in time"
    span_s = float(knots_ns[-1] - knots_ns[0]) * 1e-9
    if span_s < settings.start.min_seconds:
        return f"collecting measurements: {span_s:.2f} s of {settings.start.min_seconds:.2f} s"
    seen = intake.observations.between(int(knots_ns[0]) - 1, int(knots_ns[-1]))
    seen = _long_tracks(seen, settings.window.min_observations)
    tracks = len(np.unique(seen.track))
    if tracks < settings.start.min_landmarks:
        return f"too few feature tracks: {tracks} of {settings.start.min_landmarks}"
    try:
        motion = span_motion(intake, settings, knots_ns, seen)
        reason = motion_refusal(motion, settings)
        if reason:
            return reason
        states = _first_states(intake, settings, knots_ns, motion)
        window = filled_window(intake, _at_offset(settings, motion), knots_ns, states, motion.contradicting)
        solution, outliers = optimize_without_outliers(window, settings.start.optimizer, rounds=4)
    except (EstimationError, InertialError) as error:
        return str(error)
    reason = joint_refusal(solution, motion, settings)
    if reason:
        return reason
    intake.refuse(np.concatenate([outliers, motion.contradicting]))
    return Start(window, solution)


def _at_offset(settings: Settings, motion: SpanMotion) -> Settings:
    """Settings of a window whose camera begins with the time offset found."""
    camera = settings.window.calibration
    if 0 not in camera.columns:
        return settings
    camera = replace(camera, time_offset=motion.adjusted.motion.time_offset)
    return replace(settings, window=replace(settings.window, calibration=camera))


def _knot_times(intake: MeasurementBuffer, settings: Settings) -> IntArray | None:
    """Knot times from the first instant that all streams cover."""
    if intake.end_ns is None or min(len(intake.gyroscope), len(intake.accelerometer)) < 2:
        return None
    if len(intake.observations.t_ns) == 0:
        return None
    first = max(
        int(intake.gyroscope["t_ns"][0]),
        int(intake.accelerometer["t_ns"][0]),
        int(intake.observations.t_ns[0]),
    )
    # The last knot falls on the end of the newest packet, so that later packets end on knots too.
    first = intake.end_ns - (intake.end_ns - first) // settings.knot_interval_ns * settings.knot_interval_ns
    times = np.arange(first, intake.end_ns + 1, settings.knot_interval_ns)
    return times if len(times) >= 2 else None


def _long_tracks(seen: TrackObservations, minimum: int) -> TrackObservations:
    _, inverse, counts = np.unique(seen.track, return_inverse=True, return_counts=True)
    return seen.chosen(counts[inverse] >= minimum)


def _first_states(
    intake: MeasurementBuffer, settings: Settings, knots_ns: IntArray, motion: SpanMotion
) -> States:
    """Knot states of a span's motion, world upright at the first knot; rates by warm-up (40)."""
    w, found, at = settings.window, motion.adjusted.motion, motion.increments
    C_w_b0 = upright(found.gravity)
    t = ((knots_ns - knots_ns[0]) * 1e-9)[:, None]
    r = motion.displacement @ C_w_b0.T
    v = (found.velocity + found.gravity * t + at.nu) @ C_w_b0.T
    C = C_w_b0 @ at.C
    streams = (intake.gyroscope, intake.accelerometer)
    half = settings.knot_interval_ns // 2
    rates = np.stack(
        [
            rates_at(int(knots_ns[k]), C[k], v[k], streams, found.bias, w.gravity_w, half)
            for k in range(len(knots_ns))
        ]
    )
    dt = np.diff(knots_ns) * 1e-9
    varpi = warm_up(C, r, rates, dt, w.root_density, _WARM_UP_SIGMA, w.motion_model)
    return States(C, r, varpi, np.tile(found.bias, (len(knots_ns), 1)))
