"""The state machine by itself: every finding and its reason, hysteresis, and findings that last."""

from __future__ import annotations

from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.config import Config, HealthConfig
from asyneio.odometry.health.continuity import Continuity, Jumps, field_of_view
from asyneio.odometry.health.metrics import ScaleChanges
from asyneio.odometry.health.state_machine import HealthMetrics, HealthStateMachine
from asyneio.odometry.intervals import sample_gap_s
from asyneio.odometry.raw_measurements import RawMeasurements
from asyneio.odometry.segment import Segment
from asyneio.simulation.faults import held
from asyneio.simulation.tracks.scenario import DAVIS240C
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, OBSERVATION_DTYPE, Health, Packet, RecordArray
from tests.odometry.runs import plain_run, simulated

STEP_NS = 100_000_000
WELL = HealthMetrics(
    since_vision_s=0.02,
    inertial_gap_s=0.005,
    landmarks=60,
    speed=1.0,
    bias_sigmas=1.0,
    velocity_sigma=0.05,
    tilt_sigma_rad=0.01,
)


def states(sequence: list[HealthMetrics]) -> list[tuple[Health, str]]:
    monitor = HealthStateMachine(HealthConfig())
    return [monitor.update(k * STEP_NS, metrics) for k, metrics in enumerate(sequence)]


def test_well_stays_tracking() -> None:
    assert set(states([WELL] * 20)) == {(Health.TRACKING, "")}


@pytest.mark.parametrize(
    ("finding", "words"),
    [
        ({"since_vision_s": 0.11}, "no observations for 0.11 s"),
        ({"inertial_gap_s": 0.06}, "no inertial samples for 0.06 s"),
        ({"landmarks": 4}, "4 landmarks in view"),
        ({"saturated": True}, "an inertial sensor is saturated"),
        ({"rejected_samples": 0.3}, "30 % of the inertial samples were rejected"),
        ({"scale_change": -0.2}, "scale was revised by -20 %"),
        ({"scale_change": 0.25}, r"scale was revised by +25 %"),
        ({"velocity_revision": 25.0}, "velocity was revised by 5.0 standard deviations"),
        ({"scale_sigma": 0.15}, "the standard deviation of scale is 15 %"),
        ({"rejected_observations": 0.6}, "60 % of the observations contradict"),
        ({"unconfirmed": True}, "a moving object was in view during the initialization"),
        ({"rejected_tracks": 0.6}, "60 % of the new tracks were rejected"),
        ({"visual_ratio": 9.0}, "observations deviate by 3.0 standard deviations"),
        ({"inertial_ratio": 9.0}, "inertial samples deviate by 3.0 standard deviations"),
        ({"velocity_sigma": 1.5}, "the standard deviation of the velocity is 1.5 m/s"),
        ({"tilt_sigma_rad": 0.1}, "the standard deviation of roll and pitch is 5.7 deg"),
    ],
)
def test_degraded_and_back(finding: dict[str, Any], words: str) -> None:
    """One bad knot: degraded at once, and for half a second after it."""
    found = states([WELL, replace(WELL, **finding), *[WELL] * 6])
    assert found[0][0] is Health.TRACKING
    assert found[1][0] is Health.DEGRADED
    assert words in found[1][1]
    assert [health for health, _ in found[2:]] == [Health.DEGRADED] * 4 + [Health.TRACKING] * 2
    assert all(reason.startswith("recovering: ") and words in reason for _, reason in found[2:6])


@pytest.mark.parametrize(
    ("finding", "words"),
    [
        ({"finite": False}, "not finite"),
        ({"inertial_gap_s": 0.6}, "no inertial samples for 0.60 s"),
        ({"scene_changed": True}, "replaced at once"),
        ({"speed": 80.0}, "the estimated speed is 80 m/s"),
        ({"bias_sigmas": 12.0}, "an estimated bias is 12 standard deviations"),
    ],
)
def test_lost_at_once(finding: dict[str, Any], words: str) -> None:
    health, reason = states([WELL, replace(WELL, **finding)])[-1]
    assert health is Health.LOST
    assert words in reason


@pytest.mark.parametrize(
    "finding", [{"rejected_observations": 0.9}, {"inertial_ratio": 30.0}, {"velocity_sigma": 2.0}]
)
def test_a_lasting_contradiction_ends_it(finding: dict[str, Any]) -> None:
    found = states([WELL, *[replace(WELL, **finding)] * 11])
    assert [health for health, _ in found[1:11]] == [Health.DEGRADED] * 10
    assert found[11][0] is Health.LOST
    assert found[11][1].endswith("for 1.0 s")
    # Interrupted by one good knot, it does not.
    bad = [replace(WELL, **finding)] * 8
    assert Health.LOST not in {health for health, _ in states([*bad, WELL, *bad])}


