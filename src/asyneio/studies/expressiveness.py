# SPDX-License-Identifier: Apache-2.0
"""Study: accuracy of each prior and space for known motions between knots."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.studies.known_motion import (
    MOTION_SETTINGS,
    MotionKind,
    angles_between,
    draw_known_motion,
    generalized_rates,
    rms,
)
from asyneio.studies.study import QUICK_SEEDS, SEEDS, Contest, Metric, Study, Value, View
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.trajectory.model import motion_model_named
from asyneio.types import NS_PER_S, FloatArray

PRIORS, SPACES = ("wnoa", "wnoj"), ("se3", "so3xr3")
MOTIONS = (MotionKind.ROTATION, MotionKind.TRANSLATION, MotionKind.ORBIT)
INTERVALS_MS = (5, 10, 20, 50, 100, 200)
SPEEDS = (0.5, 1.0, 2.0)

_DURATION_MS = 4000
#: Number of comparison times per interval: the centres of as many equal parts.
_PLACES = 8
#: Standard deviations of noisy knots: pose [rad, m], velocity [rad/s, m/s], acceleration [rad/s^2, m/s^2].
_NOISE = ((1e-3, 1e-3), (1e-2, 1e-2), (0.3, 0.3))

ROTATION = Metric("rotation_deg", "rotation error", "deg")
POSITION = Metric("position_mm", "position error", "mm")
VELOCITY = Metric("velocity_mm_s", "velocity error", "mm/s")
RATE = Metric("rate_deg_s", "angular-rate error", "deg/s")
_METRICS = (ROTATION, POSITION, RATE, VELOCITY)
_LINES = ("prior", "space")


@dataclass(frozen=True)
class ExpressivenessTask:
    """A prior in a space against a motion, with knots every `interval_ms`, exact or noisy."""

    prior: str
    space: str
    motion: str
    speed: float
    interval_ms: int
    knots: str
    seed: int


def measure(task: ExpressivenessTask) -> dict[str, float]:
    """RMS norms of the errors between knots, and RMS magnitudes of the motion."""
    # All priors, spaces and intervals use the same motion.
    rng = np.random.default_rng([task.seed, list(MotionKind).index(MotionKind(task.motion))])
    motion = draw_known_motion(task.motion, task.speed, rng)
    step_ns = task.interval_ms * 1_000_000
    knots_ns = step_ns * np.arange(_DURATION_MS // task.interval_ms + 1, dtype=np.int64)
    knots_s = knots_ns / NS_PER_S
    T_w_b, rates = motion.T_w_b(knots_s), generalized_rates(motion, knots_s)
    if task.knots == "noisy":
        T_w_b, rates = _disturb(T_w_b, rates, rng)
    trajectory = GPTrajectory(
        knots_ns,
        T_w_b[:, :3, :3],
        T_w_b[:, :3, 3],
        rates,
        # The mean does not depend on the magnitude of an isotropic density.
        np.ones(6),
        motion_model=motion_model_named(task.prior, task.space),
    )
    places_ns = step_ns * (2 * np.arange(_PLACES, dtype=np.int64) + 1) // (2 * _PLACES)
    t_ns = (knots_ns[:-1, None] + places_ns).ravel()
    t_s = t_ns / NS_PER_S
    estimate, truth = trajectory.pose(t_ns), motion.T_w_b(t_s)
    true_rate, true_acceleration = motion.angular_velocity_b(t_s), motion.acceleration_w(t_s)
    return {
        ROTATION.name: rms(np.rad2deg(angles_between(truth[:, :3, :3], estimate[:, :3, :3]))),
        POSITION.name: 1e3 * rms(estimate[:, :3, 3] - truth[:, :3, 3]),
        VELOCITY.name: 1e3 * rms(trajectory.velocity(t_ns) - motion.velocity_w(t_s)),
        RATE.name: rms(np.rad2deg(trajectory.angular_velocity(t_ns) - true_rate)),
        "motion_rate_rad_s": rms(true_rate),
        "motion_acceleration_m_s2": rms(true_acceleration),
    }


def expressiveness(quick: bool = False, seeds: int | None = None) -> Study:
    """The study; `quick`: one motion at one speed, two intervals."""
    motions = MOTIONS[:1] if quick else MOTIONS
    intervals_ms = (20, 100) if quick else INTERVALS_MS
    speeds = (1.0,) if quick else SPEEDS
    qualities = [("exact", speed) for speed in speeds] + [("noisy", 1.0)]
    tasks = tuple(
        ExpressivenessTask(prior, space, motion, speed, interval_ms, knots, seed)
        for seed in range(seeds or (QUICK_SEEDS if quick else SEEDS))
        for motion, (knots, speed), interval_ms in product(motions, qualities, intervals_ms)
        for prior, space in product(PRIORS, SPACES)
    )
    return Study(
        name="expressiveness",
        question="How well does a trajectory through knots follow a known motion between them, by motion "
        "prior (white noise on acceleration, on jerk) and space (SE(3), SO(3) x R^3)?",
        settings={
            "duration_ms": _DURATION_MS,
            "places": _PLACES,
            "knot_noise": _NOISE,
            "motion": MOTION_SETTINGS,
        },
        tasks=tasks,
        measure=measure,
        views=tuple(view for motion in motions for view in _views(motion)),
        contests=tuple(contest for motion in motions for contest in _contests(motion)),
        labels={"interval_ms": "interval between knots [ms]", "speed": "speed (factor on frequencies)"},
    )


def _views(motion: str) -> Iterator[View]:
    for knots in ("exact", "noisy"):
        title = f"{motion}, {knots} knots: error against the interval between them"
        where: dict[str, Value] = {"motion": motion, "speed": 1.0, "knots": knots}
        yield View(f"{motion}-interval-{knots}", title, _METRICS, "interval_ms", _LINES, where, log_x=True)
    title = f"{motion}, exact knots every 100 ms: error against speed"
    where = {"motion": motion, "interval_ms": 100, "knots": "exact"}
    yield View(f"{motion}-speed", title, _METRICS, "speed", _LINES, where, log_x=True)


def _contests(motion: str) -> Iterator[Contest]:
    for metric in (ROTATION, POSITION):
        name, title = f"{motion}-best-{metric.name}", f"{motion}: smallest {metric.title}"
        yield Contest(
            name, title, metric, _LINES, "interval_ms", "speed", {"motion": motion, "knots": "exact"}
        )


def _disturb(T_w_b: FloatArray, rates: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Knots with independent errors of the standard deviations `_NOISE`."""
    noise = np.array(_NOISE).reshape(3, 2, 1) * rng.normal(size=(len(T_w_b), 3, 2, 3))
    noisy = T_w_b.copy()
    noisy[:, :3, :3] = T_w_b[:, :3, :3] @ Rotation.from_rotvec(noise[:, 0, 0]).as_matrix()
    noisy[:, :3, 3] += noise[:, 0, 1]
    return noisy, rates + noise[:, 1:].reshape(-1, 2, 6)
