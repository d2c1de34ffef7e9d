"""FA-Harris against a slow oracle of its definition, and on drawn corners and edges."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import correlate2d

from asyneio.frontend.detection import (
    HARRIS_EVENTS,
    HARRIS_K,
    HARRIS_THRESHOLD,
    INNER_CIRCLE,
    MARGIN,
    OUTER_CIRCLE,
    SCRATCH,
    _is_one_arc,
    harris_score,
    is_corner,
)
from asyneio.frontend.surface import NEVER_NS, make_surface
from asyneio.types import IntArray
from tests.conftest import SEED

SIDE = 21
C = SIDE // 2


def corner(latest_ns: IntArray, x: int = C, y: int = C) -> bool:
    """The test under test, on one polarity's surface (H,W)."""
    both = np.stack([np.full_like(latest_ns, NEVER_NS), latest_ns], axis=2)
    return is_corner(both, 1, x, y, np.zeros(SCRATCH, dtype=np.int64))


def has_arc(latest_ns: IntArray, circle: IntArray, lengths: list[int]) -> bool:
    """Whether a circle's newest pixels, for one of the lengths, are neighbours on it; distinct stamps."""
    stamps = latest_ns[C + circle[:, 1], C + circle[:, 0]]
    n = len(stamps)
    for length in lengths:
        newest = set(np.argsort(stamps)[n - length :].tolist())
        if any({(start + i) % n for i in range(length)} == newest for start in range(n)):
            return True
    return False


def oracle_score(latest_ns: IntArray) -> float:
    patch = latest_ns[C - 4 : C + 5, C - 4 : C + 5]
    binary = (patch >= np.sort(patch.ravel())[-HARRIS_EVENTS]).astype(float)
    derivative = np.outer([1, 4, 6, 4, 1], [-1, -2, 0, 2, 1]) / 12.0
    dx, dy = (correlate2d(binary, kernel, mode="valid") for kernel in (derivative, derivative.T))
    axis = np.arange(-2, 3)
    weight = np.exp(-0.5 * (axis[:, None] ** 2 + axis**2))
    weight /= weight.sum()
    xx, yy, xy = (np.sum(weight * a * b) for a, b in ((dx, dx), (dy, dy), (dx, dy)))
    return float(xx * yy - xy * xy - HARRIS_K * (xx + yy) ** 2)


def oracle(latest_ns: IntArray) -> bool:
    return (
        has_arc(latest_ns, INNER_CIRCLE, [3, 4, 5, 6, 10, 11, 12, 13])
        and has_arc(latest_ns, OUTER_CIRCLE, [4, 5, 6, 7, 8, 12, 13, 14, 15, 16])
        and oracle_score(latest_ns) > HARRIS_THRESHOLD
    )


def swept(angle: float, opening: float, noise: float, rng: np.random.Generator) -> IntArray:
    """Distinct stamps (H,W) left by a wedge of an opening [rad] whose tip moves in a direction [rad]."""
    y, x = np.mgrid[-C : C + 1, -C : C + 1]
    sides = [
        np.cos(angle + turn) * x + np.sin(angle + turn) * y
        for turn in ((np.pi - opening) / 2, -(np.pi - opening) / 2)
    ]
    when = np.maximum(*sides) + rng.normal(0, noise, x.shape)
    fired = when <= 0
    # Where the wedge has not come yet, an older edge has been.
    stamps = np.where(fired, 1_000_000 * (100 + when), 1_000_000 * rng.uniform(0, 10, x.shape))
    return (stamps * 1000).astype(np.int64) + rng.permutation(x.size).reshape(x.shape)


