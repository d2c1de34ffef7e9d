# SPDX-License-Identifier: Apache-2.0
"""Run, evaluate and simulate in one call each; `import asyneio` offers them by these names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import overload

from asyneio.config import Config, load_config
from asyneio.errors import ConfigError, EvaluationError
from asyneio.evaluation import Evaluation, protocol_named
from asyneio.evaluation import evaluate as evaluate_trajectory
from asyneio.io import open_recording, to_trajectory
from asyneio.io.trajectory_source import read_estimated, read_reference
from asyneio.pipeline import RunResult, run_recording, write_outputs
from asyneio.progress import SILENT, RunProgress
from asyneio.simulation import EventScenario, EventSimulation, Scenario, Simulation, simulate_events
from asyneio.simulation import simulate as simulate_tracks
from asyneio.simulation.scenarios import scenario_named, with_seed_and_duration
from asyneio.types import Estimate, EventRecording, PoseTrajectory, Recording, split_segments

#: A trajectory to evaluate.
Trajectory = PoseTrajectory | RunResult | Sequence[Estimate] | Path | str


def run(
    recording: Recording | EventRecording | Path | str,
    config: Config | Path | str | None = None,
    *,
    output: Path | str | None = None,
    progress: RunProgress = SILENT,
) -> RunResult:
    """Estimate the trajectory of a recording.

    An incomplete run is no error: `result.summary.failure` says what is missing; it is empty otherwise.

    Args:
        recording: a recording, or the path of one in any supported format.
        config: settings, or a YAML file of those that differ from the defaults; None: the defaults.
        output: folder for the files of the results (trajectory, estimates, health, settings, summary); None:
            no files. `asyneio.write_report` writes the report.
        progress: receives messages and the position in the recording.

    Returns:
        Estimates and step reports (`result.run`), figures (`result.summary`), observations.

    Raises:
        RecordingError: the recording cannot be read, is too short, or has no inertial samples or calibration.
        CalibrationError: a calibration file is missing, malformed or impossible.
        ConfigError: a setting is unknown or has a wrong value, or `output` is a file.
        RunInterrupted: Ctrl-C while the estimator ran; it has the result until then.
    """
    settings = config if isinstance(config, Config) else load_config(_path_or_none(config, "settings"))
    if output is not None and Path(output).exists() and not Path(output).is_dir():
        raise ConfigError(f"{output} is a file; expected a folder for the results")
    loaded = open_recording(recording) if isinstance(recording, (Path, str)) else recording
    result = run_recording(loaded, settings, progress)
    if output is not None:
        write_outputs(result, Path(output))
    return result


def _path_or_none(value: object, what: str) -> Path | None:
    """A path. Raises ConfigError: another type."""
    if value is None or isinstance(value, (Path, str)):
        return None if value is None else Path(value)
    raise ConfigError(
        f"found a {type(value).__name__} for the {what}, expected a Config or the path of a file"
    )


def evaluate(
    estimate: Trajectory,
    ground_truth: PoseTrajectory | Recording | EventRecording | Path | str,
    protocol: str = "posyaw",
    *,
    segment: int | None = None,
    max_gap_s: float = 0.05,
) -> Evaluation:
    """Compare an estimated trajectory with ground truth.

    Args:
        estimate: the result of a run, estimates, poses, or a file or results folder with a trajectory.
        ground_truth: poses, a recording with ground truth, or the path of either.
        protocol: what is aligned: `posyaw`, `se3`, `sim3`, `hku`, `uslam`, `origin` or `none`.
        segment: number of the segment to compare; required if the estimate has several, because each has its
            own world frame.
        max_gap_s: ground truth is not interpolated across longer gaps [s].

    Raises:
        EvaluationError: the protocol or the segment is unknown, there is no ground truth or no estimate, or
            the two do not overlap in time.
        RecordingError: a file cannot be read.
    """
    rules = protocol_named(protocol)
    if not max_gap_s >= 0.0:
        raise EvaluationError(f"max_gap_s is {max_gap_s}; expected a number of seconds, 0 or more")
    chosen = _segment(_segments(estimate), segment)
    return evaluate_trajectory(chosen, _reference(ground_truth), rules, max_gap_s)


def _segments(estimate: Trajectory) -> dict[int, PoseTrajectory]:
    if isinstance(estimate, PoseTrajectory):
        return {0: estimate}
    if isinstance(estimate, (Path, str)):
        return read_estimated(Path(estimate)).segments
    estimates = estimate.run.estimates if isinstance(estimate, RunResult) else estimate
    if not isinstance(estimates, Sequence) or not all(isinstance(one, Estimate) for one in estimates):
        raise EvaluationError(
            f"found a {type(estimate).__name__} as the estimate, expected poses (PoseTrajectory), a result, "
            "estimates or a path"
        )
    return {part[0].segment: to_trajectory(part) for part in split_segments(estimates)}


def _segment(segments: dict[int, PoseTrajectory], number: int | None) -> PoseTrajectory:
    if not segments:
        raise EvaluationError("the estimate contains no poses; expected at least one segment")
    if number is None and len(segments) == 1:
        return next(iter(segments.values()))
    if number is None or number not in segments:
        found = "several segments" if number is None else f"no segment {number}"
        raise EvaluationError(
            f"the estimate has {found}; choose one with segment=, of {', '.join(map(str, segments))}"
        )
    return segments[number]


def _reference(truth: PoseTrajectory | Recording | EventRecording | Path | str) -> PoseTrajectory:
    if isinstance(truth, PoseTrajectory):
        return truth
    if isinstance(truth, (Path, str)):
        return read_reference(Path(truth)).longest
    if not isinstance(truth, (Recording, EventRecording)):
        raise EvaluationError(
            f"found a {type(truth).__name__} as the ground truth, expected poses (PoseTrajectory), a "
            "recording or a path"
        )
    if truth.ground_truth is None:
        raise EvaluationError(f"{truth.name} has no ground truth; pass poses or the path of a trajectory")
    return truth.ground_truth


@overload
def simulate(scenario: Scenario, seed: int | None = None, duration_s: float | None = None) -> Simulation: ...


@overload
def simulate(
    scenario: EventScenario, seed: int | None = None, duration_s: float | None = None
) -> EventSimulation: ...


@overload
def simulate(
    scenario: str, seed: int | None = None, duration_s: float | None = None
) -> Simulation | EventSimulation: ...


def simulate(
    scenario: Scenario | EventScenario | str, seed: int | None = None, duration_s: float | None = None
) -> Simulation | EventSimulation:
    """Simulate a recording with exact ground truth; equal arguments give equal arrays.

    Args:
        scenario: of tracks or of events, or the name of a ready-made one (`moderate`, `event_room`, ...).
        seed: random seed; None: that of the scenario.
        duration_s: length [s]; None: that of the scenario.

    Returns:
        The recording (`.recording`) and the true states at any time (`.truth`). All events are in memory: use
        `asyneio simulate` for long recordings.

    Raises:
        SimulationError: the name is unknown, or the scenario is impossible.
    """
    chosen = scenario_named(scenario) if isinstance(scenario, str) else scenario
    if isinstance(chosen, EventScenario):
        return simulate_events(with_seed_and_duration(chosen, seed, duration_s))
    return simulate_tracks(with_seed_and_duration(chosen, seed, duration_s))
