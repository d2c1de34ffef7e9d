"""Short tracks among outliers are rejected; long tracks, and short ones among inliers, are not."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.neighbourhood import rejected_by_neighbours
from asyneio.types import OBSERVATION_DTYPE, Packet
from tests.odometry.runs import SCENARIO, empty

#: After every observation of these tests.
NOW_NS = 1_000_000_000

#: Tracks by id: position (x, y), number of observations 10 ms apart, and time of the first [s].
Tracks = dict[int, tuple[float, float, int, float]]


def observed(tracks: Tracks) -> TrackObservations:
    rows = sorted(
        (round((start_s + 0.01 * k) * 1e9), track, x, y)
        for track, (x, y, count, start_s) in tracks.items()
        for k in range(count)
    )
    t_ns, ids, x, y = (np.array(column) for column in zip(*rows, strict=True))
    return TrackObservations(t_ns, ids, np.column_stack([x, y]), np.tile(np.eye(2), (len(ids), 1, 1)))


def rejected(tracks: Tracks, outliers: list[int], among: list[int], t_ns: int = NOW_NS) -> list[int]:
    ids = (np.array(values, dtype=np.int64) for values in (outliers, among))
    return rejected_by_neighbours(observed(tracks), *ids, t_ns).tolist()


def test_short_tracks_are_rejected_with_their_neighbours() -> None:
    moving: Tracks = {k: (0.02 * k, 0.0, 10, 0.0) for k in range(3)}
    scene: Tracks = {10 + k: (0.5 + 0.02 * k, 0.0, 10, 0.0) for k in range(3)}
    short: Tracks = {20: (0.03, 0.05, 4, 0.0), 21: (0.53, 0.05, 4, 0.0), 22: (-0.8, 0.0, 4, 0.0)}
    tracks = {**moving, **scene, **short}
    assert rejected(tracks, [], list(tracks)) == []
    # The long track 2 is an inlier, and a neighbour of 20 too: two outliers against one inlier.
    assert rejected(tracks, [0, 1], list(tracks)) == [20]
    assert rejected(tracks, [0, 1], [10, 21]) == []


def test_rejection_does_not_spread() -> None:
    """Only the neighbour within 0.15 of the outlier: tracks rejected for their neighbours are no outliers."""
    chain: Tracks = {k: (0.1 * k, 0.0, 4, 0.0) for k in range(8)}
    assert rejected(chain, [0], list(range(8))) == [1]


def test_neighbours_are_near_in_time_too() -> None:
    assert rejected({0: (0.0, 0.0, 10, 0.0), 1: (0.0, 0.0, 4, 0.5)}, [0], [1]) == []


def test_later_observations_are_not_used() -> None:
    early: Tracks = {0: (0.0, 0.0, 10, 0.0), 1: (0.0, 0.01, 4, 0.0)}
    later: Tracks = {**early, 2: (0.0, 0.02, 20, 0.11), 3: (0.01, 0.02, 20, 0.11)}
    assert rejected(early, [0], [1], 100_000_000) == [1]
    assert rejected(later, [0], [1], 100_000_000) == [1]
    assert rejected(later, [0], [1]) == []


def test_old_observations_are_not_used() -> None:
    tracks: Tracks = {0: (0.0, 0.0, 10, 0.0), 1: (0.0, 0.01, 4, 0.0)}
    assert rejected(tracks, [0], [1]) == [1]
    assert rejected(tracks, [0], [1], 4 * NOW_NS) == []


def test_the_buffer_forgets_old_observations_and_outliers() -> None:
    buffer = MeasurementBuffer(SCENARIO.camera, 0.5)
    for k in range(40):
        records = np.zeros(5, dtype=OBSERVATION_DTYPE)
        records["t_ns"], records["id"], records["u"], records["v"] = (
            k * 100_000_000 + np.arange(5),
            k,
            120,
            90,
        )
        samples = empty(0).gyroscope
        buffer.append(Packet(k * 100_000_000 + 5, records, samples, samples))
        buffer.reject(np.array([k]))
        buffer.drop_until(k * 100_000_000)
    assert len(buffer._seen.t_ns) < 110
    assert len(buffer._outliers) < 22
    assert buffer.outlier_share(np.array([0])) == 1.0
