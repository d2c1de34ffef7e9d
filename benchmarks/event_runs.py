"""From events to a trajectory, end to end, and what dominates the error.

Evidence: simulation. Every sequence is run causally with the default configuration. Beside it the same
estimator gets true tracks with pixel noise: of the same features over the same life spans (what the tracker's
errors cost), and of features that live as long as they stay visible (what their short life costs).

    python benchmarks/event_runs.py [--scenes event_slow event_fast] [--seeds 0 1] [--seconds 16]
        [--cache DIR] [--noise 0.4] [--tracker gradient|haste] [--no-substitution] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from asyneio.config import Config, FrontendConfig
from asyneio.evaluation import evaluate, protocol_named
from asyneio.io import to_trajectory
from asyneio.io.atomic import write_text
from asyneio.pipeline import RunResult, run_recording
from asyneio.simulation import EVENT_SCENARIOS, EventSimulation
from asyneio.types import (
    NS_PER_S,
    OBSERVATION_DTYPE,
    EventRecording,
    FloatArray,
    Health,
    IntArray,
    RecordArray,
    Recording,
)
from common import table
from sequences import sequence

SCENES = ("event_slow", "event_fast", "event_rotation", "event_low_light", "event_near", "event_far")
HEADER = ["sequence", "path m", "MPE %", "hku %", "yaw deg", "scale %", "first s", "lost", "x real time"]
SUBSTITUTED = ["same life, true +noise: MPE %", "full life, true +noise: MPE %"]
#: Time between observations of a true track that lives on [ns], and how long it may live.
_STEP_NS = 20_000_000
_LONGEST_NS = 2 * NS_PER_S


def true_tracks(
    simulation: EventSimulation, observations: RecordArray, noise_px: float, alive: int | None
) -> Recording:
    """The recording with the features' true positions and white noise in place of what was tracked.

    `alive` None: at the same times. Else every feature is observed as long as it is visible, and new ones
    begin only while fewer than `alive` live.
    """
    recording = simulation.recording
    assert recording.calibration is not None
    shift_ns = recording.calibration.timeshift_ns
    order = np.lexsort((observations["t_ns"], observations["id"]))
    tracked = observations[order]
    _, first, member = np.unique(tracked["id"], return_index=True, return_inverse=True)
    births = tracked[first]
    points, _, hit = simulation.points.hit(
        births["t_ns"] - shift_ns, np.column_stack([births["u"], births["v"]])
    )
    if alive is None:
        t_ns, owner = tracked["t_ns"][hit[member]], member[hit[member]]
        uv, visible = simulation.points.project(t_ns - shift_ns, points[owner])
        t_ns, owner, uv = t_ns[visible], owner[visible], uv[visible]
    else:
        last_ns = int(observations["t_ns"].max())
        t_ns, owner, uv = _full_lives(simulation, births["t_ns"], points, hit, (last_ns, shift_ns, alive))
    records = np.zeros(t_ns.size, dtype=OBSERVATION_DTYPE)
    noise = noise_px * np.random.default_rng(0).normal(size=uv.shape)
    records["t_ns"], records["id"] = t_ns, owner
    records["u"], records["v"] = (uv + noise).T
    return as_tracks(recording, records[np.argsort(records["t_ns"], kind="stable")])


def _full_lives(
    simulation: EventSimulation,
    born_ns: IntArray,
    points: FloatArray,
    hit: np.ndarray,
    limits: tuple[int, int, int],
) -> tuple[IntArray, IntArray, FloatArray]:
    last_ns, shift_ns, alive = limits
    pieces: list[tuple[IntArray, IntArray, FloatArray]] = []
    ends: list[int] = []
    for index in np.argsort(born_ns, kind="stable").tolist():
        begin = int(born_ns[index])
        ends = [end for end in ends if end > begin]
        if not hit[index] or len(ends) >= alive:
            continue
        t_ns = np.arange(begin, min(begin + _LONGEST_NS, last_ns), _STEP_NS)
        uv, visible = simulation.points.project(t_ns - shift_ns, np.tile(points[index], (t_ns.size, 1)))
        length = int(np.argmin(visible)) if not visible.all() else t_ns.size
        if length < 3:
            continue
        pieces.append((t_ns[:length], np.full(length, index), uv[:length]))
        ends.append(int(t_ns[length - 1]))
    return tuple(np.concatenate(parts) for parts in zip(*pieces, strict=True))  # type: ignore[return-value]


def as_tracks(recording: EventRecording, observations: RecordArray) -> Recording:
    """A recording of tracks with the inertial samples of one of events."""
    assert recording.calibration is not None
    return Recording(
        recording.name,
        observations,
        recording.gyroscope,
        recording.accelerometer,
        recording.calibration,
        recording.ground_truth,
    )


def mpe(result: RunResult, recording: EventRecording, protocol: str) -> float:
    """Mean position error in percent of the path; NaN without estimates."""
    if not result.run.estimates or recording.ground_truth is None:
        return float("nan")
    trajectory = to_trajectory(result.run.estimates)
    return evaluate(trajectory, recording.ground_truth, protocol_named(protocol)).mpe_percent


def row(simulation: EventSimulation, result: RunResult) -> list[str]:
    """The figures of one run."""
    recording, summary = simulation.recording, result.summary
    if not result.run.estimates or recording.ground_truth is None:
        return [recording.name, *["-"] * 6, "never started", f"{summary.real_time_factor:.2f}"]
    score = evaluate(to_trajectory(result.run.estimates), recording.ground_truth, protocol_named("posyaw"))
    lost = bool(summary.failure) or summary.health is not Health.TRACKING
    return [
        recording.name,
        f"{score.path_length_m:.1f}",
        f"{score.mpe_percent:.3f}",
        f"{mpe(result, recording, 'hku'):.3f}",
        f"{score.yaw_deg.rmse:.2f}",
        f"{score.scale_error_percent:+.2f}",
        f"{summary.first_estimate_s:.2f}",
        "LOST" if lost else "no",
        f"{summary.real_time_factor:.2f}",
    ]


def main() -> None:
    """Print the table and the means."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=EVENT_SCENARIOS, metavar="SCENE")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--seconds", type=float, default=16.0)
    parser.add_argument("--noise", type=float, default=0.4, help="of true tracks, pixels")
    parser.add_argument("--tracker", default="gradient", choices=["gradient", "haste"])
    parser.add_argument("--no-substitution", action="store_true", help="only the runs themselves")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "asyneio-sequences")
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    config = Config(frontend=FrontendConfig.model_validate({"tracker": options.tracker}))
    rows: list[list[str]] = []
    figures: list[list[float]] = []
    for scene in options.scenes:
        for seed in options.seeds:
            simulation = sequence(scene, seed, options.seconds, options.cache)
            result = run_recording(simulation.recording, config)
            cells, numbers = row(simulation, result), [mpe(result, simulation.recording, "posyaw")]
            for alive in () if options.no_substitution else (None, config.frontend.max_features):
                tracks = true_tracks(simulation, result.observations, options.noise, alive)
                numbers.append(mpe(run_recording(tracks, config), simulation.recording, "posyaw"))
                cells.append(f"{numbers[-1]:.3f}")
            rows.append(cells)
            figures.append(numbers)
            print(" | ".join(cells), flush=True)
    header = HEADER + ([] if options.no_substitution else SUBSTITUTED)
    means = ", ".join(f"{value:.3f}" for value in np.mean(figures, axis=0))
    text = f"{table(header, rows)}\n\nmean MPE (posyaw) of the runs, and of the substitutions: {means} %\n"
    print(f"\n{text}")
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
