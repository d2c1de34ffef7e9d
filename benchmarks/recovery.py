"""Faults of the data streams: sequence of states, time to recovery, growth of the error.

Evidence: simulation, MEMS noise, default configuration, causal estimates; with tracks and IMU for track
scenarios, with events, front end and IMU for event scenarios (`event_fast`, ...).

    python benchmarks/recovery.py [--seeds 3] [--faults blackout dropout cut kidnapped noise]
        [--motions moderate event_fast ...] [--cache DIR]

Columns: states with the second at which each began (- initializing, T tracking, D degraded, L lost); seconds
from the end of the fault until TRACKING; largest position error of the first segment while not TRACKING, and
after the fault; largest error in estimated standard deviations; RMSE of each segment, aligned individually;
whether the run is complete.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np

from asyneio.config import Config
from asyneio.evaluation import AlignmentKind, align, associate, pose_trajectory
from asyneio.pipeline import RunResult, run_recording
from asyneio.simulation import EVENT_SCENARIOS, SCENARIOS, EventSimulation, Simulation, TrackSpec, simulate
from asyneio.simulation.faults import kidnapped, without
from asyneio.types import (
    NS_PER_S,
    Estimate,
    EventRecording,
    FloatArray,
    Health,
    PoseTrajectory,
    RecordArray,
    Recording,
)
from common import parallel, table
from sequences import DEFAULT_CACHE, sequence

AnyRecording: TypeAlias = Recording | EventRecording

#: Lifetimes and rates of the front end's tracks.
_TRACKS = TrackSpec(features_alive=60, mean_life_s=0.5, spacing_px=1.5, min_spacing_s=0.02, max_spacing_s=0.1)
_LETTERS = {Health.INITIALIZING: "-", Health.TRACKING: "T", Health.DEGRADED: "D", Health.LOST: "L"}
#: Begin and end of each fault, and end of the run [s].
_TIMES = {
    "blackout": (4.0, 9.0, 13.0),
    "dropout": (4.0, 4.2, 7.0),
    "cut": (4.0, 6.0, 10.0),
    "kidnapped": (4.0, 6.0, 10.0),
    "noise": (4.0, 5.5, 10.0),
}


def _renamed(observations: RecordArray, from_ns: int) -> RecordArray:
    out = observations.copy()
    out["id"][out["t_ns"] >= from_ns] += int(out["id"].max()) + 1
    return out


def blackout(recording: AnyRecording, begin_ns: int, end_ns: int, seed: int) -> AnyRecording:
    """No events: no observations, and all tracks end."""
    if isinstance(recording, EventRecording):
        shift_ns = recording.calibration.timeshift_ns if recording.calibration else 0
        events = without(recording.events, begin_ns - shift_ns, end_ns - shift_ns)
        return replace(recording, events=events)
    observations = without(_renamed(recording.observations, end_ns), begin_ns, end_ns)
    return replace(recording, observations=observations)


def dropout(recording: AnyRecording, begin_ns: int, end_ns: int, seed: int) -> AnyRecording:
    """No inertial samples."""
    return replace(
        recording,
        gyroscope=without(recording.gyroscope, begin_ns, end_ns),
        accelerometer=without(recording.accelerometer, begin_ns, end_ns),
    )


def cut(recording: AnyRecording, begin_ns: int, end_ns: int, seed: int) -> AnyRecording:
    """No events and no inertial samples."""
    return dropout(blackout(recording, begin_ns, end_ns, seed), begin_ns, end_ns, seed)


def kidnap(recording: AnyRecording, begin_ns: int, end_ns: int, seed: int) -> AnyRecording:
    """The same without a gap in the timestamps."""
    return kidnapped(recording, begin_ns, end_ns)


def noise(recording: AnyRecording, begin_ns: int, end_ns: int, seed: int) -> AnyRecording:
    """Observations off by 8 px.

    Raises:
        RuntimeError: the recording contains events.
    """
    if isinstance(recording, EventRecording):
        raise RuntimeError(f"{recording.name} contains events; this fault needs observations")
    observations = recording.observations.copy()
    bad = (observations["t_ns"] >= begin_ns) & (observations["t_ns"] < end_ns)
    rng = np.random.default_rng(seed)
    for axis in ("u", "v"):
        observations[axis][bad] += rng.normal(0.0, 8.0, np.count_nonzero(bad))
    return replace(recording, observations=observations)


_FAULTS: dict[str, Callable[[AnyRecording, int, int, int], AnyRecording]] = {
    "blackout": blackout,
    "dropout": dropout,
    "cut": cut,
    "kidnapped": kidnap,
    "noise": noise,
}


def _simulated(motion: str, seed: int, duration_s: float, cache: Path) -> Simulation | EventSimulation:
    if motion in EVENT_SCENARIOS:
        return sequence(motion, seed, duration_s, cache)
    return simulate(replace(SCENARIOS[motion], duration_s=duration_s, seed=seed, tracks=_TRACKS))


def _row(seed: int, fault: str, motion: str, cache: Path) -> list[str]:
    begin_s, end_s, duration_s = _TIMES[fault]
    simulation = _simulated(motion, seed, duration_s, cache)
    start_ns = simulation.truth.start_ns
    begin_ns, end_ns = (start_ns + round(s * NS_PER_S) for s in (begin_s, end_s))
    recording = _FAULTS[fault](simulation.recording, begin_ns, end_ns, seed)
    result = run_recording(recording, Config())
    over_ns = begin_ns if fault == "kidnapped" else end_ns
    assert recording.ground_truth is not None
    first, *others = result.run.segments()
    # Until the cut is detected, estimates continue from the position before it.
    first = [e for e in first if e.t_ns <= begin_ns] if fault == "kidnapped" else first
    offset, multiple = _errors(first, result, recording.ground_truth)
    tracking = {r.t_ns for r in result.run.reports if r.health is Health.TRACKING}
    t_ns = np.array([e.t_ns for e in first])
    doubt = np.array([t not in tracking for t in t_ns])
    after = (t_ns > over_ns) & ~doubt
    rmse = [_rmse(segment, recording.ground_truth) for segment in (first, *others)]
    return [
        fault,
        motion,
        str(seed),
        _sequence(result, start_ns),
        _recovery(result, begin_ns, over_ns),
        f"{100 * offset[doubt].max():.1f}" if doubt.any() else "-",
        f"{100 * offset[after].max():.1f}" if after.any() else "-",
        f"{multiple.max():.1f}",
        ", ".join(f"{100 * value:.1f}" for value in rmse),
        "yes" if not result.summary.failure else "no",
    ]


def _recovery(result: RunResult, begin_ns: int, over_ns: int) -> str:
    """Seconds from the end of the fault until TRACKING again; "unnoticed" without any other state."""
    later = [r for r in result.run.reports if r.t_ns > begin_ns]
    noticed = next((r.t_ns for r in later if r.health is not Health.TRACKING), None)
    if noticed is None:
        return "unnoticed"
    again = next((r.t_ns for r in later if r.t_ns > noticed and r.health is Health.TRACKING), None)
    return "never" if again is None else f"{(again - over_ns) / NS_PER_S:.2f}"


def _errors(
    estimates: list[Estimate], result: RunResult, truth: PoseTrajectory
) -> tuple[FloatArray, FloatArray]:
    """Position errors (N,) [m] relative to the segment's origin, and in estimated standard deviations."""
    origin = result.origin_of(estimates[0].segment)
    assert origin is not None
    # No estimate is older than the origin, which is used for the alignment only.
    matched = associate(pose_trajectory([origin, *estimates]), truth)
    aligned = align(AlignmentKind.ORIGIN, matched.estimate, matched.truth).apply(matched.estimate)
    offset = np.linalg.norm(aligned.position - matched.truth.position, axis=1)[1:]
    sigma = np.array([np.sqrt(np.trace(e.covariance[3:6, 3:6])) for e in estimates])
    return offset, offset / sigma