@pytest.mark.slow
def test_agrees_with_the_definition() -> None:
    rng = np.random.default_rng(SEED)
    verdicts = []
    for i in range(600):
        angle, opening = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, np.pi)
        surface = swept(angle, opening, 0.3 * (i % 3), rng)
        if i % 6 == 0:
            surface = rng.permutation(SIDE * SIDE).reshape(SIDE, SIDE).astype(np.int64)
        both = np.repeat(surface[:, :, None], 2, axis=2)
        score = harris_score(both, 0, C, C, np.zeros(SCRATCH, dtype=np.int64))
        assert score == pytest.approx(oracle_score(surface), abs=1e-9)
        verdicts.append(corner(surface))
        assert verdicts[-1] == oracle(surface)
    assert 50 < np.count_nonzero(verdicts) < 500


@pytest.mark.parametrize("quarter", range(4))
def test_a_drawn_corner_is_one_and_an_edge_is_none(quarter: int) -> None:
    y, x = np.mgrid[-C : C + 1, -C : C + 1]
    for when, expected in ((np.maximum(x, y), True), (x, False), (x + y, False)):
        surface = np.rot90(np.where(when <= 0, 1000 + when, NEVER_NS), quarter)
        assert corner(np.ascontiguousarray(surface)) is expected


def test_an_arc_does_not_end_among_pixels_that_never_fired() -> None:
    """On a young surface a straight edge has fired half of the circle: seven to nine pixels are no corner."""
    scratch = np.zeros(SCRATCH, dtype=np.int64)
    for fired in range(1, 16):
        values = np.full(16, NEVER_NS, dtype=np.int64)
        values[:fired] = 1000 + np.arange(fired)
        values = np.roll(values, 3 + fired)
        # What fired has distinct stamps: the newest three are an arc; from ten on, so are the others.
        scratch[:16] = values
        assert _is_one_arc(scratch, 16, int(np.argmax(values)), 3, 6) == (fired >= 3)
        scratch[:16] = -values
        assert _is_one_arc(scratch, 16, int(np.argmin(values)), 3, 6) == (fired >= 10)


def test_equal_stamps_are_neighbours() -> None:
    """A sensor's clock ticks in whole microseconds: what fired in one tick may be in the arc or outside."""
    scratch = np.zeros(SCRATCH, dtype=np.int64)
    scratch[:16] = 1
    scratch[2:6] = 7
    assert _is_one_arc(scratch, 16, 2, 3, 6)
    scratch[10] = 7
    assert _is_one_arc(scratch, 16, 2, 3, 6)
    scratch[10] = 8
    assert not _is_one_arc(scratch, 16, 10, 3, 6)


def test_nothing_is_a_corner_on_an_empty_surface_or_near_the_rim() -> None:
    empty = np.full((SIDE, SIDE), NEVER_NS, dtype=np.int64)
    empty[C, C] = 5
    assert not corner(empty)
    rng = np.random.default_rng(SEED)
    surface = rng.permutation(SIDE * SIDE).reshape(SIDE, SIDE).astype(np.int64)
    for x in range(SIDE):
        for y in range(SIDE):
            if not (MARGIN <= x < SIDE - MARGIN and MARGIN <= y < SIDE - MARGIN):
                assert not corner(surface, x, y)


def test_corners_do_not_depend_on_the_epoch_of_the_clock() -> None:
    """Wedges with repeated stamps: beyond 2006 a stamp is larger than that of a pixel that never fired."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[-10:10, -10:10]
    corners = 0
    for _ in range(500):
        angle, half = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 1.2)
        away = np.abs((np.arctan2(v, u) - angle + np.pi) % (2 * np.pi) - np.pi)
        inside = (away < half) | ((u == 0) & (v == 0))
        t_ns = np.where(inside, rng.integers(1000, 1002, u.shape), rng.integers(995, 1001, u.shape)) * 100_000
        fired = inside | (rng.random(u.shape) < 0.9)
        found = []
        for epoch_ns in (0, 1_780_000_000 * 10**9):
            surface = make_surface(20, 20)
            surface.latest_ns[fired, 1] = t_ns[fired] + epoch_ns
            found.append(is_corner(surface.latest_ns, 1, 10, 10, np.zeros(SCRATCH, dtype=np.int64)))
        assert found[0] == found[1]
        corners += found[0]
    assert corners > 20
