"""Stationary for a minute: drift of the estimate, and recovery afterwards.

Evidence: simulation with exact ground truth and random-walk biases; feature tracks and IMU or, with `--events
SCENE`, events, front end and IMU. There are no tracks while nothing moves, as with an event camera;
`--frames` keeps them, as with a frame camera. From the first to the last stationary knot: largest motion of
the estimate, and its error at both ends. The two differ: the bias of a stationary gyroscope is observable,
and its correction also corrects the pose that depends on it. `--before 0` is stationary from the beginning,
so that there is nothing to correct and all motion is drift.

With `--starts`: effect of a stationary phase on initialization. Every run begins stationary and then moves.
Time from the beginning of motion to the first estimate (negative: in the stationary phase), relative error of
scale and MPE (yaw and position aligned) of the estimates in motion; medians over seeds, and the worst.

With `--moving`: how often event scenes that are always in motion are detected as stationary before
initialization, and the speed of the sensor at that time.

    python benchmarks/standing_still.py [--seeds 2] [--before 12] [--seconds 60] [--scheme gpif] [--frames]
        [--events SCENE] [--cache DIR]
    python benchmarks/standing_still.py --starts 0 0.2 0.3 0.5 0.7 0.9 1.5 [--seeds 8] [--motion moderate]
        [--events SCENE] [--cache DIR]
    python benchmarks/standing_still.py --moving event_slow event_room suite_poster_translation [--cache DIR]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.config import Config
from asyneio.evaluation import evaluate, pose_trajectory, protocol_named
from asyneio.odometry.learned_noise import LearnedNoise
from asyneio.odometry.raw_measurements import RawMeasurements
from asyneio.odometry.stationary import StationaryDetector, StationaryPhase
from asyneio.pipeline import run_recording
from asyneio.pipeline.packets import calibration_of, packets, usable_span
from asyneio.simulation import EVENT_SCENARIOS, SCENARIOS, EventSimulation, Simulation, simulate
from asyneio.types import NS_PER_S, Estimate, FloatArray, Recording
from common import parallel, run, table
from sequences import DEFAULT_CACHE, sequence, tracked

_AFTER_S = 8.0
#: Maximum delay until the end of a stationary phase is detected: motion begins slowly.
_LATE_NS = 200_000_000
#: Image motion until an event camera observes features again.
_UNSEEN_S = 0.15


#: Duration after the beginning of motion in which initialization is observed [s].
_STARTED_S = 6.0
#: Event scenes have the same duration for all stationary phases up to this one [s].
_LONGEST_S = 1.5
#: Duration of the kept tracks of a stationary event camera after it is switched on [s].
_SWITCHED_ON_S = 0.05
#: Duration of a scene in motion [s].
_MOVING_S = 12.0


def simulated(seed: int, before_s: float, rest_s: float, motion: str = "moderate") -> Simulation:
    """A run with a stationary phase, with the observations of the consistency benchmark."""
    base = SCENARIOS[motion]
    return simulate(
        replace(
            base,
            duration_s=before_s + rest_s + _AFTER_S,
            pause_s=(before_s, before_s + rest_s),
            seed=seed,
            tracks=replace(
                base.tracks, features_alive=40, spacing_px=4.0, min_spacing_s=0.03, max_spacing_s=0.1
            ),
            gyroscope_rate_hz=200.0,
        )
    )


def without_tracks_at_rest(
    recording: Recording, begin_ns: int, end_ns: int, first_s: float = 0.2
) -> Recording:
    """The recording as by an event camera; tracks of the first `first_s` are kept."""
    t_ns = recording.observations["t_ns"]
    # A run begins with the first observation, whatever comes before it.
    first_ns = t_ns[0] + round(first_s * NS_PER_S)
    seen = (t_ns < max(begin_ns, first_ns)) | (t_ns > end_ns + round(_UNSEEN_S * NS_PER_S))
    return replace(recording, observations=recording.observations[seen])


def one_run(
    seed: int, before_s: float, rest_s: float, scheme: str, frames: bool, events: str | None, cache: Path
) -> list[str]:
    """A row of the table."""
    pause_s = before_s, before_s + rest_s
    simulation: Simulation | EventSimulation
    if events is None:
        simulation = simulated(seed, before_s, rest_s)
    else:
        simulation = sequence(events, seed, pause_s[1] + _AFTER_S, cache, pause_s)
    begin_ns, end_ns = (simulation.truth.start_ns + round(t * NS_PER_S) for t in pause_s)
    recording = simulation.recording
    if isinstance(recording, Recording) and not frames:
        recording = without_tracks_at_rest(recording, begin_ns, end_ns)
    result = run(recording, Config.model_validate({"inertial": {"scheme": scheme}}))
    at_rest = np.array([r.t_ns for r in result.run.reports if r.stationary])
    wrong = int(((at_rest < begin_ns) | (at_rest > end_ns + _LATE_NS)).sum())
    still = at_rest[(at_rest >= begin_ns) & (at_rest <= end_ns)]
    estimates = [e for e in result.run.estimates if still[0] <= e.t_ns <= end_ns]
    truth = simulation.truth.at([e.t_ns for e in estimates]).T_w_b
    origin = result.origin_of(0)
    assert origin is not None
    first = simulation.truth.at([origin.t_ns]).T_w_b[0]
    position, yaw = _errors(np.array([e.T_w_b for e in estimates]), truth, origin.T_w_b, first)
    moved, turned = np.linalg.norm(position - position[0], axis=1).max(), np.abs(yaw - yaw[0]).max()
    return [
        str(seed),
        f"{(still[0] - begin_ns) / NS_PER_S:.2f}",
        f"{len(still)}, {wrong}",
        f"{1e3 * moved:.2f}",
        " / ".join(f"{1e3 * np.linalg.norm(p):.2f}" for p in position[[0, -1]]),
        f"{np.degrees(turned):.3f}",
        " / ".join(f"{np.degrees(y):.3f}" for y in yaw[[0, -1]]),
        f"{100 * _error_after(simulation, result.run.estimates, end_ns):.2f}",
        str(len({e.segment for e in result.run.estimates})),
    ]


def _errors(
    found: FloatArray, truth: FloatArray, origin: FloatArray, true_origin: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Errors of position (N,3) [m] and of yaw (N,) [rad] in the world that the origin defines."""
    C = Rotation.from_euler("z", _yaw(origin @ np.linalg.inv(true_origin))).as_matrix()
    way = (truth[:, :3, 3] - true_origin[:3, 3]) @ C.T
    turn = found[:, :3, :3] @ (C @ truth[:, :3, :3]).swapaxes(1, 2)
    return found[:, :3, 3] - origin[:3, 3] - way, np.unwrap(_yaw(turn))


