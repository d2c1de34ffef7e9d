"""What arrives is checked, memory is bounded, load is shed step by step."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from asyneio.io.recording.event_source import pack_events
from asyneio.live import inbox as inbox_module
from asyneio.live.chunks import Break, Chunk
from asyneio.live.gravity import GravityCheck
from asyneio.live.guard import StreamGuard
from asyneio.live.inbox import EndOfSource, Inbox
from asyneio.live.load import LoadControl
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, OBSERVATION_DTYPE, Packet, RecordArray


def events(t_ns: np.ndarray, x: int = 1) -> RecordArray:
    full = np.full(t_ns.size, x, dtype=np.int64)
    return pack_events(t_ns.astype(np.int64), full, full, full % 2)


def samples(t_ns: np.ndarray) -> RecordArray:
    rows = np.zeros(t_ns.size, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = t_ns
    return rows


def passed(guard: StreamGuard, **rows: RecordArray) -> list[Chunk | Break]:
    return list(guard.passed(Chunk(0.0, **rows)))


STEADY = np.arange(0, NS_PER_S, 100_000)


def test_good_data_pass_unchanged() -> None:
    guard = StreamGuard(32, 32)
    good = events(STEADY)
    (chunk,) = passed(guard, events=good)
    assert isinstance(chunk, Chunk)
    np.testing.assert_array_equal(chunk.events, good)


def test_isolated_stamps_and_foreign_pixels_are_dropped() -> None:
    guard = StreamGuard(32, 32)
    bad = events(STEADY)
    bad["t_ns"][[50, 99]] = [10**15, -(10**17)]
    bad["x"][7] = 32
    bad["p"][8] = 2
    (chunk,) = passed(guard, events=bad)
    assert isinstance(chunk, Chunk)
    assert chunk.events.size == bad.size - 4
    assert (guard.counts.isolated_stamps, guard.counts.rejected_events, guard.counts.jumps) == (2, 2, 0)


def test_samples_that_are_not_finite_are_dropped() -> None:
    guard = StreamGuard(32, 32)
    rows = samples(STEADY[:20])
    rows["xyz"][3, 1] = np.nan
    (chunk,) = passed(guard, gyroscope=rows)
    assert isinstance(chunk, Chunk)
    assert chunk.gyroscope.size == 19
    assert guard.counts.not_finite == 1


@pytest.mark.parametrize(("jump_s", "said"), [(-5.0, "jumps back by"), (60.0, "jumps ahead by")])
def test_a_jump_of_the_clock_breaks_the_stream(jump_s: float, said: str) -> None:
    guard = StreamGuard(32, 32)
    passed(guard, events=events(STEADY), gyroscope=samples(STEADY[::10]))
    found = passed(guard, events=events(STEADY + NS_PER_S + round(jump_s * NS_PER_S)))
    assert isinstance(found[0], Break)
    assert said in found[0].reason
    assert isinstance(found[1], Chunk)
    assert found[1].events.size > 0.9 * STEADY.size
    assert guard.counts.jumps == 1
    # The other stream follows to the new time without a jump of its own.
    after = passed(guard, gyroscope=samples(STEADY[::10] + NS_PER_S + round(jump_s * NS_PER_S)))
    assert all(isinstance(part, Chunk) for part in after)


def test_a_gap_is_no_jump() -> None:
    guard = StreamGuard(32, 32)
    passed(guard, events=events(STEADY))
    found = passed(guard, events=events(STEADY + 4 * NS_PER_S))
    assert all(isinstance(part, Chunk) for part in found)
    assert guard.counts.jumps == 0


def test_a_silent_camera_beside_a_running_imu_loses_nothing() -> None:
    guard = StreamGuard(32, 32)
    passed(guard, events=events(STEADY), gyroscope=samples(STEADY[::10]))
    for k in range(1, 6):
        passed(guard, gyroscope=samples(STEADY[::10] + k * NS_PER_S))
    (chunk,) = passed(guard, events=events(STEADY + 5 * NS_PER_S))
    assert isinstance(chunk, Chunk)
    assert chunk.events.size == STEADY.size


def test_the_inbox_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox_module, "MOST_EVENTS", 1000)
    monkeypatch.setattr(inbox_module, "MOST_CHUNKS", 60)
    box = Inbox(can_wait=False)
    for _ in range(100):
        box.put(Chunk(time.perf_counter(), events(STEADY[:100]), samples(STEADY[:5])))
    box.put(EndOfSource())
    held = []
    while not isinstance(item := box.get(0.0), EndOfSource):
        assert isinstance(item, Chunk)
        held.append(item)
    assert sum(chunk.events.size for chunk in held) == 1000
    assert box.counts.events == 10_000
    assert box.counts.dropped == 9000
    assert sum(chunk.gyroscope.size for chunk in held) == 300


def test_thinning_is_even() -> None:
    box = Inbox(can_wait=False)
    box.stride = 4
    box.put(Chunk(0.0, events(STEADY[:100])))
    item = box.get(0.0)
    assert isinstance(item, Chunk)
    np.testing.assert_array_equal(item.events["t_ns"], STEADY[:100:4])
    assert box.counts.thinned == 75


def test_a_source_that_can_wait_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox_module, "_CHUNKS_AHEAD", 3)
    box = Inbox(can_wait=True)
    put = []

    def work() -> None:
        for k in range(10):
            box.put(Chunk(float(k), events(STEADY[:10])))
            put.append(k)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    taken = 0
    while taken < 10:
        assert len(put) <= taken + 4
        item = box.get(5.0)
        assert isinstance(item, Chunk)
        taken += 1
    thread.join(5.0)
    assert box.counts.dropped == box.counts.thinned == 0


def test_dropped_backlog_is_counted_and_marks_stay() -> None:
    box = Inbox(can_wait=False)
    box.put(Chunk(0.0, events(STEADY[:100]), samples(STEADY[:5])))
    box.put(Break("gone"))
    box.drop_chunks()
    assert isinstance(box.get(0.0), Break)
    assert (box.counts.dropped, box.counts.dropped_samples) == (100, 5)


@pytest.mark.parametrize(("scale", "wrong"), [(1.0, False), (0.5, True)])
def test_gravity_is_asked_once(scale: float, wrong: bool) -> None:
    check, told = GravityCheck(), []
    for second in range(14):
        stamps = second * NS_PER_S + np.arange(0, NS_PER_S, 5_000_000)
        gyroscope, accelerometer = samples(stamps), samples(stamps)
        accelerometer["xyz"][:, 2] = 9.81 * scale
        rows = np.empty(0, dtype=OBSERVATION_DTYPE)
        told.append(check.add(Packet((second + 1) * NS_PER_S, rows, gyroscope, accelerometer)))
    assert sum(told) == wrong
    assert bool(check.complaint) == wrong


def test_no_backlog_changes_nothing() -> None:
    load = LoadControl(0.0, 0.5)
    for _ in range(100):
        load.update(0.01, 0.08, 0.0)
    assert (load.share, load.tracks, load.stride) == (0.0, 1.0, 1)


def test_a_slow_front_end_is_limited_and_recovers() -> None:
    load = LoadControl(0.0, 0.5)
    shares = []
    for _ in range(40):
        load.update(0.4, 0.2, 0.0)
        shares.append(load.share)
    # The first ones may be a pause that is over.
    assert shares[:3] == [0.0, 0.0, 1.0]
    assert (np.diff(shares[2:]) <= 0.0).all()
    assert 0.0 < shares[-1] <= 0.06
    assert load.tracks == 1.0
    load.update(2.0, 0.2, 0.0)
    assert load.stride > 1
    for _ in range(120):
        load.update(0.0, 0.01, 0.0)
    assert (load.share, load.stride) == (0.0, 1)


@pytest.mark.parametrize("waited_s", [0.0, 0.2])
def test_a_backlog_that_is_worked_off_changes_nothing(waited_s: float) -> None:
    """What an initialization leaves behind, beyond the longest backlog."""
    load = LoadControl(0.0, 0.5)
    for backlog_s in (0.0, 0.7, *np.arange(1.0, 0.0, -0.05).tolist(), 0.3, 0.25, 0.0):
        load.update(backlog_s, 0.06, waited_s)
    assert (load.share, load.tracks, load.stride) == (0.0, 1.0, 1)


def test_a_slow_estimator_is_given_fewer_tracks() -> None:
    load = LoadControl(0.0, 0.5)
    for _ in range(40):
        load.update(0.4, 0.01, 0.2)
    assert load.share == 0.0
    rows = np.zeros(1000, dtype=OBSERVATION_DTYPE)
    rows["id"] = np.arange(1000)
    few = load.kept(rows)
    assert 200 < few.size < 400
    load.update(0.0, 0.01, 0.0)
    # The same tracks, and some more.
    assert np.isin(few["id"], load.kept(rows)["id"]).all()
