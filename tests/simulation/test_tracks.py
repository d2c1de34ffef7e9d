"""What an asynchronous front end must look like: spacing, lives, ids, and exact geometry."""

import dataclasses

import numpy as np
import pytest

from asyneio.errors import SimulationError
from asyneio.simulation import SCENARIOS, PinholeCamera, Simulation, TrackSpec, simulate
from asyneio.types import FloatArray, IntArray

BASE = dataclasses.replace(SCENARIOS["noise_free"], duration_s=6.0)
STAMP_NS = 2


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate(BASE)


def spans(run: Simulation) -> tuple[IntArray, IntArray]:
    """First and last time [ns] of each track."""
    observations = run.recording.observations
    count = run.landmark_of_track.size
    first = np.full(count, np.iinfo(np.int64).max)
    last = np.zeros(count, dtype=np.int64)
    np.minimum.at(first, observations["id"], observations["t_ns"])
    np.maximum.at(last, observations["id"], observations["t_ns"])
    return first, last


def spacings(run: Simulation) -> tuple[FloatArray, FloatArray]:
    """Time [ns] and image distance [px] between consecutive observations of a track."""
    observations = run.recording.observations[np.argsort(run.recording.observations["id"], kind="stable")]
    same = np.diff(observations["id"]) == 0
    distance = np.hypot(np.diff(observations["u"]), np.diff(observations["v"]))
    return np.diff(observations["t_ns"])[same].astype(float), distance[same]


@pytest.mark.slow
def test_noise_free_observations_are_the_projections_of_their_landmarks(run: Simulation) -> None:
    observations = run.recording.observations[::7]
    T_w_c = run.truth.at(observations["t_ns"]).T_w_b @ run.scenario.T_b_c
    points_w = run.landmarks_w[run.landmark_of_track[observations["id"]]]
    points_h = np.hstack([points_w, np.ones((len(points_w), 1))])
    points_c = np.einsum("nij,nj->ni", np.linalg.inv(T_w_c), points_h)[:, :3]
    pixels, valid = PinholeCamera.from_intrinsics(run.scenario.camera).project(points_c)
    assert valid.all()
    np.testing.assert_allclose(observations["u"], pixels[:, 0], atol=1e-9)
    np.testing.assert_allclose(observations["v"], pixels[:, 1], atol=1e-9)


def test_observations_stay_inside_the_margin(run: Simulation) -> None:
    observations = run.recording.observations
    margin = run.scenario.tracks.margin_px
    assert observations["u"].min() >= margin - 1.0
    assert observations["u"].max() <= run.scenario.camera.width - margin
    assert observations["v"].min() >= margin - 1.0
    assert observations["v"].max() <= run.scenario.camera.height - margin


def test_spacing_in_time_keeps_its_bounds(run: Simulation) -> None:
    spec = run.scenario.tracks
    dt_ns, _ = spacings(run)
    assert dt_ns.min() >= spec.min_spacing_s * 1e9 - STAMP_NS
    assert dt_ns.max() <= spec.max_spacing_s * 1e9 + STAMP_NS
    # Both bounds are at work in this run.
    assert dt_ns.min() < 1.2 * spec.min_spacing_s * 1e9
    assert dt_ns.max() > 0.8 * spec.max_spacing_s * 1e9


def test_spacing_in_the_image_is_the_asked_one_where_time_does_not_bound_it() -> None:
    spec = dataclasses.replace(BASE.tracks, min_spacing_s=2e-4, max_spacing_s=1.0, features_alive=10)
    _, distance = spacings(simulate(dataclasses.replace(BASE, tracks=spec)))
    assert abs(distance.mean() / spec.spacing_px - 1.0) < 0.03
    assert 0.1 < distance.std() / spec.spacing_px < 0.3


def test_every_feature_has_its_own_times(run: Simulation) -> None:
    t_ns = run.recording.observations["t_ns"]
    assert np.all(np.diff(t_ns) >= 0)
    assert np.unique(t_ns).size > 0.99 * t_ns.size


def test_the_number_alive_stays_at_the_target(run: Simulation) -> None:
    first, last = spans(run)
    start, end = run.recording.observations["t_ns"][[0, -1]]
    times = np.linspace(start + 1e8, end - 1e8, 50)
    alive = ((first[:, None] <= times) & (times <= last[:, None])).sum(axis=0)
    target = run.scenario.tracks.features_alive
    assert alive.max() <= target
    assert alive.mean() > 0.9 * target


def test_lives_are_bounded_and_spread(run: Simulation) -> None:
    first, last = spans(run)
    life_s = (last - first) * 1e-9
    assert life_s.max() <= run.scenario.tracks.max_life_s
    assert 0.2 < life_s.mean() < run.scenario.tracks.mean_life_s


def test_a_landmark_has_one_live_track_but_may_come_back(run: Simulation) -> None:
    first, last = spans(run)
    order = np.lexsort([first, run.landmark_of_track])
    again = np.diff(run.landmark_of_track[order]) == 0
    assert again.any()
    assert np.all(first[order][1:][again] >= last[order][:-1][again])


@pytest.mark.slow
def test_pixel_noise_and_outliers_have_the_asked_size(run: Simulation) -> None:
    spec = dataclasses.replace(BASE.tracks, pixel_sigma=0.5, outlier_fraction=0.1)
    noisy = simulate(dataclasses.replace(BASE, tracks=spec))
    clean, observed = run.recording.observations, noisy.recording.observations
    np.testing.assert_array_equal(clean["t_ns"], observed["t_ns"])
    error = np.column_stack([observed["u"] - clean["u"], observed["v"] - clean["v"]])
    inlier = ~noisy.outlier
    assert abs(noisy.outlier.mean() - 0.1) < 4.0 * np.sqrt(0.09 / noisy.outlier.size)
    assert abs(error[inlier].std() / 0.5 - 1.0) < 0.02
    assert np.linalg.norm(error[noisy.outlier], axis=1).min() > 2.0


@pytest.mark.slow
def test_a_scene_with_few_landmarks_gives_fewer_tracks() -> None:
    run = simulate(dataclasses.replace(BASE, landmarks=200, duration_s=1.5))
    first, last = spans(run)
    time = run.recording.observations["t_ns"][0] + 7 * 10**8
    assert 0 < ((first <= time) & (time <= last)).sum() < BASE.tracks.features_alive


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"features_alive": 0}, "expected positive features_alive"),
        ({"min_spacing_s": 0.1}, "0 < min_spacing_s <= max_spacing_s"),
        ({"jitter": 1.0}, "expected 0 <= jitter <= 0.82"),
        ({"outlier_fraction": 1.5}, "outlier_fraction = 1.5"),
    ],
)
def test_impossible_tracks_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        dataclasses.replace(TrackSpec(), **change)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_camera_that_sees_nothing_is_an_error() -> None:
    blind = dataclasses.replace(SCENARIOS["plane"].camera, width=10, height=10)
    with pytest.raises(SimulationError, match="none of 3000 landmarks is visible"):
        simulate(dataclasses.replace(SCENARIOS["plane"], camera=blind, duration_s=0.3))
    with pytest.raises(SimulationError, match="expected an end after the start"):
        simulate(dataclasses.replace(BASE, duration_s=0.05))