def test_new_tracks_that_contradict_end_a_young_segment_sooner() -> None:
    contradicted = replace(WELL, rejected_tracks=0.6)
    young = states([WELL, *[contradicted] * 30])
    assert [health for health, _ in young].index(Health.LOST) == 8
    assert young[8][1] == "60 % of the new tracks were rejected, for 0.7 s"
    # Half of the age, two seconds at most.
    assert [health for health, _ in states([*[WELL] * 20, *[contradicted] * 30])].index(Health.LOST) == 40
    assert [health for health, _ in states([*[WELL] * 90, *[contradicted] * 30])].index(Health.LOST) == 110


def test_a_lasting_shortage_does_not() -> None:
    blind = [replace(WELL, since_vision_s=0.1 * k, landmarks=0) for k in range(2, 60)]
    assert {health for health, _ in states(blind)} == {Health.DEGRADED}


def test_nothing_is_missing_while_stationary() -> None:
    stationary = replace(WELL, since_vision_s=10.0, landmarks=0, stationary=True)
    assert set(states([stationary] * 5)) == {(Health.TRACKING, "")}


@pytest.mark.slow
@settings(deadline=None)
@given(
    st.lists(
        st.builds(
            HealthMetrics,
            since_vision_s=st.floats(0.0, 1.0),
            inertial_gap_s=st.floats(0.0, 0.7),
            landmarks=st.integers(0, 20),
            rejected_observations=st.floats(0.0, 1.0),
            scene_changed=st.booleans(),
            velocity_sigma=st.floats(0.0, 2.0),
            stationary=st.booleans(),
        ),
        max_size=40,
    )
)
def test_every_state_but_tracking_has_a_reason(sequence: list[HealthMetrics]) -> None:
    for health, reason in states(sequence):
        assert bool(reason) == (health is not Health.TRACKING)


def stamped(*seconds: float) -> RecordArray:
    samples = np.zeros(len(seconds), dtype=INERTIAL_DTYPE)
    samples["t_ns"] = np.rint(np.array(seconds) * 1e9)
    return samples


def test_gaps_count_from_the_last_sample_to_the_next_or_to_the_end() -> None:
    dense = stamped(*np.arange(0.0, 2.0, 0.005))
    second = 1_000_000_000
    assert sample_gap_s((dense, dense), second, second + STEP_NS) == pytest.approx(0.005)
    # Began before the interval; ends in it; not over; in one sensor alone.
    assert sample_gap_s((stamped(0.7, 1.05, 1.1), dense), second, second + STEP_NS) == pytest.approx(0.35)
    assert sample_gap_s((dense, stamped(0.99, 1.02)), second, second + STEP_NS) == pytest.approx(0.08)
    assert sample_gap_s((dense, stamped()), second, second + STEP_NS) == pytest.approx(0.1)


@pytest.mark.parametrize(("sigma", "health"), [(0.0, Health.TRACKING), (0.12, Health.DEGRADED)])
def test_a_start_with_an_uncertain_scale_is_degraded(sigma: float, health: Health) -> None:
    monitor = Segment(0, Config(), simulated().recording.calibration).health
    status = monitor.begin(plain_run().estimates[0], sigma)
    assert status == monitor.status
    assert status.health is health
    assert ("standard deviation of scale is 12 %" in status.reason) == (sigma > 0.0)


@given(scale=st.floats(0.84, 1.19), seed=st.integers(0, 100))
def test_scale_changes_add_up_and_are_forgotten(scale: float, seed: int) -> None:
    path = np.cumsum(np.random.default_rng(seed).normal(size=(12, 3)), axis=0)
    changes = ScaleChanges()
    changes.add(0, path, np.sqrt(scale) * path + 5.0)
    assert changes.add(STEP_NS, path, np.sqrt(scale) * path) == pytest.approx(scale - 1.0)
    assert changes.add(30 * STEP_NS, path, path) == pytest.approx(0.0)
    # Without motion, positions do not show scale.
    assert changes.add(31 * STEP_NS, 1e-3 * path, 9e-3 * path) == pytest.approx(0.0)


def test_a_large_change_of_scale_is_reported_once() -> None:
    path = np.cumsum(np.random.default_rng(0).normal(size=(12, 3)), axis=0)
    changes = ScaleChanges()
    factors = (1.1, 1.15, 1.0, 0.8, 1.0)
    found = [changes.add(k * STEP_NS, path, factor * path) for k, factor in enumerate(factors)]
    assert found == pytest.approx([0.1, 0.265, 0.0, -0.2, 0.0])


def follow(continuity: Continuity, ids: list[range], *turns: tuple[float, float, float]) -> list[bool]:
    """One observation of each track in every interval of 0.1 s, in which the camera turns, by turns."""
    answers = []
    given = cycle(turns or [(0.01, 0.0, 0.0)])
    for k, alive in enumerate(ids):
        stamps = k * STEP_NS + np.linspace(1, STEP_NS, len(alive)).astype(np.int64)
        turn = np.array(next(given))
        answers.append(
            continuity.all_replaced((k + 1) * STEP_NS, stamps, np.array(alive, dtype=np.int64), turn)
        )
    return answers