def _yaw(C: FloatArray) -> FloatArray:
    """Yaw of rotations (...,3,3) or poses that are nearly about the vertical."""
    return np.asarray(np.arctan2(C[..., 1, 0] - C[..., 0, 1], C[..., 0, 0] + C[..., 1, 1]))


def _error_after(simulation: Simulation | EventSimulation, estimates: list[Estimate], end_ns: int) -> float:
    """Largest difference [m] between estimated and true motion since the end of the stationary phase, in the
    body axes at that time."""
    after = [e for e in estimates if e.t_ns >= end_ns]
    truth = simulation.truth.at([e.t_ns for e in after]).T_w_b
    return float(np.linalg.norm(_way(np.array([e.T_w_b for e in after])) - _way(truth), axis=1).max())


def _way(T: FloatArray) -> FloatArray:
    return np.asarray((T[:, :3, 3] - T[0, :3, 3]) @ T[0, :3, :3])


class StartAfterRest(NamedTuple):
    """Seconds from the beginning of motion to the first estimate; relative errors of the estimates in motion
    [percent]; number of segments. NaN without initialization."""

    after_s: float
    scale: float
    mpe: float
    segments: int


def start_after_rest(
    seed: int, rest_s: float, motion: str, events: str | None, cache: Path
) -> StartAfterRest:
    """One run that begins stationary."""
    simulation: Simulation | EventSimulation
    if events is None:
        simulation = simulated(seed, 0.0, rest_s, motion)
    else:
        simulation = sequence(events, seed, max(rest_s, _LONGEST_S) + _STARTED_S, cache, (0.0, rest_s))
    begin_ns = simulation.truth.start_ns
    moves_ns = begin_ns + round(rest_s * NS_PER_S)
    recording = simulation.recording
    if isinstance(recording, Recording) and rest_s > 0.0:
        recording = without_tracks_at_rest(recording, begin_ns, moves_ns, _SWITCHED_ON_S)
    result = run_recording(recording, Config())
    estimates = [e for e in result.run.estimates if moves_ns <= e.t_ns <= moves_ns + _STARTED_S * NS_PER_S]
    if len(estimates) < 3:
        return StartAfterRest(np.nan, np.nan, np.nan, 0)
    first_s = (result.run.estimates[0].t_ns - moves_ns) / NS_PER_S
    assert recording.ground_truth is not None
    found = evaluate(pose_trajectory(estimates), recording.ground_truth, protocol_named("posyaw"))
    segments = len({e.segment for e in estimates})
    return StartAfterRest(first_s, found.scale_error_percent, found.mpe_percent, segments)


