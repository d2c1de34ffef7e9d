"""Observations of tracks: parts and unions keep the four fields together."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.problem import States
from asyneio.estimation.problem.track_observations import TrackObservations


def some(count: int, since_ns: int = 0) -> TrackObservations:
    n = np.arange(count) + since_ns
    return TrackObservations(n, 10 + n, np.stack([n, -n], axis=1) * 1.0, n[:, None, None] * np.eye(2))


def assert_same(a: TrackObservations, b: TrackObservations) -> None:
    for field in ("t_ns", "track", "xy", "root_information"):
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field))


def test_a_mask_indices_and_a_slice_choose_the_same() -> None:
    seen, mask = some(6), np.array([False, True, True, True, False, False])
    for which in (mask, np.flatnonzero(mask), slice(1, 4)):
        assert_same(seen.chosen(which), some(3, 1))


def test_joined_parts_are_the_whole() -> None:
    seen = some(6)
    assert_same(seen.chosen(slice(2)).joined(seen.chosen(slice(2, None))), seen)
    assert_same(TrackObservations.none().joined(seen), seen)


def test_between_leaves_out_the_start_and_keeps_the_end() -> None:
    assert_same(some(6).between(1, 4), some(3, 2))


def test_states_are_chosen_and_joined_alike() -> None:
    rng = np.random.default_rng(0)
    states = States(*(rng.normal(size=(4, *shape)) for shape in ((3, 3), (3,), (2, 6), (6,))))
    again = states.chosen(slice(1)).joined(states.chosen(slice(1, None)))
    for a, b in zip(again, states, strict=True):
        np.testing.assert_array_equal(a, b)