def test_tracks_that_end_together() -> None:
    view = field_of_view(DAVIS240C)
    assert view == pytest.approx(0.847, abs=0.01)
    before, after = [range(30)] * 8, [range(100, 130)] * 8
    assert follow(Continuity(view), before + after) == [False] * 8 + [True] * 3 + [False] * 5
    # One that goes on, a pause, a fast turn, or hardly any tracks: nothing to conclude.
    assert not any(follow(Continuity(view), before + [range(29, 60)] * 8))
    assert not any(follow(Continuity(view), before + [range(0)] * 2 + after))
    assert not any(follow(Continuity(view), before + after, (0.0, 0.25, 0.0)))
    # Roll and shaking carry nothing out of the image.
    assert any(follow(Continuity(view), before + after, (0.0, 0.0, 0.4)))
    assert any(follow(Continuity(view), before + after, (0.0, 0.25, 0.0), (0.0, -0.25, 0.0)))
    assert not any(follow(Continuity(view), [range(15)] * 8 + [range(100, 115)] * 8))


def test_tracks_that_come_and_go_one_by_one() -> None:
    """A life of half a second each, a new one in every interval."""
    assert not any(follow(Continuity(0.8), [range(5 * k, 5 * k + 25) for k in range(30)]))


def test_a_cut_that_the_tracker_notices_late() -> None:
    """The last old features fail a fifth of a second after the cut, when new ones are followed already."""
    answers = follow(Continuity(0.8), [range(30)] * 8 + [range(20, 60), range(28, 60)] + [range(30, 60)] * 2)
    assert answers == [False] * 10 + [True, False]


def smooth_rates(count: int, seed: int) -> RecordArray:
    """A gyroscope at 500 Hz in lively motion, with noise."""
    samples = np.zeros(count, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = np.arange(count) * 2_000_000
    t_s = samples["t_ns"] / NS_PER_S
    samples["xyz"] = 2.0 * np.sin(2.0 * np.pi * np.outer(t_s, [1.1, 1.7, 2.3]))
    samples["xyz"] += 3e-3 * np.random.default_rng(seed).normal(size=(count, 3))
    return samples


def jumped(samples: RecordArray, step: float) -> list[bool]:
    """Whether a jump is known after each packet of 0.1 s; the rates step by `step` after a second."""
    moved = samples.copy()
    moved["xyz"][moved["t_ns"] >= NS_PER_S, 1] += step
    jumps, raw, found = Jumps(), RawMeasurements(), []
    for begin in range(0, len(moved), 50):
        jumps.update(with_rates(raw, moved[begin : begin + 50]))
        found.append(jumps.recent(int(raw.gyroscope["t_ns"][-1])))
        raw.drop_before(int(raw.gyroscope["t_ns"][-1]))
    return found


def with_rates(raw: RawMeasurements, gyroscope: RecordArray) -> RawMeasurements:
    """After another packet with samples of the gyroscope alone."""
    none = np.empty(0, dtype=OBSERVATION_DTYPE)
    raw.append(Packet(int(gyroscope["t_ns"][-1]), none, gyroscope, gyroscope[:0]))
    return raw


def test_a_jump_of_the_samples_is_known_for_a_while() -> None:
    samples = smooth_rates(1000, seed=3)
    assert not any(jumped(samples, 0.0))
    found = jumped(samples, 0.3)
    assert found[:10] == [False] * 10
    assert found[11:15] == [True] * 4
    assert found[-3:] == [False] * 3


@pytest.mark.parametrize("renewed", [1.6, 2.0, 3.0, 5.0])
def test_renewals_of_held_samples_are_no_jumps(renewed: float) -> None:
    samples = held(smooth_rates(1000, seed=3), renewed)
    assert not any(jumped(samples, 0.0))
    assert jumped(samples, 2.0)[11:15] == [True] * 4


def test_vibration_that_beats_is_no_jump() -> None:
    """Rotors of nearly the same speed, at 200 Hz: quiet for a moment, loud in the next."""
    samples = np.zeros(1000, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = np.arange(1000) * 5_000_000
    t_s = samples["t_ns"] / NS_PER_S
    waves = np.sin(2.0 * np.pi * 87.0 * t_s) - np.sin(2.0 * np.pi * 84.0 * t_s)
    samples["xyz"] = 0.2 * waves[:, None] + 3e-3 * np.random.default_rng(3).normal(size=(1000, 3))
    for begin in range(1, 20):
        jumps, raw = Jumps(), RawMeasurements()
        for first in range(begin, 1000, 20):
            jumps.update(with_rates(raw, samples[first : first + 20]))
            assert not jumps.recent(int(samples["t_ns"][first]))


def test_a_jump_from_rest_is_seen_by_a_coarse_sensor() -> None:
    """One that reads nothing but zero, but for a step now and then."""
    samples = smooth_rates(1000, seed=3)
    samples["xyz"] = 0.0
    samples["xyz"][::40] = 1e-3
    assert not any(jumped(samples, 0.0))
    assert jumped(samples, 0.3)[11:15] == [True] * 4