def starts_table(rests_s: list[float], seeds: int, motion: str, events: str | None, cache: Path) -> str:
    """A row for each duration of the stationary phase."""
    rows = []
    for rest_s in rests_s:
        task = partial(start_after_rest, rest_s=rest_s, motion=motion, events=events, cache=cache)
        found = np.array(parallel(task, range(seeds), f"stationary for {rest_s:g} s", jobs=1))
        started = found[np.isfinite(found[:, 0])]
        scale = np.abs(started[:, 1])
        rows.append(
            [
                f"{rest_s:g}",
                f"{len(started)} of {seeds}",
                f"{np.median(started[:, 0]):.2f}, {started[:, 0].max():.2f}",
                f"{np.median(scale):.2f}, {scale.max():.2f}",
                f"{np.median(started[:, 2]):.2f}, {started[:, 2].max():.2f}",
                f"{int((started[:, 3] > 1).sum())}",
            ]
        )
    header = ["rest s", "starts", "first estimate s after motion begins: median, worst"]
    header += ["scale error %: median, worst", "MPE %: median, worst", "runs in more than one segment"]
    return table(header, rows)


def moving_row(scene: str, cache: Path) -> list[str]:
    """False detections of the stationary detector for a scene in motion, before initialization."""
    simulation = sequence(scene, 0, _MOVING_S, cache)
    config, recording = Config(), simulation.recording
    interval_ns = round(config.window.knot_interval_s * NS_PER_S)
    start_ns, end_ns = usable_span(recording)
    count = (end_ns - start_ns) // interval_ns
    observed = tracked(simulation, config, cache / "tracks").observations
    cuts = np.searchsorted(observed["t_ns"], start_ns + interval_ns * np.arange(1, count), side="right")
    detector = StationaryDetector(config.inertial, calibration_of(recording), config.visual.pixel_sigma)
    raw = RawMeasurements()
    noise = LearnedNoise(config.inertial, calibration_of(recording).noise, config.window.knot_interval_s)
    rests: list[StationaryPhase] = []
    speeds = []
    for packet in packets(recording, start_ns, interval_ns, count, np.split(observed, cuts)):
        raw.append(packet)
        noise.append(packet.gyroscope, packet.accelerometer)
        noise.learn_until(packet.t_end_ns)
        detector.update(raw, packet.t_end_ns, packet.t_end_ns, None, noise.when_stationary())
        speeds.append(_most_speed(simulation, packet.t_end_ns - interval_ns, packet.t_end_ns))
        if detector.phase is not None and detector.stationary:
            rests = [r for r in rests if r.start_ns != detector.phase.start_ns] + [detector.phase]
    found = [_most_speed(simulation, r.start_ns, r.end_ns) for r in rests]
    lengths = [(r.end_ns - r.start_ns) / NS_PER_S for r in rests]
    wrong = [f"{length:.1f} s at {100 * v:.1f}" for length, v in zip(lengths, found, strict=True)]
    return [
        scene,
        str(count),
        f"{100 * np.mean(speeds):.1f}, {100 * np.min(speeds):.1f}",
        str(len(rests)),
        ", ".join(wrong) or "-",
    ]


def _most_speed(simulation: EventSimulation, begin_ns: int, end_ns: int) -> float:
    """Largest true speed [m/s] between two times."""
    t_ns = np.linspace(0, end_ns - begin_ns, 20).astype(np.int64) + begin_ns
    return float(np.linalg.norm(simulation.truth.at(t_ns).velocity_w, axis=1).max())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--before", type=float, default=12.0, help="seconds of motion before")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the stationary phase")
    parser.add_argument("--scheme", default="gpif")
    parser.add_argument("--frames", action="store_true", help="keep tracks while stationary")
    parser.add_argument("--events", choices=sorted(EVENT_SCENARIOS), help="scene, in place of tracks")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE, help="of the scenes")
    parser.add_argument("--starts", type=float, nargs="+", metavar="SECONDS", help="stationary before motion")
    parser.add_argument("--moving", nargs="+", choices=sorted(EVENT_SCENARIOS), metavar="SCENE")
    parser.add_argument("--motion", default="moderate", choices=sorted(SCENARIOS), help="of `--starts`")
    o = parser.parse_args()
    if o.moving:
        header = ["scene", "packets", "speed cm/s: mean, least", "rests", "their length, largest speed cm/s"]
        print(table(header, [moving_row(scene, o.cache) for scene in o.moving]))
        return
    if o.starts:
        print(starts_table(o.starts, o.seeds, o.motion, o.events, o.cache))
        return
    task = partial(
        one_run,
        before_s=o.before,
        rest_s=o.seconds,
        scheme=o.scheme,
        frames=o.frames,
        events=o.events,
        cache=o.cache,
    )
    header = [
        "seed",
        "noticed after s",
        "stationary knots, false ones",
        "moved mm at most",
        "error mm, begin / end",
        "yaw moved deg at most",
        "error deg, begin / end",
        f"error cm in {_AFTER_S:g} s after",
        "segments",
    ]
    print(table(header, parallel(task, range(o.seeds), f"stationary for {o.seconds:g} s", jobs=1)))


if __name__ == "__main__":
    main()
