"""Surface of active events, its filter and the mask of hot pixels; the grid table."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.frontend.feature_grid import (
    BUCKET_FEATURES,
    FINE,
    FeatureGrid,
    insert,
    make_feature_grid,
    move,
    remove,
)
from asyneio.frontend.surface import (
    NEVER_NS,
    Event,
    Surface,
    is_first_of_edge,
    make_surface,
    record_event,
    refresh_hot_pixels,
)
from tests.conftest import SEED

SILENCE_NS = 50


def record(surface: Surface, t_ns: int, p: int) -> bool:
    event = Event(t_ns, 3, 2, p)
    first = is_first_of_edge(surface.latest_ns, event, SILENCE_NS)
    record_event(surface, event)
    return bool(first)


def test_only_the_first_event_of_an_edge_may_found_a_corner() -> None:
    surface = make_surface(6, 5)
    assert record(surface, 100, 1)
    assert not record(surface, 120, 1)
    # The other polarity in between: a new edge.
    assert record(surface, 130, 0)
    assert record(surface, 140, 1)
    assert not record(surface, 140 + SILENCE_NS, 1)
    assert record(surface, 141 + 2 * SILENCE_NS, 1)


def test_the_surface_keeps_the_latest_time_of_each_polarity() -> None:
    surface = make_surface(6, 5)
    for t_ns, p in ((5, 0), (7, 1), (9, 0)):
        record(surface, t_ns, p)
    assert surface.latest_ns[2, 3].tolist() == [9, 7]
    assert surface.fired[2, 3] == 3
    assert np.count_nonzero(surface.latest_ns != NEVER_NS) == 2


def test_hot_pixels_are_masked_and_let_back() -> None:
    rng = np.random.default_rng(SEED)
    surface = make_surface(40, 30)
    surface.fired[:] = rng.poisson(10, surface.fired.shape)
    # Two neighbours, and one in the corner of the image; and a busy edge, all of whose pixels fire alike.
    hot = [(10, 10), (10, 11), (0, 0)]
    surface.fired[20:22, :] = 400
    for v, u in hot:
        surface.fired[v, u] = 500
    assert refresh_hot_pixels(surface, 1.0) == 3
    assert np.argwhere(surface.hot).tolist() == sorted(map(list, hot))
    assert not surface.fired.any()
    assert refresh_hot_pixels(surface, 1.0) == 0


def test_a_lone_pixel_below_the_floor_is_not_hot() -> None:
    surface = make_surface(9, 9)
    surface.fired[4, 4] = 20
    assert refresh_hot_pixels(surface, 1.0) == 0


WIDTH, HEIGHT, REACH, BUCKET = 100, 60, 13.5, 1 << FINE


def entries(grid: FeatureGrid) -> set[tuple[int, int, int]]:
    """All (row, column, slot) in the table; fails where a slot is listed twice."""
    found = [
        (row, column, int(slot))
        for (row, column), bucket in np.ndenumerate(grid.buckets)
        for slot in bucket["slots"][: grid.counts[row, column]]
    ]
    assert len(found) == len(set(found))
    return set(found)


def touched(slot: int, x: float, y: float) -> set[tuple[int, int, int]]:
    """The buckets that the square about a feature's disc touches, by trying every one."""
    rows, columns = -(-HEIGHT // BUCKET), -(-WIDTH // BUCKET)
    return {
        (row, column, slot)
        for row in range(rows)
        for column in range(columns)
        if column * BUCKET <= x + REACH
        and x - REACH < (column + 1) * BUCKET
        and row * BUCKET <= y + REACH
        and y - REACH < (row + 1) * BUCKET
    }


step = st.tuples(
    st.sampled_from(["insert", "move", "remove"]),
    st.integers(0, 9),
    st.floats(0, WIDTH - 1),
    st.floats(0, HEIGHT - 1),
)


@pytest.mark.slow
@settings(max_examples=60)
@given(steps=st.lists(step, max_size=40))
def test_features_are_in_exactly_the_buckets_they_touch(
    steps: list[tuple[str, int, float, float]],
) -> None:
    grid = make_feature_grid(WIDTH, HEIGHT, 10, REACH)
    places: dict[int, tuple[float, float]] = {}
    for action, slot, x, y in steps:
        if action == "insert" and slot not in places:
            insert(grid, slot, x, y)
            places[slot] = x, y
        elif action == "move" and slot in places:
            move(grid, slot, x, y)
            places[slot] = x, y
        elif action == "remove" and places.pop(slot, None) is not None:
            remove(grid, slot)
        assert entries(grid) == set().union(*(touched(k, *place) for k, place in places.items()))


def test_a_full_bucket_loses_nothing_else() -> None:
    grid = make_feature_grid(WIDTH, HEIGHT, 40, REACH)
    for slot in range(40):
        insert(grid, slot, 50.0, 30.0)
    assert grid.counts.max() == BUCKET_FEATURES
    for slot in range(40):
        remove(grid, slot)
    assert not entries(grid)


@pytest.mark.parametrize("place", [(-3.0, 20.0), (120.0, 75.0)])
def test_a_feature_beyond_the_image_is_kept_at_its_rim(place: tuple[float, float]) -> None:
    grid = make_feature_grid(WIDTH, HEIGHT, 1, 2.0)
    insert(grid, 0, *place)
    assert entries(grid)
    remove(grid, 0)
    assert not entries(grid)
