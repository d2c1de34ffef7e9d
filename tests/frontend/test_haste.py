"""HASTE baseline: the tracker against a brute-force oracle, and the event loop on a translating texture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.config import FrontendConfig
from asyneio.frontend.haste.kernel import (
    HASTE_DTYPE,
    HYSTERESIS,
    LEARNING_RATE,
    MIDDLE,
    RADIUS,
    SIDE,
    STEPS,
    WINDOW,
    feed,
)
from asyneio.frontend.haste.tracker import HasteTracker
from asyneio.frontend.tracker import FREE, GROWING, TRACKING
from asyneio.types import EVENT_DTYPE, FloatArray, RecordArray
from tests.conftest import SEED

WIDTH, HEIGHT = 120, 90


def new_feature(x: float, y: float) -> RecordArray:
    """A feature (1,) HASTE_DTYPE as it is at birth."""
    feature = np.zeros(1, dtype=HASTE_DTYPE)
    feature["state"], feature["x"], feature["y"] = GROWING, x, y
    return feature


class Oracle:
    """The published algorithm by brute force: no score survives an event, nothing is a ring."""

    def __init__(self, x: float, y: float) -> None:
        self.pose = np.array([x, y, 0.0])
        self.events: list[tuple[float, float]] = []
        self.template = np.zeros((SIDE, SIDE))
        self.reference = np.zeros((SIDE, SIDE))

    def places(self, pose: FloatArray, events: FloatArray) -> FloatArray:
        """Patch coordinates (N,2) of events (N,2) under a pose (3,)."""
        turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
        return (events - pose[:2]) @ turn + RADIUS

    def weights(self, place: FloatArray) -> FloatArray:
        """Bilinear weights (SIDE,SIDE) of a place in the patch; none beyond it."""
        if np.any(place < 0) or np.any(place >= SIDE - 1):
            return np.zeros((SIDE, SIDE))
        u, v = (np.maximum(0, 1 - np.abs(np.arange(SIDE) - c)) for c in place)
        return np.outer(v, u)

    def scores(self) -> FloatArray:
        window = np.array(self.events[-WINDOW:])
        every = np.concatenate([self.places(self.pose + step, window) for step in STEPS])
        inside = np.all((every >= 0) & (every < SIDE - 1), axis=1)
        corner = np.floor(np.where(inside[:, None], every, 0)).astype(int)
        a, b = (np.where(inside[:, None], every, 0) - corner).T
        u, v = corner.T
        r = self.reference
        value = (1 - b) * ((1 - a) * r[v, u] + a * r[v, u + 1])
        value += b * ((1 - a) * r[v + 1, u] + a * r[v + 1, u + 1])
        return np.sum((value * inside).reshape(len(STEPS), WINDOW), axis=1)

    def begin(self) -> None:
        self.template = sum(self.weights(p) for p in self.places(self.pose, np.array(self.events)))
        self.reference = self.template.copy()

    def go(self, step: int) -> None:
        if step:
            self.pose = self.pose + STEPS[step]
            self.reference = self.template.copy()
        middle = np.array(self.events[-WINDOW:])[[MIDDLE]]
        self.template = self.template + LEARNING_RATE * self.weights(self.places(self.pose, middle)[0])


@pytest.mark.slow
@settings(max_examples=4)
@given(seed=st.integers(0, 2**32 - 1), drift=st.floats(-0.05, 0.05), spin=st.floats(-0.004, 0.004))
def test_scores_and_decisions_equal_brute_force(seed: int, drift: float, spin: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-11, 11, (12, 2))
    feature, oracle = new_feature(50, 40), Oracle(50, 40)
    for i in range(2 * WINDOW + 150):
        c, s = np.cos(spin * i), np.sin(spin * i)
        p = points[rng.integers(len(points))] @ np.array([[c, s], [-s, c]]) + rng.normal(0, 0.5, 2)
        x, y = np.rint(p + np.array([50 + drift * i, 40])).astype(int)
        before = feature["x"][0], feature["y"][0], feature["turn"][0]
        changed = feed(feature[0], 1000 * i, x, y)
        oracle.events.append((x, y))
        assert changed == (i == WINDOW - 1) or i >= WINDOW
        if i < WINDOW - 1:
            continue
        assert feature["t_ns"][0] == 1000 * (i - (WINDOW - 1 - MIDDLE))
        if i == WINDOW - 1:
            oracle.begin()
        else:
            score = oracle.scores()
            excess = (score - score[0]) / np.ptp(score)
            moved = np.array([feature["x"][0], feature["y"][0], feature["turn"][0]]) - before
            step = int(np.argmin(np.linalg.norm(STEPS - moved, axis=1)))
            # On a tie either decision is right, and the oracle follows.
            assert changed == (step != 0)
            assert excess[step] >= excess.max() - 1e-9 if changed else excess.max() <= HYSTERESIS + 1e-9
            assert not changed or excess[step] > HYSTERESIS - 1e-9
            oracle.go(step)
        assert np.allclose(feature["score"][0], oracle.scores(), rtol=1e-9)
    assert np.allclose(feature["template"][0], oracle.template, atol=1e-9)


@pytest.mark.parametrize(
    ("velocity", "spin"),
    [((0.02, 0.0), 0.0), ((-0.012, 0.016), 0.0), ((0.0, 0.0), 0.0006), ((0.0, 0.0), -0.0006)],
)
def test_pattern_is_followed(velocity: tuple[float, float], spin: float) -> None:
    """Twenty points, translating [px/event] or turning [rad/event], dithered to pixels."""
    rng = np.random.default_rng(SEED)
    points = rng.uniform(-9, 9, (20, 2))
    n = 1500
    feature = new_feature(60, 45)
    for i in range(n):
        c, s = np.cos(spin * i), np.sin(spin * i)
        p = points[rng.integers(len(points))] @ np.array([[c, s], [-s, c]]) + i * np.array(velocity)
        x, y = np.rint(p + np.array([60, 45]) + rng.uniform(-0.5, 0.5, 2)).astype(int)
        if np.hypot(x - feature["x"][0], y - feature["y"][0]) < RADIUS:
            feed(feature[0], i, x, y)
    # The template belongs to the middle of the first window, the state to the middle of the last.
    travelled = feature["t_ns"][0] - MIDDLE
    error = np.array([feature["x"][0] - 60, feature["y"][0] - 45]) - travelled * np.array(velocity)
    assert np.hypot(*error) < 1.5
    assert abs(feature["turn"][0] - travelled * spin) < np.deg2rad(6.0)


@pytest.fixture(scope="module")
def texture() -> RecordArray:
    """Events (N,) of random 9 px blocks that move right at 100 px/s and down at 50 px/s for half a second."""
    rng = np.random.default_rng(SEED)
    blocks = np.kron(rng.uniform(0, 1, (30, 34)), np.ones((9, 9)))
    packets = []
    steps = 100
    for i in range(steps):
        # Half pixels, so that the two axes do not always move together.
        a, b = (
            blocks[60 - j // 4 : 60 - j // 4 + HEIGHT, 60 - j // 2 : 60 - j // 2 + WIDTH] for j in (i, i + 1)
        )
        y, x = np.nonzero(np.abs(b - a) > 0.15)
        order = rng.permutation(x.size)
        events = np.zeros(x.size, dtype=EVENT_DTYPE)
        events["t_ns"] = 5_000_000 * i + np.sort(rng.integers(0, 5_000_000, x.size))
        events["x"], events["y"] = x[order], y[order]
        events["p"] = (b - a)[y[order], x[order]] > 0
        packets.append(events)
    return np.concatenate(packets)


def run(
    events: RecordArray, packet: int = 100_000, max_features: int = 30
) -> tuple[HasteTracker, RecordArray]:
    config = FrontendConfig(tracker="haste", max_features=max_features, min_interval_s=0.005)
    tracker = HasteTracker(config, WIDTH, HEIGHT)
    pieces = [tracker.process(events[i : i + packet]) for i in range(0, events.size, packet)]
    return tracker, np.concatenate(pieces)


def test_features_move_with_the_texture(texture: RecordArray) -> None:
    tracker, observations = run(texture)
    errors = []
    for track in range(tracker.statistics().tracks):
        o = observations[observations["id"] == track]
        seconds = (o["t_ns"] - o["t_ns"][0]) * 1e-9
        assert np.all(np.diff(o["t_ns"]) >= tracker.settings.t_min_ns)
        errors.append(np.hypot(o["u"] - o["u"][0] - 100 * seconds, o["v"] - o["v"][0] - 50 * seconds))
    error = np.concatenate(errors)
    assert tracker.statistics().tracks > 20
    assert error.size > 300
    assert np.median(error) < 1.5


def test_capacity_and_border_are_respected(texture: RecordArray) -> None:
    tracker, observations = run(texture, packet=500, max_features=8)
    border = tracker.settings.border_px
    assert tracker.arrays.state["alive"][0] == np.count_nonzero(tracker.arrays.records["state"]) == 8
    assert observations["u"].min() >= border
    assert observations["v"].min() >= border
    assert observations["u"].max() <= WIDTH - 1 - border
    assert observations["v"].max() <= HEIGHT - 1 - border


def test_silent_features_are_removed(texture: RecordArray) -> None:
    tracker, _ = run(texture)
    assert np.any(tracker.arrays.records["state"] == TRACKING)
    late = texture[-1:].copy()
    late["t_ns"] += tracker.settings.t_max_ns // 2
    tracker.process(late)
    age_ns = late["t_ns"] - tracker.arrays.records["t_ns"][tracker.arrays.records["state"] != FREE]
    assert 0 < age_ns.size == tracker.arrays.state["alive"][0]
    assert age_ns.max() <= tracker.settings.t_max_ns
    late["t_ns"] += tracker.settings.t_max_ns
    tracker.process(late)
    assert tracker.arrays.state["alive"][0] == 0
    assert tracker.statistics().ended_silent >= age_ns.size


def test_result_depends_on_the_events_alone(texture: RecordArray) -> None:
    _, whole = run(texture)
    _, again = run(texture)
    _, pieces = run(texture, packet=777)
    np.testing.assert_array_equal(whole, again)
    np.testing.assert_array_equal(whole, pieces)


def test_no_events_no_observations() -> None:
    tracker, _ = run(np.zeros(1, dtype=EVENT_DTYPE))
    assert tracker.process(np.zeros(0, dtype=EVENT_DTYPE)).size == 0