def _rmse(estimates: list[Estimate], truth: PoseTrajectory) -> float:
    matched = associate(pose_trajectory(estimates), truth)
    aligned = align(AlignmentKind.POSYAW, matched.estimate, matched.truth).apply(matched.estimate)
    return float(np.sqrt(np.mean(np.sum((aligned.position - matched.truth.position) ** 2, axis=1))))


def _sequence(result: RunResult, start_ns: int) -> str:
    """States with the second at which each began."""
    reports = result.run.reports
    changes = [reports[0], *(b for a, b in pairwise(reports) if a.health is not b.health)]
    return " ".join(f"{_LETTERS[r.health]}{(r.t_ns - start_ns) / NS_PER_S:.1f}" for r in changes)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--faults", nargs="+", default=list(_FAULTS), choices=list(_FAULTS))
    motions = sorted([*SCENARIOS, *EVENT_SCENARIOS])
    parser.add_argument("--motions", nargs="+", default=["moderate"], choices=motions)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    options = parser.parse_args()
    rows = []
    for fault in options.faults:
        for motion in options.motions:
            task = partial(_row, fault=fault, motion=motion, cache=options.cache)
            rows += parallel(task, range(options.seeds), f"{fault}, {motion}", options.jobs)
    header = ["fault", "motion", "seed", "states", "recovery s", "cm in doubt", "cm after", "sigmas"]
    print(table([*header, "cm RMSE of segments", "whole"], rows))


if __name__ == "__main__":
    main()
