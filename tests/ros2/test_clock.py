"""Sensor time becomes ROS time: ascending, without jitter of the transport, through drift and resets."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.ros2.clock import ClockJumpError, OnlineClock
from asyneio.types import NS_PER_S, IntArray

ROS_NS = 17 * 10**17


def run(clock: OnlineClock, sensor_ns: IntArray, stamp_ns: IntArray) -> IntArray:
    """Converted times of all messages from the first known offset on."""
    found = []
    for sensor, stamp in zip(sensor_ns.tolist(), stamp_ns.tolist(), strict=True):
        clock.update(sensor, stamp)
        if clock.offset_ns is not None:
            found.append(int(clock.to_ros(np.array([sensor]))[0]))
    return np.array(found, dtype=np.int64)


@pytest.mark.slow
@pytest.mark.parametrize("drift_ppm", [0.0, 40.0, -80.0])
def test_offset_and_drift(rng: np.random.Generator, drift_ppm: float) -> None:
    sensor_ns = np.arange(0, 120 * NS_PER_S, 4_000_000, dtype=np.int64)
    true_ns = ROS_NS + sensor_ns + np.rint(sensor_ns * drift_ppm * 1e-6).astype(np.int64)
    delay_ns = 1_000_000 + rng.exponential(2_000_000, sensor_ns.size).astype(np.int64)
    found = run(OnlineClock(), sensor_ns, true_ns + delay_ns)
    assert (np.diff(found) > 0).all()
    late_ns = found - true_ns[-found.size :]
    # What remains is the lower decile of the delay: 1 ms and 0.105 times the mean of the jitter.
    settled = late_ns[-found.size // 3 :]
    assert np.abs(settled - 1_210_000).max() < 300_000
    assert sensor_ns.size - found.size <= 126


def test_times_in_ros_time_are_unchanged() -> None:
    t_ns = ROS_NS + np.arange(1000, dtype=np.int64) * 10**6
    found = run(OnlineClock(), t_ns, t_ns + 20_000_000)
    np.testing.assert_array_equal(found, t_ns)


def test_a_single_wrong_stamp_changes_nothing() -> None:
    sensor_ns = np.arange(0, 20 * NS_PER_S, 10_000_000, dtype=np.int64)
    stamps = ROS_NS + sensor_ns
    stamps[1000] += 100 * NS_PER_S
    found = run(OnlineClock(), sensor_ns, stamps)
    np.testing.assert_allclose(np.diff(found), 10_000_000, atol=1)


def test_a_clock_that_is_set_is_reported() -> None:
    sensor_ns = np.arange(0, 4 * NS_PER_S, 10_000_000, dtype=np.int64)
    stamps = ROS_NS + sensor_ns + (sensor_ns > 2 * NS_PER_S) * 30 * NS_PER_S
    with pytest.raises(ClockJumpError, match=r"jump relative to each other by 30\.000 s"):
        run(OnlineClock(), sensor_ns, stamps)


def test_a_recording_that_is_played_again_needs_no_memory() -> None:
    """Sensor times and stamps jump back together, and everything that was collected is forgotten."""
    sensor_ns = np.arange(0, 10 * NS_PER_S, 10_000_000, dtype=np.int64)
    twice = np.concatenate([sensor_ns, sensor_ns])
    clock = OnlineClock()
    found = run(clock, twice, ROS_NS + twice)
    np.testing.assert_allclose(found[-sensor_ns.size :], ROS_NS + sensor_ns, atol=1000)
    assert len(clock._delays) <= 100
