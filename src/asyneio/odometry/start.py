"""Start from the data alone: motion of a span, warm-up (40), joint optimisation (39), whether to trust it."""

from __future__ import annotations

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.problem import Prior, States
from asyneio.estimation.window import TrackObservations
from asyneio.geometry.gravity import upright
from asyneio.initialization.dead_reckoned import Adjusted
from asyneio.initialization.warm_up import warm_up
from asyneio.odometry.first_motion import SpanMotion, span_motion
from asyneio.odometry.first_window import GAUGE_SIGMA, Start, filled_window
from asyneio.odometry.intake import Intake, around
from asyneio.odometry.outliers import optimize_without_outliers
from asyneio.odometry.propagation import rates_at
from asyneio.odometry.settings import Settings
from asyneio.odometry.start_refusals import motion_refusal, solution_refusal
from asyneio.types import FloatArray, IntArray

#: Attempts to start are this far apart; each sees more motion than the last.
RETRY_NS = 250_000_000
#: Zero priors of the warm-up: rates of any size a person or a drone makes.
_WARM_UP_SIGMA = np.array([10.0, 100.0])
#: Factor on the covariance of the adjustment where it meets the same observations again.
_SEEN_TWICE = 2.0


def try_start(intake: Intake, settings: Settings) -> Start | str:
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
        first = States(*(a[:1].copy() for a in states))
        prior = _first_prior(first, motion.adjusted, _sample_variance(settings, intake, knots_ns))
        window = filled_window(intake, settings, knots_ns, states, prior, motion.contradicting)
        solution, outliers = optimize_without_outliers(window, settings.start.optimizer, rounds=4)
    except (EstimationError, InertialError) as error:
        return str(error)
    reason = solution_refusal(window, solution, motion, settings)
    if reason:
        return reason
    intake.refuse(np.concatenate([outliers, motion.contradicting]))
    return Start(window, solution)


def _knot_times(intake: Intake, settings: Settings) -> IntArray | None:
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
    chosen = counts[inverse] >= minimum
    return TrackObservations(
        seen.t_ns[chosen], seen.track[chosen], seen.xy[chosen], seen.root_information[chosen]
    )


def _first_states(intake: Intake, settings: Settings, knots_ns: IntArray, motion: SpanMotion) -> States:
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


def _first_prior(first: States, adjusted: Adjusted, sample_variance: FloatArray) -> Prior:
    """Prior on the first knot: position and yaw define the frame; tilt, velocity and biases as adjusted.

    The joint optimisation trusts the inertial samples less than dead reckoning does (`noise_inflation`: knots
    cannot follow every vibration), and would lose what they say over the whole span. Its observations are
    those that the adjustment has seen: the covariance is enlarged by `_SEEN_TWICE`. `sample_variance` (11,)
    is what the noise of the samples adds, which the adjustment leaves out.
    """
    g = adjusted.motion.gravity
    R = np.zeros((15, 24))
    R[0, :3] = first.C[0, 2] / GAUGE_SIGMA
    R[1:4, 3:6] = np.eye(3) / GAUGE_SIGMA
    # An angle phi on the right of C_w_b changes gravity in the body by g x phi.
    chain = np.zeros((11, 24))
    chain[:3, 9:12] = np.eye(3)
    chain[3:5, :3] = adjusted.tangent.T @ np.cross(np.eye(3), g).T / (g @ g)
    chain[5:, 18:] = np.eye(6)
    root = np.linalg.cholesky(np.linalg.inv(_SEEN_TWICE * adjusted.covariance + np.diag(sample_variance)))
    R[4:] = root.T @ chain
    # Warm-up has moved the velocity that the prior is linearised at.
    moved = np.zeros(11)
    moved[:3] = first.varpi[0, 0, 3:] - adjusted.motion.velocity
    return Prior(R, R.T @ R, np.concatenate([np.zeros(4), root.T @ moved]), first)


def _sample_variance(settings: Settings, intake: Intake, knots_ns: IntArray) -> FloatArray:
    """Variance (11,) that the samples' noise leaves in velocity, tilt and biases, as the window trusts it."""
    w = settings.window
    span_s = float(knots_ns[-1] - knots_ns[0]) * 1e-9
    count = [
        len(around(s, int(knots_ns[0]), int(knots_ns[-1]))) for s in (intake.gyroscope, intake.accelerometer)
    ]
    rate, force = w.noise_inflation * np.array([w.noise.gyroscope, w.noise.accelerometer]) / np.sqrt(count)
    return np.repeat([force * span_s, rate * span_s, rate, force], [3, 2, 3, 3]) ** 2
