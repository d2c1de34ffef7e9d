"""An object with most of the tracks in view does not take over the estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import asyneio.odometry.segment as segment
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.evaluation import NeesBlock, nees
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.neighbourhood import near_outliers, track_distances
from asyneio.simulation import Simulation
from asyneio.simulation.contamination import swaying_object, with_object
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, OBSERVATION_DTYPE, Health, Packet, Recording
from tests.odometry.runs import PIXEL_SIGMA, TRACKS, Outcome, run, simulated

#: The object is in view from the beginning; in this interval [s] nearly all static tracks are missing.
TAKEN_S = (2.0, 2.9)
#: Squared Mahalanobis distance of five standard deviations.
WRONG = 25.0


def crowded() -> tuple[Simulation, Recording]:
    """A recording with tracks as short as real ones, and with an object that has most of them for a while."""
    tracks = replace(TRACKS, mean_life_s=0.35, features_alive=60, min_spacing_s=0.02, max_spacing_s=0.05)
    simulation = simulated(tracks=tracks, motion="moderate")
    moving = swaying_object(simulation, 1.0, np.array([0.3, 1.0, 0.2]), 2.5)
    recording, ids = with_object(simulation, moving, 0.6)
    observations = recording.observations
    t_s = (observations["t_ns"] - simulation.scenario.start_ns) / NS_PER_S
    of_object = np.isin(observations["id"], ids)
    hidden = (t_s > TAKEN_S[0]) & (t_s < TAKEN_S[1]) & ~of_object & (observations["id"] % 8 != 0)
    # Before, a quarter of the object's tracks suffices.
    sparse = (t_s < TAKEN_S[0]) & of_object & (observations["id"] % 4 != 0)
    return simulation, replace(recording, observations=observations[~hidden & ~sparse])


def velocity_nees(simulation: Simulation, outcome: Outcome) -> tuple[float, float]:
    """Largest NEES of velocity after the object has taken over: of all estimates, and while TRACKING."""
    origin = next(r.origin for r in outcome.reports if r.origin is not None)
    estimates = [e for e in outcome.estimates if e.segment == origin.segment]
    found = nees([origin, *estimates], simulation.truth.at)
    values = found.values[NeesBlock.VELOCITY][1:]
    healths = {report.t_ns: report.health for report in outcome.reports}
    tracking = np.array([healths[int(t)] is Health.TRACKING for t in found.t_ns[1:]])
    since = found.t_ns[1:] > simulation.scenario.start_ns + TAKEN_S[0] * NS_PER_S
    return float(values[since].max()), float(values[since & tracking].max(initial=0.0))


@pytest.mark.slow
def test_young_tracks_of_an_object_do_not_take_over(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, recording = crowded()
    largest, tracking = velocity_nees(simulation, run(recording))
    assert tracking < WRONG
    # Without the test of young tracks.
    monkeypatch.setattr(segment, "WARY_SHARE", 1.0)
    assert velocity_nees(simulation, run(recording))[0] > 5.0 * largest


def observed(tracks: dict[int, tuple[float, float]]) -> TrackObservations:
    """Three observations of each track at one place (x, y), 50 ms apart."""
    ids = np.repeat(list(tracks), 3)
    xy = np.repeat(list(tracks.values()), 3, axis=0)
    t_ns = np.tile(np.arange(3) * 50_000_000, len(tracks))
    order = np.argsort(t_ns, kind="stable")
    return TrackObservations(t_ns[order], ids[order], xy[order], np.zeros((len(ids), 2, 2)))


def test_neighbours_of_outliers() -> None:
    object_ = {k: (0.5 + 0.02 * k, 0.0) for k in range(6)}
    static = {10 + k: (-1.5 + 0.1 * (k % 10), 0.3 + 0.2 * (k // 10)) for k in range(40)}
    seen = track_distances(observed(object_ | static))
    # Two of the six on the object are known: a third, not more. Three are.
    assert near_outliers(seen, np.array([0, 1])).size == 0
    assert near_outliers(seen, np.array([0, 1, 2])).tolist() == list(range(6))
    # In a wide neighbourhood a fifth suffices.
    assert near_outliers(seen, np.array([0, 1]), radius=1.5).tolist() == list(range(6))
    # One outlier alone may be a bad track.
    assert near_outliers(seen, np.array([12])).size == 0
    assert near_outliers(seen, np.empty(0, dtype=np.int64)).size == 0


def test_outliers_everywhere_are_not_an_object() -> None:
    """A quarter of the tracks is poor, evenly: no place has more outliers than the others."""
    grid = {k: (0.12 * (k % 12), 0.12 * (k // 12)) for k in range(108)}
    seen = track_distances(observed(grid))
    poor = np.array([k for k in range(108) if (k % 12 + 2 * (k // 12)) % 4 == 0])
    for radius in (1.0, 1.5, 2.0):
        assert near_outliers(seen, poor, radius).size == 0
    # The same number on one side is an object.
    assert len(near_outliers(seen, np.arange(27), 1.5)) > 24


def test_share_of_new_tracks_that_contradict() -> None:
    buffer = MeasurementBuffer(simulated().recording.calibration.camera, PIXEL_SIGMA)
    packet = _packet({k: 0 for k in range(20)}, 0)
    buffer.append(packet)
    buffer.reject(np.arange(20))
    # Twenty old tracks that contradict, and twelve new ones of which three do.
    buffer.append(_packet({k: 1_500_000_000 for k in range(32)}, 1_500_000_000))
    buffer.reject(np.arange(29, 32))
    share = buffer.contradicting_share_of_new(1_400_000_000, 1_500_000_000)
    assert share == pytest.approx(3 / 12)
    assert buffer.rejected_share(1_400_000_000, 1_500_000_000) == pytest.approx(23 / 32)


def _packet(tracks: dict[int, int], t_end_ns: int) -> Packet:
    observations = np.zeros(len(tracks), dtype=OBSERVATION_DTYPE)
    observations["id"], observations["t_ns"] = list(tracks), list(tracks.values())
    observations["u"], observations["v"] = 120.0, 90.0
    nothing = np.empty(0, dtype=INERTIAL_DTYPE)
    return Packet(t_end_ns, observations, nothing, nothing)
