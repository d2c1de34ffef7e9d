"""End-to-end accuracy from events to a trajectory, over a suite of sequences, and the sources of the error.

Evidence: simulation. Every sequence is run causally with the default configuration. `suite` is nine sequences
of 30 s like those of the DAVIS240C data set, `small` six scenes of 16 s with two seeds each, and `twins` the
dynamic ones of the suite, with a standing person, and without a person.

With `--substitution`, parts of the input are replaced by true ones in turn: true positions of the same
features over the same lifetimes with pixel noise (effect of tracking errors), features that live as long as
they are visible (effect of short lifetimes), inertial samples without bias (effect of unknown biases), the
true initial state (effect of initialization). With `--perturb MS DEG`, the calibration has a wrong time shift
and a wrong rotation of the camera.

All values are for the longest segment. NEES: mean over time; 3 for a consistent covariance. Real-time factor:
recorded time over the slower of front end and estimator, which run in parallel. Substitutions use the
observations of the unchanged run.

    python benchmarks/accuracy.py [--scenes suite | small | twins | SCENE ...] [--seeds N ...] [--seconds S]
        [--substitution] [--noise 0.4] [--perturb MS DEG] [--tracker gradient|haste] [--cache DIR]
        [--markdown FILE]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.config import Config, load_config
from asyneio.evaluation import NeesBlock, evaluate, nees, pose_trajectory, protocol_named
from asyneio.io.parsing.atomic import write_text
from asyneio.pipeline import RunResult, run_recording
from asyneio.pipeline.packets import usable_span
from asyneio.simulation import EVENT_SCENARIOS, EventSimulation
from asyneio.simulation.events.scenario import SUITE, TWINS
from asyneio.simulation.faults import without_bias
from asyneio.types import NS_PER_S, Estimate, EventRecording, Health, InitialState, RecordArray
from common import table
from sequences import DEFAULT_CACHE, sequence
from true_tracks import static_observations, true_tracks

_SMALL = ("event_slow", "event_fast", "event_rotation", "event_low_light", "event_near", "event_far")
_SUITE = tuple(scenario.name for scenario in SUITE)
_DYNAMIC = tuple(scenario.name for scenario in SUITE if scenario.person == "walking")
#: Scenes, seeds and seconds of each list; None for the scenario's default.
LISTS: dict[str, tuple[tuple[str, ...], tuple[int, ...], float | None]] = {
    "suite": (_SUITE, (0,), None),
    "small": (_SMALL, (0, 1), 16.0),
    "twins": ((*_DYNAMIC, *(scenario.name for scenario in TWINS)), (0,), None),
}
#: Columns and the formats of their numbers.
COLUMNS = {
    "path m": ".1f",
    "Mev/s": ".2f",
    "MPE %": ".3f",
    "hku %": ".3f",
    "yaw deg": ".2f",
    "scale %": "+.2f",
    "first s": ".2f",
    "segments": ".0f",
    "covered %": ".1f",
    "lost": ".0f",
    "NEES position": ".2f",
    "NEES orientation": ".2f",
    "x real time": ".2f",
}
SUBSTITUTED = {
    "true tracks, same life: MPE %": ".3f",
    "true tracks, full life: MPE %": ".3f",
    "true biases: MPE %": ".3f",
    "true initial state: MPE %": ".3f",
    "without tracks on moving objects: MPE %": ".3f",
}
#: Standard deviations given with the true initial state: rad, m, m/s, rad/s, m/s^2, per axis.
_CERTAIN = np.repeat([1e-4, 1e-4, 1e-3, 1e-4, 1e-3], 3)
#: Time of the known state after the first common time of all sensors [ns]: both IMU sensors have samples by
#: then.
_FIRST_NS = 20_000_000


def longest_segment(estimates: Sequence[Estimate]) -> tuple[list[Estimate], int]:
    """Estimates of the longest segment, and the number of segments."""
    segments = [list(group) for _, group in groupby(estimates, key=lambda estimate: estimate.segment)]
    return max(segments, key=len, default=[]), len(segments)


def figures(simulation: EventSimulation, result: RunResult) -> dict[str, float]:
    """The columns of one run; values without an estimate are missing."""
    recording, summary = simulation.recording, result.summary
    estimates, segments = longest_segment(result.run.estimates)
    found = {
        "Mev/s": recording.events.size / simulation.scenario.duration_s / 1e6,
        "segments": float(segments),
        "lost": float(sum(report.health is Health.LOST for report in result.run.reports)),
        "x real time": summary.duration_s / max(summary.processing_s, summary.frontend_s),
    }
    if len(estimates) < 3 or recording.ground_truth is None:
        return found
    trajectory = pose_trajectory(estimates)
    score = evaluate(trajectory, recording.ground_truth, protocol_named("posyaw"))
    hku = evaluate(trajectory, recording.ground_truth, protocol_named("hku"))
    # Covariances are relative to the knot that defines the world, so this knot comes first.
    origin = result.origin_of(estimates[0].segment)
    head = [] if origin is None else [origin]
    consistency = nees([*head, *estimates], simulation.truth.at).values
    return found | {
        "path m": score.path_length_m,
        "MPE %": score.mpe_percent,
        "hku %": hku.mpe_percent,
        "yaw deg": score.yaw_deg.rmse,
        "scale %": score.scale_error_percent,
        "first s": summary.first_estimate_s,
        "covered %": 100.0 * (estimates[-1].t_ns - estimates[0].t_ns) / NS_PER_S / summary.duration_s,
        "NEES position": float(np.mean(consistency[NeesBlock.POSITION][len(head) :])),
        "NEES orientation": float(np.mean(consistency[NeesBlock.ORIENTATION][len(head) :])),
    }


def mpe(result: RunResult, simulation: EventSimulation) -> float:
    """Mean position error (posyaw) in percent of the path; NaN without estimates."""
    estimates, _ = longest_segment(result.run.estimates)
    truth = simulation.recording.ground_truth
    if len(estimates) < 3 or truth is None:
        return float("nan")
    return evaluate(pose_trajectory(estimates), truth, protocol_named("posyaw")).mpe_percent


def substitutions(
    simulation: EventSimulation, observations: RecordArray, config: Config, noise_px: float
) -> dict[str, float]:
    """The columns of SUBSTITUTED for a run with these observations."""
    scores = []
    for alive in (None, config.frontend.max_features):
        tracks = true_tracks(simulation, observations, noise_px, alive)
        scores.append(mpe(run_recording(tracks, config), simulation))
    recording = simulation.recording
    streams = recording.gyroscope, recording.accelerometer
    gyroscope, accelerometer = (simulation.truth.at(stream["t_ns"]) for stream in streams)
    unbiased = replace(
        recording,
        gyroscope=without_bias(streams[0], gyroscope.bias_gyroscope),
        accelerometer=without_bias(streams[1], accelerometer.bias_accelerometer),
    )
    static = static_observations(simulation, observations)
    others = (
        run_recording(unbiased, config, observations=observations),
        run_recording(recording, config, observations=observations, initial_state=true_state(simulation)),
        run_recording(recording, config, observations=static),
    )
    scores += [mpe(other, simulation) for other in others]
    return dict(zip(SUBSTITUTED, scores, strict=True))


def true_state(simulation: EventSimulation) -> InitialState:
    """The true state as soon as all sensors have samples."""
    t_ns = usable_span(simulation.recording)[0] + _FIRST_NS
    true = simulation.truth.at(t_ns)
    return InitialState(
        t_ns, true.T_w_b[0], true.velocity_w[0], true.bias_gyroscope[0], true.bias_accelerometer[0], _CERTAIN
    )


def perturbed(recording: EventRecording, timeshift_ms: float, rotation_deg: float) -> EventRecording:
    """The recording with a wrong calibration, rotated about an axis unrelated to the motion."""
    calibration = recording.calibration
    assert calibration is not None
    T_b_c = calibration.T_b_c.copy()
    turn = np.deg2rad(rotation_deg) / np.sqrt(3.0) * np.ones(3)
    T_b_c[:3, :3] = T_b_c[:3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    shift_ns = calibration.timeshift_ns + round(timeshift_ms * 1e6)
    return replace(recording, calibration=replace(calibration, T_b_c=T_b_c, timeshift_ns=shift_ns))


def main() -> None:
    """Print a row for each sequence and the means."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--scenes", nargs="+", default=["suite"], choices=[*LISTS, *EVENT_SCENARIOS], metavar="X"
    )
    parser.add_argument("--seeds", type=int, nargs="+", help="added to the scenarios' own")
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--substitution", action="store_true", help="also with true parts")
    parser.add_argument("--noise", type=float, default=0.4, help="of true tracks, pixels")
    parser.add_argument("--perturb", type=float, nargs=2, default=(0.0, 0.0), metavar=("MS", "DEG"))
    parser.add_argument("--config", type=Path, help="settings that differ from the defaults (YAML)")
    parser.add_argument("--tracker", default="gradient", choices=["gradient", "haste"])
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE, help="of events")
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    config = load_config(options.config)
    config = config.model_copy(
        update={"frontend": config.frontend.model_copy(update={"tracker": options.tracker})}
    )
    columns = COLUMNS | (SUBSTITUTED if options.substitution else {})
    names, runs, notes = [], [], []
    for scene, seed, seconds in _sequences(options.scenes, options.seeds, options.seconds):
        simulation = sequence(scene, seed, seconds, options.cache)
        simulation = replace(simulation, recording=perturbed(simulation.recording, *options.perturb))
        result = run_recording(simulation.recording, config)
        found = figures(simulation, result)
        if options.substitution:
            found |= substitutions(simulation, result.observations, config, options.noise)
        names.append(simulation.recording.name)
        runs.append(found)
        if result.summary.failure:
            notes.append(f"* {names[-1]}: {result.summary.failure}\n")
        print(" | ".join([names[-1], *_cells(found, columns)]), flush=True)
    rows = [[name, *_cells(found, columns)] for name, found in zip(names, runs, strict=True)]
    means = {
        column: float(np.mean([found[column] for found in runs if column in found]))
        for column in columns
        if any(column in found for found in runs)
    }
    text = table(["sequence", *columns], [*rows, ["mean", *_cells(means, columns)]]) + "\n"
    text += "\n".join(["", *notes]) if notes else ""
    print(f"\n{text}")
    if options.markdown:
        write_text(options.markdown, text)


def _sequences(
    scenes: Sequence[str], seeds: Sequence[int] | None, seconds: float | None
) -> Iterator[tuple[str, int, float | None]]:
    """Scene, seed and seconds of each requested sequence."""
    for chosen in scenes:
        names, own_seeds, own_seconds = LISTS.get(chosen, ((chosen,), (0,), None))
        for name in names:
            for seed in seeds or own_seeds:
                yield name, seed, seconds or own_seconds


def _cells(found: dict[str, float], columns: dict[str, str]) -> list[str]:
    return [f"{found[name]:{form}}" if name in found else "-" for name, form in columns.items()]


if __name__ == "__main__":
    main()
