"""Tracks on a moving object: they follow its points, in the asked number, and disturb nothing else."""

import dataclasses

import numpy as np
import pytest

from asyneio.errors import SimulationError
from asyneio.simulation import SCENARIOS, PinholeCamera, Simulation, TrackSpec, simulate
from asyneio.simulation.moving import PERSON_M, draw_walk

BASE = dataclasses.replace(SCENARIOS["noise_free"], duration_s=6.0)
SHARE = 1.0 / 3.0


def with_share(share: float) -> Simulation:
    tracks = dataclasses.replace(BASE.tracks, moving_share=share)
    return simulate(dataclasses.replace(BASE, tracks=tracks))


@pytest.fixture(scope="module")
def run() -> Simulation:
    return with_share(SHARE)


@pytest.mark.slow
def test_observations_on_the_object_are_the_projections_of_its_moving_points(run: Simulation) -> None:
    assert run.moving_object is not None
    observations = run.recording.observations[run.on_object]
    assert observations.size > 1000
    elapsed_s = (observations["t_ns"] - run.scenario.start_ns) * 1e-9
    T_w_o = run.moving_object.motion.T_w_b(elapsed_s)
    T_w_c = run.truth.at(observations["t_ns"]).T_w_b @ run.scenario.T_b_c
    points_o = run.moving_object.points_o[run.landmark_of_track[observations["id"]] - len(run.landmarks_w)]
    points_h = np.hstack([points_o, np.ones((len(points_o), 1))])
    points_c = np.einsum("nij,nj->ni", np.linalg.inv(T_w_c) @ T_w_o, points_h)[:, :3]
    pixels, valid = PinholeCamera.from_intrinsics(run.scenario.camera).project(points_c)
    assert valid.all()
    np.testing.assert_allclose(observations["u"], pixels[:, 0], atol=1e-9)
    np.testing.assert_allclose(observations["v"], pixels[:, 1], atol=1e-9)
    # A point that stood where the object is in the middle would be seen tens of pixels away.
    still_c = np.einsum("nij,nj->ni", np.linalg.inv(T_w_c) @ T_w_o[len(T_w_o) // 2], points_h)[:, :3]
    still, _ = PinholeCamera.from_intrinsics(run.scenario.camera).project(still_c)
    assert np.median(np.hypot(*(still - pixels).T)) > 10.0


@pytest.mark.slow
def test_the_asked_share_of_the_tracks_lies_on_the_object_while_it_is_in_view(run: Simulation) -> None:
    on_object = run.on_object
    # 20 of 60 tracks where the object fills them all, none where it is out of view.
    share = [part.mean() for part in np.array_split(on_object, 20)]
    assert 0.3 < max(share) < 0.5
    assert 0.5 * SHARE < on_object.mean() < 1.1 * SHARE


@pytest.mark.slow
def test_nothing_else_changes(run: Simulation) -> None:
    without = with_share(0.0)
    assert not without.on_object.any()
    assert without.moving_object is None
    np.testing.assert_array_equal(without.landmarks_w, run.landmarks_w)
    np.testing.assert_array_equal(without.recording.gyroscope, run.recording.gyroscope)
    np.testing.assert_array_equal(without.recording.accelerometer, run.recording.accelerometer)


def test_the_object_is_rigid_and_of_a_persons_size(run: Simulation) -> None:
    assert run.moving_object is not None
    moving, t_s = run.moving_object, np.array([0.0, 3.3])
    first, second = (moving.positions_w(np.full(50, t), moving.points_o[:50]) for t in t_s)
    np.testing.assert_allclose(
        np.linalg.norm(first[:, None] - first, axis=2), np.linalg.norm(second[:, None] - second, axis=2)
    )
    np.testing.assert_allclose(np.abs(moving.points_o).max(axis=0), 0.5 * np.array(PERSON_M))
    # Each point lies on a face.
    assert np.all(np.isclose(np.abs(moving.points_o), 0.5 * np.array(PERSON_M)).any(axis=1))


def test_somebody_walks_ahead_at_a_persons_pace() -> None:
    t_s = np.arange(0.0, 30.0, 0.01)
    for seed in range(5):
        walk = draw_walk(np.random.default_rng(seed))
        speed = np.linalg.norm(walk.velocity_w(t_s), axis=1)
        assert 0.6 < speed.max() < 1.4
        assert 0.3 < speed.mean() < 0.7
        assert walk.T_w_b(t_s)[:, 0, 3].min() > 1.4
    elsewhere = draw_walk(np.random.default_rng(4), spot_m=(3.0, 1.0, 0.0))
    np.testing.assert_allclose(
        elsewhere.T_w_b(t_s)[:, :3, 3] - walk.T_w_b(t_s)[:, :3, 3], np.tile([1.3, 1.0, 0.5], (t_s.size, 1))
    )
    standing = draw_walk(np.random.default_rng(4), still=True)
    assert np.ptp(standing.T_w_b(t_s), axis=0).max() == 0.0


def test_an_impossible_share_is_refused() -> None:
    with pytest.raises(SimulationError, match=r"moving_share = 1.5"):
        TrackSpec(moving_share=1.5)
