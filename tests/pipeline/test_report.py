"""Data of the report: bounds propagated correctly, zero errors where the estimate is the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.config import Config, differences
from asyneio.errors import RecordingError
from asyneio.evaluation import evaluate, protocol_named
from asyneio.io import to_trajectory
from asyneio.pipeline import RunResult
from asyneio.pipeline.report import evaluate_segments, write_report
from asyneio.pipeline.report_data import report_data
from asyneio.pipeline.report_streams import count_features, event_rate, track_scene
from asyneio.pipeline.summary import Summary, Transition
from asyneio.state import DOF
from asyneio.types import (
    NS_PER_S,
    OBSERVATION_DTYPE,
    STATE_BLOCKS,
    Estimate,
    Health,
    PoseTrajectory,
    Recording,
    Run,
    StepReport,
)
from asyneio.viz.figures import report_figures
from asyneio.viz.tracks import shown_instants
from tests.io.event_recordings import make_event_recording
from tests.io.recordings import START_NS, make_estimate, make_recording

_SUMMARY = Summary(
    "r", "0", 1.0, 1.0, 0.0, 1.0, 0.0, 0.1, 1, 0, 1, 1, 1.0, 1.0, 0, 0.1, Health.TRACKING, {}, (), (), "", ()
)


CONFIG = Config.model_validate({"window": {"knot_interval_s": 0.05}})


def curve(s: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Positions (N,3) and attitudes on a helix with a tilt."""
    position = np.stack([np.cos(s), np.sin(s), 0.2 * s], axis=1)
    return position, Rotation.from_euler("zyx", np.stack([s, 0.1 * np.sin(s), 0.2 * np.cos(s)], axis=1))


def run_along(s: np.ndarray, yaw: float, covariance: np.ndarray) -> tuple[list[Estimate], PoseTrajectory]:
    """Estimates in a world rotated by `yaw`, and the ground truth."""
    position, attitude = curve(s)
    t_ns = START_NS + np.rint(s * NS_PER_S).astype(np.int64)
    world = Rotation.from_euler("z", yaw)
    estimates = []
    for index in range(s.size):
        T_w_b = np.eye(4)
        T_w_b[:3, :3] = (world * attitude[index]).as_matrix()
        T_w_b[:3, 3] = world.apply(position[index]) + np.array([3.0, 2.0, 1.0])
        velocity = world.apply([-np.sin(s[index]), np.cos(s[index]), 0.2])
        base = make_estimate(int(t_ns[index]))
        estimates.append(replace(base, T_w_b=T_w_b, velocity_w=velocity, covariance=covariance))
    return estimates, PoseTrajectory(t_ns, position, attitude.as_quat())


@pytest.fixture
def covariance(rng: np.random.Generator) -> np.ndarray:
    root = 1e-3 * rng.standard_normal((DOF, DOF))
    return root @ root.T


@pytest.fixture
def recording(rng: np.random.Generator) -> Recording:
    return make_recording(rng, seconds=5.0)


def test_a_perfect_estimate_has_no_error(recording: Recording, covariance: np.ndarray) -> None:
    estimates, truth = run_along(np.arange(0.2, 4.0, 0.05), 0.7, covariance)
    reports = [StepReport(estimate.t_ns, Health.TRACKING, seconds=0.01) for estimate in estimates]
    result = RunResult(Run(estimates, reports), _SUMMARY, recording.observations, (estimates[0],), CONFIG)
    recording = replace(recording, ground_truth=truth)
    score = evaluate(to_trajectory(estimates), truth, protocol_named("posyaw"))
    data = report_data(result, recording, {0: score})
    assert data.comparison is not None
    assert data.states is not None
    np.testing.assert_allclose(data.comparison.position_error.value, 0.0, atol=1e-9)
    np.testing.assert_allclose(data.comparison.orientation_error.value, 0.0, atol=1e-6)
    # The velocity is in the world of the ground truth.
    s = data.states.velocity.t_s + 3_000_001 / NS_PER_S
    np.testing.assert_allclose(
        data.states.velocity.value, np.stack([-np.sin(s), np.cos(s), 0.2 + 0 * s], axis=1), atol=1e-9
    )
    assert data.timing.step_s.tolist() == [0.01] * len(estimates)


def test_errors_start_at_the_origin_knot(recording: Recording, covariance: np.ndarray) -> None:
    estimates, truth = run_along(np.arange(0.2, 4.0, 0.05), 0.0, covariance)
    for estimate in estimates[1:]:
        estimate.T_w_b[:3, 3] += [0.1, 0.0, 0.0]
    result = RunResult(Run(estimates[1:], []), _SUMMARY, recording.observations, (estimates[0],), CONFIG)
    recording = replace(recording, ground_truth=truth)
    score = evaluate(to_trajectory(estimates[1:]), truth, protocol_named("posyaw"))
    data = report_data(result, recording, {0: score})
    assert data.comparison is not None
    error = data.comparison.position_error
    assert error.t_s.size == len(estimates) - 1
    np.testing.assert_allclose(error.value, np.tile([0.1, 0.0, 0.0], (error.t_s.size, 1)), atol=1e-9)


