"""Start at rest: a still IMU tells gravity's direction and the gyroscope's bias; velocity is zero.

No feature is needed: landmarks come when motion brings parallax, and scale with them, from the accelerometer.
Of the accelerometer's bias, rest shows only the part along gravity. The other two cannot be told from tilt:
both stay as uncertain as the prior on the bias leaves them, and correlated, in the window's covariance.
"""

from __future__ import annotations

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.problem import States
from asyneio.geometry.gravity import upright
from asyneio.odometry.first_window import Start, filled_window
from asyneio.odometry.intake import Intake, around
from asyneio.odometry.settings import Settings
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray


def static_start(intake: Intake, settings: Settings, since_ns: int) -> Start | str:
    """A window at rest over what the intake holds since `since_ns`, or the reason, in words, why not yet."""
    if intake.end_ns is None or min(len(intake.gyroscope), len(intake.accelerometer)) < 2:
        return "waiting for inertial samples"
    still_s = (intake.end_ns - since_ns) / NS_PER_S
    if still_s < settings.start.min_seconds:
        return f"at rest: averaging the IMU, {still_s:.2f} s of {settings.start.min_seconds:.2f} s"
    knots_ns = _knot_times(intake, settings, since_ns)
    if len(knots_ns) < 2:
        return "waiting for inertial samples that cover two knots"
    turn, force = (
        _mean(stream, int(knots_ns[0]), int(knots_ns[-1]))
        for stream in (intake.gyroscope, intake.accelerometer)
    )
    try:
        states = _states_at_rest(turn, force, settings, len(knots_ns))
        window = filled_window(intake, settings, knots_ns, states, still=True)
        return Start(window, window.optimize(settings.start.optimizer))
    except (EstimationError, InertialError) as error:
        return str(error)


def _knot_times(intake: Intake, settings: Settings, since_ns: int) -> IntArray:
    """Knots that end with the newest packet and fill at most a window, all of them at rest."""
    assert intake.end_ns is not None
    first = max(int(intake.gyroscope["t_ns"][0]), int(intake.accelerometer["t_ns"][0]), since_ns)
    first = max(first, intake.end_ns - round(settings.window_s * NS_PER_S))
    intervals = (intake.end_ns - first) // settings.knot_interval_ns
    return intake.end_ns - settings.knot_interval_ns * np.arange(intervals, -1, -1, dtype=np.int64)


def _mean(stream: RecordArray, start_ns: int, end_ns: int) -> FloatArray:
    return np.asarray(around(stream, start_ns, end_ns)["xyz"].mean(axis=0))


def _states_at_rest(turn: FloatArray, force: FloatArray, settings: Settings, count: int) -> States:
    """One pose for all knots: gravity opposite to the mean specific force `force` (3,), which in length may
    differ from it by the accelerometer's bias; the mean rate `turn` (3,) is the gyroscope's."""
    gravity = float(np.linalg.norm(settings.window.gravity_w))
    length = float(np.linalg.norm(force))
    bias = np.concatenate([turn, force * (1.0 - gravity / length)])
    return States(
        np.tile(upright(-force), (count, 1, 1)),
        np.zeros((count, 3)),
        np.zeros((count, 2, 6)),
        np.tile(bias, (count, 1)),
    )
