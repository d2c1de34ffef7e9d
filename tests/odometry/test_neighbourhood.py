"""Short tracks among condemned ones are doubted; long ones, and those among sound ones, are not."""

from __future__ import annotations

import numpy as np

from asyneio.odometry.neighbourhood import Neighbourhood

#: After everything that these tests observe first.
NOW_NS = 1_000_000_000


def observed(
    neighbourhood: Neighbourhood, tracks: dict[int, tuple[float, float, int]], start_s: float = 0.0
) -> None:
    """Tracks by id: where (x, y) and how many observations, 10 ms apart."""
    rows = sorted(
        (round((start_s + 0.01 * k) * 1e9), track, x, y)
        for track, (x, y, count) in tracks.items()
        for k in range(count)
    )
    t_ns, ids, x, y = (np.array(column) for column in zip(*rows, strict=True))
    neighbourhood.see(t_ns, ids, np.column_stack([x, y]))


def test_short_tracks_go_with_their_neighbours() -> None:
    neighbourhood = Neighbourhood()
    moving = {k: (0.02 * k, 0.0, 10) for k in range(3)}
    scene = {10 + k: (0.5 + 0.02 * k, 0.0, 10) for k in range(3)}
    observed(neighbourhood, {**moving, **scene, 20: (0.03, 0.05, 4), 21: (0.53, 0.05, 4), 22: (-0.8, 0.0, 4)})
    everybody = np.array([0, 1, 2, 10, 11, 12, 20, 21, 22])
    assert neighbourhood.doubtful(everybody, NOW_NS).tolist() == []
    neighbourhood.condemn(np.array([0, 1]))
    # The long track 2 speaks for itself, and speaks for 20 too: two against one.
    assert neighbourhood.doubtful(everybody, NOW_NS).tolist() == [20]
    assert neighbourhood.doubtful(np.array([10, 21]), NOW_NS).tolist() == []


def test_doubt_does_not_spread() -> None:
    neighbourhood = Neighbourhood()
    chain = {k: (0.1 * k, 0.0, 4) for k in range(8)}
    observed(neighbourhood, chain)
    neighbourhood.condemn(np.array([0]))
    # Within 0.15 of the condemned one; a doubtful one condemns nobody.
    assert neighbourhood.doubtful(np.arange(8), NOW_NS).tolist() == [1]
    assert neighbourhood.doubtful(np.arange(8), NOW_NS).tolist() == [1]


def test_neighbours_are_near_in_time_too() -> None:
    neighbourhood = Neighbourhood()
    observed(neighbourhood, {0: (0.0, 0.0, 10)})
    observed(neighbourhood, {1: (0.0, 0.0, 4)}, start_s=0.5)
    neighbourhood.condemn(np.array([0]))
    assert neighbourhood.doubtful(np.array([1]), NOW_NS).tolist() == []


def test_what_comes_later_does_not_count() -> None:
    neighbourhood = Neighbourhood()
    observed(neighbourhood, {0: (0.0, 0.0, 10), 1: (0.0, 0.01, 4)})
    neighbourhood.condemn(np.array([0]))
    before = neighbourhood.doubtful(np.array([1]), 100_000_000)
    observed(neighbourhood, {1: (0.0, 0.01, 20), 2: (0.0, 0.02, 20), 3: (0.01, 0.02, 20)}, start_s=0.11)
    assert before.tolist() == [1]
    assert neighbourhood.doubtful(np.array([1]), 100_000_000).tolist() == [1]
    assert neighbourhood.doubtful(np.array([1]), NOW_NS).tolist() == []


def test_what_is_long_ago_is_forgotten() -> None:
    neighbourhood = Neighbourhood()
    observed(neighbourhood, {0: (0.0, 0.0, 10), 1: (0.0, 0.01, 4)})
    neighbourhood.condemn(np.array([0]))
    assert neighbourhood.doubtful(np.array([1]), NOW_NS).tolist() == [1]
    assert neighbourhood.doubtful(np.array([1]), 4 * NOW_NS).tolist() == []
    for k in range(40):
        observed(neighbourhood, {2 + k: (0.9, 0.9, 5)}, start_s=0.1 * k)
        neighbourhood.forget(round(0.1 * k * 1e9))
    assert len(neighbourhood._t_ns) < 110
    assert len(neighbourhood._condemned) == 0