def test_bounds_match_samples(recording: Recording, covariance: np.ndarray, rng: np.random.Generator) -> None:
    estimates, truth = run_along(np.array([0.5, 0.7, 0.9]), 0.4, covariance)
    result = RunResult(Run(estimates, []), _SUMMARY, recording.observations, config=CONFIG)
    recording = replace(recording, ground_truth=truth)
    score = evaluate(to_trajectory(estimates), truth, protocol_named("posyaw"))
    data = report_data(result, recording, {0: score})
    assert data.comparison is not None
    assert data.states is not None
    draws = rng.multivariate_normal(np.zeros(DOF), covariance, 200_000)
    phi, rho, nu_error, bias = (
        draws[:, 3 * STATE_BLOCKS.index(name) :][:, :3] for name in ("phi", "rho", "nu", "bias_gyroscope")
    )
    position, attitude = curve(np.array([0.7]))
    assert position.shape == (1, 3)
    C = attitude[0]
    velocity = np.array([-np.sin(0.7), np.cos(0.7), 0.2])
    nu = C.inv().apply(velocity)
    sampled_velocity = (C * Rotation.from_rotvec(phi)).apply(nu + nu_error)
    for series, samples in (
        (data.states.velocity, sampled_velocity),
        (data.comparison.position_error, C.apply(rho)),
        (data.comparison.orientation_error, np.rad2deg(phi)),
        (data.states.bias_gyroscope, bias),
    ):
        np.testing.assert_allclose(series.sigma[1], samples.std(axis=0), rtol=0.02)


def test_segments_are_never_joined(recording: Recording, covariance: np.ndarray) -> None:
    """Two segments, each with its own world frame: no errors, and a gap between them in every series."""
    s = np.arange(0.2, 4.0, 0.05)
    first, truth = run_along(s, 0.7, covariance)
    second, _ = run_along(s, -1.1, covariance)
    half = s.size // 2
    later = [replace(e, segment=1, T_w_b=shifted(e.T_w_b)) for e in second[half + 10 :]]
    estimates = first[:half] + later
    reports = [StepReport(e.t_ns, Health.TRACKING, segment=e.segment, seconds=0.01) for e in estimates]
    origins = (first[0], later[0])
    result = RunResult(Run(estimates, reports), _SUMMARY, recording.observations, origins, CONFIG)
    recording = replace(recording, ground_truth=truth)
    segments = result.run.segments()
    assert [len(segment) for segment in segments] == [half, len(later)]
    scores = {
        n: evaluate(to_trajectory(segment), truth, protocol_named("posyaw"))
        for n, segment in enumerate(segments)
    }
    data = report_data(result, recording, scores)
    assert data.states is not None
    assert [path.shape[0] for path in data.states.paths] == [half, len(later)]
    assert data.health.segment.tolist() == [0] * half + [1] * len(later)
    assert data.comparison is not None
    for series in (
        data.states.velocity,
        data.states.bias_gyroscope,
        data.comparison.position_error,
        data.comparison.orientation_error,
    ):
        assert np.flatnonzero(np.isnan(series.value).all(axis=1)).tolist() == [half]
    np.testing.assert_allclose(np.delete(data.comparison.position_error.value, half, axis=0), 0.0, atol=1e-9)
    with pytest.raises(RecordingError, match="several segments"):
        to_trajectory(estimates)
    figures = list(report_figures(data))
    assert "each segment individually" in figures[0].caption
    assert [figure.name for figure in figures].count("health") == 1


def shifted(T_w_b: np.ndarray) -> np.ndarray:
    out = T_w_b.copy()
    out[:3, 3] += [40.0, -7.0, 3.0]
    return out


def test_features_are_counted_from_first_to_last_observation() -> None:
    observations = np.zeros(5, dtype=OBSERVATION_DTYPE)
    observations["t_ns"] = START_NS + np.array([0, 1, 2, 3, 4]) * NS_PER_S
    observations["id"] = [7, 8, 7, 8, 9]
    times = START_NS + np.array([0, 1, 2, 3, 10]) * NS_PER_S
    features = count_features(observations, times, START_NS)
    assert features.alive.tolist() == [1, 2, 2, 1, 0]
    np.testing.assert_allclose(features.age_s[:4, 1], [0.0, 0.5, 1.5, 2.0])
    assert np.isnan(features.age_s[4]).all()


