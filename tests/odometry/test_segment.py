"""A new segment forgets everything of the one before it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from asyneio.odometry import Odometry
from asyneio.odometry.initializer.initialize import retry_ns
from asyneio.types import Health, Packet
from tests.odometry.runs import configured, cut, simulated

#: Values that cannot be changed and may therefore be shared.
_IMMUTABLE = (type(None), bool, int, float, str, bytes, type, np.generic, np.dtype)


def reachable(*roots: object) -> dict[int, Any]:
    """Every object that can be changed and is reached from `roots`, by identity."""
    found: dict[int, Any] = {}
    waiting = list(roots)
    while waiting:
        value = waiting.pop()
        if isinstance(value, _IMMUTABLE) or callable(value) or id(value) in found:
            continue
        if isinstance(value, tuple) and not value:
            continue  # exists once in a process
        found[id(value)] = value
        if isinstance(value, np.ndarray):
            waiting.append(value.base)
        elif isinstance(value, dict):
            waiting.extend(value.values())
        elif isinstance(value, list | tuple | set):
            waiting.extend(value)
        waiting.extend(vars(value).values() if hasattr(value, "__dict__") else [])
    return found


def shared(odometry: Odometry, old: object, new: object) -> list[str]:
    """Types of the objects that both segments refer to, but for what the user gave."""
    given = reachable(odometry._config, odometry._calibration)
    before, after = reachable(old), reachable(new)
    return [type(after[key]).__name__ for key in after.keys() & before.keys() - given.keys()]


def tracking() -> tuple[Odometry, list[Packet]]:
    """An initialized odometry, and the packets that it has processed."""
    recording = simulated().recording
    odometry, packets = Odometry(configured(), recording.calibration), cut(recording)[:24]
    for packet in packets:
        odometry.process(packet)
    assert odometry._segment.tracking is not None
    return odometry, packets


@pytest.mark.slow
def test_reachable_objects_include_arrays_and_what_holds_them() -> None:
    """The test can fail: the packets of a segment are found in its buffer, and it shares all with itself."""
    odometry, _ = tracking()
    segment = odometry._segment
    found = reachable(segment)
    for held in (segment.buffer.gyroscope, segment.health, segment.tracking, segment.stationary.phase):
        assert held is None or id(held) in found
    assert len(shared(odometry, segment, segment)) > 50


@pytest.mark.slow
def test_a_segment_after_a_clock_reset_refers_to_nothing_before() -> None:
    odometry, packets = tracking()
    old = odometry._segment
    _, report = odometry.process(packets[0])
    assert report.health is Health.LOST
    new = odometry._segment
    assert (old.number, new.number) == (0, 1)
    assert new.tracking is None
    assert shared(odometry, old, new) == []
    # It begins with this packet alone.
    assert new.buffer.end_ns == packets[0].t_end_ns
    assert len(new.buffer.gyroscope) <= len(packets[0].gyroscope)


@pytest.mark.slow
def test_a_segment_after_a_loss_begins_without_any_measurement() -> None:
    """Any motion exceeds this limit of the speed: the first knot after the first window is LOST."""
    recording = simulated().recording
    odometry = Odometry(configured(health={"max_speed": 1e-3}), recording.calibration)
    old, report = odometry._segment, None
    for packet in cut(recording)[:24]:
        _, report = odometry.process(packet)
        if report.health is Health.LOST:
            break
    assert report is not None
    assert report.health is Health.LOST
    assert old.tracking is not None
    new = odometry._segment
    assert (old.number, new.number) == (0, 1)
    assert shared(odometry, old, new) == []
    assert (new.tracking, new.next_attempt_ns, new.stationary.phase, new.buffer.end_ns) == (None,) * 4
    assert new.attempts == 0
    assert len(new.buffer.observations.t_ns) == len(new.buffer.raw.gyroscope) == 0
    assert new.health.status == (Health.TRACKING, "")


def test_attempts_become_rarer() -> None:
    times = [retry_ns(attempts) for attempts in range(20)]
    assert (times[0], times[3], times[4], times[-1]) == (250_000_000, 250_000_000, 500_000_000, 750_000_000)
    assert times == sorted(times)
    # No attempt of this run succeeds; one every 0.3 s would make eleven.
    recording = simulated().recording
    odometry = Odometry(configured(initialization={"max_scale_sigma": 1e-6}), recording.calibration)
    for packet in cut(recording):
        _, report = odometry.process(packet)
        assert report.health is Health.INITIALIZING
    assert 4 < odometry._segment.attempts < 9
