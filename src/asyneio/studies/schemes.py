# SPDX-License-Identifier: Apache-2.0
"""Study: comparison of the four inertial schemes in the complete estimator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np

from asyneio.config import Config
from asyneio.evaluation import evaluate, pose_trajectory, protocol_named
from asyneio.pipeline import RunResult, run_recording
from asyneio.simulation import IDEAL_IMU, SCENARIOS, Scenario, Simulation, TrackSpec, simulate, with_imu
from asyneio.studies.imu_faults import lose_bursts, lose_samples
from asyneio.studies.imu_noise import NOISE
from asyneio.studies.known_motion import rms
from asyneio.studies.study import QUICK_SEEDS, SEEDS, Contest, Metric, Study, Value, View
from asyneio.types import FloatArray, Recording

SCHEMES = ("gpif", "gpp", "preint", "extpreint")
#: The cost grows with the cube of their number; `benchmarks/schemes.py` uses 25 ms as well, on real data.
KNOTS_MS = (50, 100, 200, 400)
LEVELS = ("low", "medium", "high")
RATES_HZ = (100, 200, 1000)
#: Faults of the IMU: none; asynchronous rates; lost samples.
IMU = ("whole", "asynchronous", "10 % lost", "50 ms gaps")
MOTIONS = ("moderate", "aggressive")

#: Half the observations of the simulator's default and a shorter window than the estimator's default: effects
#: of the scheme are equally visible, in a third of the time.
_TRACKS = TrackSpec(features_alive=40, spacing_px=1.5, min_spacing_s=0.015)
_WINDOW_S = 1.0
_LOST, _GAP_S = 0.1, 0.05
#: Rate of the accelerometer for asynchronous sensors; the gyroscope keeps its rate.
_OTHER_RATE_HZ, _OTHER_OFFSET_S = 125.0, 0.0031

ATE = Metric("ate_cm", "position error (ATE)", "cm")
ORIENTATION = Metric("orientation_deg", "orientation error", "deg")
VELOCITY = Metric("velocity_cm_s", "velocity error", "cm/s")
COST = Metric("cost_ms_per_s", "processing time of a second", "ms")
_METRICS = (ATE, ORIENTATION, VELOCITY, COST)
_LINES = ("scheme",)


@dataclass(frozen=True)
class SchemeTask:
    """One run of the estimator with a scheme."""

    scheme: str
    knot_ms: int
    noise: str
    rate_hz: int
    imu: str
    motion: str
    seconds: float
    seed: int


#: Condition from which single factors are varied.
_BASE = SchemeTask("gpif", 100, "medium", 200, "whole", "aggressive", 8.0, 0)
_COMMON: dict[str, Value] = {"imu": _BASE.imu, "motion": _BASE.motion, "rate_hz": _BASE.rate_hz}


def measure(task: SchemeTask) -> dict[str, float]:
    """Errors of the causal estimates, and processing time; NaN if the run is incomplete."""
    simulation = simulate(scenario_of(task))
    recording = _with_faults(simulation.recording, task)
    result = run_recording(recording, config_of(task))
    if result.summary.failure or recording.ground_truth is None:
        return dict.fromkeys((m.name for m in (ATE, ORIENTATION, VELOCITY, COST)), float("nan"))
    score = evaluate(pose_trajectory(result.run.estimates), recording.ground_truth, protocol_named("posyaw"))
    return {
        ATE.name: 100.0 * score.position_m.rmse,
        ORIENTATION.name: score.orientation_deg.rmse,
        VELOCITY.name: 100.0 * rms(_velocity_errors(simulation, result)),
        COST.name: 1e3 / result.summary.real_time_factor,
    }


def scenario_of(task: SchemeTask) -> Scenario:
    """The simulated run, which is the same for all schemes and knot intervals."""
    # The schemes are compared at given levels of noise, so the samples have no other errors.
    base = with_imu(SCENARIOS["synchronous_imu"], IDEAL_IMU)
    level = NOISE[task.noise]
    noise = replace(base.noise, gyroscope_density=level.gyroscope, accelerometer_density=level.accelerometer)
    asynchronous = task.imu == "asynchronous"
    return replace(
        base,
        motion=task.motion,
        duration_s=task.seconds,
        seed=task.seed,
        tracks=_TRACKS,
        noise=noise,
        gyroscope_rate_hz=float(task.rate_hz),
        accelerometer_rate_hz=_OTHER_RATE_HZ if asynchronous else float(task.rate_hz),
        accelerometer_offset_s=_OTHER_OFFSET_S if asynchronous else 0.0,
    )


def config_of(task: SchemeTask) -> Config:
    """The default configuration except for the scheme, the knot interval and the length of the window."""
    return Config.model_validate(
        {
            "window": {"knot_interval_s": 1e-3 * task.knot_ms, "length_s": _WINDOW_S},
            "inertial": {"scheme": task.scheme},
        }
    )


def schemes(quick: bool = False, seeds: int | None = None) -> Study:
    """The study; `quick`: four seconds of two intervals between knots at one level of noise."""
    conditions = _quick_conditions() if quick else _conditions()
    tasks = [
        replace(condition, scheme=scheme, seed=seed)
        for seed in range(seeds or (QUICK_SEEDS if quick else SEEDS))
        for condition in conditions
        for scheme in SCHEMES
    ]
    # Dense knots last, because they take longest.
    tasks.sort(key=lambda task: -task.knot_ms)
    return Study(
        name="schemes",
        question="Which inertial scheme (GPIF, GPP, Preint, ExtPreint) gives the best estimates, by interval "
        "between knots, inertial noise and rate, and with samples that are asynchronous or lost?",
        settings={
            "tracks": asdict(_TRACKS),
            "imu": [_LOST, _GAP_S, _OTHER_RATE_HZ, _OTHER_OFFSET_S],
            "noise": {name: asdict(NOISE[name]) for name in LEVELS},
            "window_s": _WINDOW_S,
            "config": Config().model_dump(mode="json"),
        },
        tasks=tuple(tasks),
        measure=measure,
        views=tuple(_views()),
        contests=tuple(
            Contest(f"best-{m.name}", f"smallest {m.title}", m, _LINES, "knot_ms", "noise", _COMMON)
            for m in (ATE, ORIENTATION, VELOCITY)
        ),
        labels={
            "knot_ms": "interval between knots [ms]",
            "noise": "noise of the IMU",
            "rate_hz": "rate of the IMU [Hz]",
            "imu": "samples of the IMU",
        },
    )


def _views() -> Iterator[View]:
    for noise in LEVELS:
        title = f"noise {noise}: error against the interval between knots"
        where = {**_COMMON, "noise": noise}
        yield View(f"knots-noise-{noise}", title, _METRICS, "knot_ms", _LINES, where, log_x=True)
    for knot_ms in KNOTS_MS:
        title = f"knots every {knot_ms} ms: error against noise"
        yield View(
            f"noise-knots-{knot_ms}ms", title, _METRICS, "noise", _LINES, {**_COMMON, "knot_ms": knot_ms}
        )
    for factor, name in (("rate_hz", "rate"), ("imu", "samples of the IMU"), ("motion", "motion")):
        varied = ("knot_ms", "noise", "rate_hz", "imu", "motion")
        where = {other: getattr(_BASE, other) for other in varied if other != factor}
        title = f"knots every {_BASE.knot_ms} ms, noise {_BASE.noise}: error against {name}"
        yield View(f"single-{factor}", title, _METRICS, factor, _LINES, where, log_x=factor == "rate_hz")


def _conditions() -> list[SchemeTask]:
    """All intervals with all levels of noise; the other factors are varied one at a time."""
    full = [replace(_BASE, knot_ms=knot, noise=noise) for knot, noise in product(KNOTS_MS, LEVELS)]
    single = [
        *(replace(_BASE, rate_hz=rate_hz) for rate_hz in RATES_HZ),
        *(replace(_BASE, imu=imu) for imu in IMU),
        *(replace(_BASE, motion=motion) for motion in MOTIONS),
    ]
    return list(dict.fromkeys([*full, *single]))


def _quick_conditions() -> list[SchemeTask]:
    return [replace(_BASE, knot_ms=knot, seconds=4.0) for knot in (100, 200)]


def _with_faults(recording: Recording, task: SchemeTask) -> Recording:
    rng = np.random.default_rng([task.seed, IMU.index(task.imu)])
    if task.imu == "10 % lost":
        return lose_samples(recording, _LOST, rng)
    if task.imu == "50 ms gaps":
        return lose_bursts(recording, _LOST, _GAP_S, rng)
    return recording


def _velocity_errors(simulation: Simulation, result: RunResult) -> FloatArray:
    """Errors (N,3) of the velocity in the body frame [m/s], which need no alignment."""
    estimates = result.run.estimates
    truth = simulation.truth.at([estimate.t_ns for estimate in estimates])
    estimated = np.array([estimate.T_w_b[:3, :3].T @ estimate.velocity_w for estimate in estimates])
    return estimated - np.einsum("nji,nj->ni", truth.T_w_b[:, :3, :3], truth.velocity_w)