@pytest.mark.slow
def test_features_of_many_tracks_match_a_plain_count(rng: np.random.Generator) -> None:
    observations = np.zeros(3000, dtype=OBSERVATION_DTYPE)
    observations["id"] = rng.integers(0, 200, 3000)
    observations["t_ns"] = 20_000_000 * observations["id"] + rng.integers(0, 700_000_000, 3000)
    times = np.sort(rng.integers(0, 5 * NS_PER_S, 300))
    features = count_features(observations, times, 0)
    for now, alive, age_s in zip(times, features.alive, features.age_s, strict=True):
        stamps = [observations["t_ns"][observations["id"] == n] for n in range(200)]
        ages = [now - own.min() for own in stamps if own.size and own.min() <= now <= own.max()]
        assert alive == len(ages)
        if ages:
            np.testing.assert_allclose(age_s, np.percentile(ages, [25, 50, 75]) / NS_PER_S)


def test_without_tracks_there_are_none() -> None:
    features = count_features(np.empty(0, dtype=OBSERVATION_DTYPE), np.array([0, 10]), 0)
    assert features.alive.tolist() == [0, 0]


def test_event_rate_is_in_events_a_second(rng: np.random.Generator) -> None:
    recording = make_event_recording(rng, count=2000)
    assert recording.calibration is not None
    shift_ns = recording.calibration.timeshift_ns
    first, last = (int(recording.events["t_ns"][k]) + shift_ns for k in (0, -1))
    ends = np.linspace(first, last, 11).astype(np.int64)
    rate = event_rate(recording, ends[1:], int(ends[0]), 0.5)
    # The first packet begins after the first event, which lies on its border.
    assert round(rate.rate.sum() * 0.5) == 2000 - np.count_nonzero(
        recording.events["t_ns"] + shift_ns == first
    )


def test_scene_keeps_what_is_shown(rng: np.random.Generator) -> None:
    recording = make_event_recording(rng, count=2000)
    assert recording.calibration is not None
    t_ns = recording.events["t_ns"]
    observations = np.zeros(500, dtype=OBSERVATION_DTYPE)
    observations["t_ns"] = np.linspace(t_ns[0], t_ns[-1], 500).astype(np.int64) + 5_000_000
    observations["id"] = np.arange(500) // 100
    shifted_by = replace(recording.calibration, timeshift_ns=5_000_000)
    scene = track_scene(replace(recording, calibration=shifted_by), observations)
    assert scene is not None
    assert set(scene.observations["t_ns"] + 5_000_000) <= set(observations["t_ns"])
    for instant in shown_instants(t_ns):
        alive = [
            n
            for n in range(5)
            if observations["t_ns"][100 * n] <= instant + 5_000_000 <= observations["t_ns"][100 * n + 99]
        ]
        assert [identity for identity, _ in scene.trails(instant)] == alive
    assert track_scene(recording, observations[:0]) is None


@pytest.mark.slow
def test_a_report_is_written_from_python(
    recording: Recording, covariance: np.ndarray, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    estimates, truth = run_along(np.arange(0.2, 4.0, 0.05), 0.7, covariance)
    reports = [StepReport(estimate.t_ns, Health.TRACKING, seconds=0.01) for estimate in estimates]
    summary = replace(_SUMMARY, health_s={"degraded": 0.0})
    result = RunResult(Run(estimates, reports), summary, recording.observations, (estimates[0],), CONFIG)
    path = write_report(result, recording, tmp_path / "report.html", truth)
    page = path.read_text()
    assert "position error, RMSE (ATE)" in page
    assert "window.knot_interval_s" in page
    without = replace(recording, ground_truth=None)
    assert "RMSE" not in write_report(result, without, tmp_path / "without.html").read_text()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report.html", "without.html"]


def test_a_segment_that_cannot_be_evaluated_is_noted(recording: Recording, covariance: np.ndarray) -> None:
    estimates, truth = run_along(np.arange(0.2, 4.0, 0.05), 0.7, covariance)
    far = replace(truth, t_ns=truth.t_ns + 10**12)
    result = RunResult(Run(estimates, []), _SUMMARY, recording.observations, config=CONFIG)
    scores, notes = evaluate_segments(result, far)
    assert scores == {}
    assert len(notes) == 1
    assert notes[0].startswith("segment 0 is not compared with the ground truth: ")


def test_settings_that_differ() -> None:
    assert differences(Config(), Config()) == {}
    assert differences(CONFIG, Config()) == {"window.knot_interval_s": (0.05, 0.1)}


def test_a_run_without_estimates_has_its_reasons(recording: Recording) -> None:
    report = StepReport(START_NS + 10**8, Health.INITIALIZING, "no motion")
    summary = replace(
        _SUMMARY, failure="did not initialize", transitions=(Transition(0.1, report.health, 0, "no motion"),)
    )
    data = report_data(RunResult(Run([], [report]), summary, recording.observations), recording, {})
    assert data.states is None
    assert data.failure == "did not initialize"
    assert [change.reason for change in data.health.changes] == ["no motion"]
