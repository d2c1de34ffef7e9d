"""Packets of arriving chunks are those of the recording, however the data arrive."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.frontend import gyroscope_in_camera
from asyneio.io.recording.event_source import pack_events
from asyneio.live.chunks import Chunk
from asyneio.live.packetizer import Packetizer, RawPacket
from asyneio.pipeline.packets import event_counts, packets, usable_span
from asyneio.types import (
    INERTIAL_DTYPE,
    OBSERVATION_DTYPE,
    Calibration,
    CameraIntrinsics,
    EventRecording,
    ImuNoise,
    RecordArray,
)

INTERVAL, DELAY, PATIENCE = 100, 60, 1000


def calibration(shift_ns: int) -> Calibration:
    T = np.eye(4)
    T[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    camera = CameraIntrinsics(100.0, 100.0, 16.0, 16.0, 32, 32)
    return Calibration(camera, T, shift_ns, ImuNoise(1e-3, 1e-2, 1e-5, 1e-4))


def events_at(t_ns: np.ndarray) -> RecordArray:
    zeros = np.zeros(t_ns.size, dtype=np.int64)
    return pack_events(np.sort(t_ns), zeros, zeros, zeros)


def samples_at(t_ns: np.ndarray) -> RecordArray:
    rows = np.zeros(np.unique(t_ns).size, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = np.unique(t_ns)
    rows["xyz"] = np.random.default_rng(0).normal(size=(rows.size, 3))
    return rows


def recording_of(rng: np.random.Generator, shift_ns: int) -> EventRecording:
    events = events_at(rng.integers(rng.integers(0, 150), 1500, 400))
    gyroscope, accelerometer = (samples_at(rng.integers(rng.integers(0, 150), 1500, 120)) for _ in range(2))
    rig = calibration(shift_ns)
    return EventRecording("random", events, 32, 32, gyroscope, accelerometer, rig.camera, rig)


def cut_live(recording: EventRecording, steps: list[int], delay: int = DELAY) -> list[RawPacket]:
    """Chunks of each stream on its own schedule, in order of time, and all packets."""
    assert recording.calibration is not None
    packetizer = Packetizer(recording.calibration, (32, 32), INTERVAL, delay, PATIENCE)
    found = []
    names = ("events", "gyroscope", "accelerometer")
    for start in range(-200, 2000, 10):
        for name, step in zip(names, steps, strict=True):
            if start % (10 * step) == 0:
                rows = getattr(recording, name)
                part = rows[slice(*np.searchsorted(rows["t_ns"], [start, start + 10 * step]))]
                packetizer.feed(Chunk(float(start), **{name: np.array(part)}))
                while (packet := packetizer.next()) is not None:
                    found.append(packet)
    while (packet := packetizer.next(final=True)) is not None:
        found.append(packet)
    return found


@pytest.mark.slow
@settings(max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    shift=st.integers(-80, 80),
    delay=st.sampled_from([0, 60, 250]),
    steps=st.lists(st.integers(1, 12), min_size=3, max_size=3),
)
def test_packets_are_those_of_the_recording(seed: int, shift: int, delay: int, steps: list[int]) -> None:
    recording = recording_of(np.random.default_rng(seed), shift)
    start_ns, end_ns = usable_span(recording)
    count = (end_ns - start_ns) // INTERVAL
    found = cut_live(recording, steps, delay)
    ends_ns = start_ns + INTERVAL * np.arange(count + 1, dtype=np.int64)
    assert [packet.end_ns for packet in found] == ends_ns[1:].tolist()
    untracked = [np.empty(0, dtype=OBSERVATION_DTYPE)] * count
    cuts = packets(recording, start_ns, INTERVAL, count, untracked)
    for raw, cut in zip(found, cuts, strict=True):
        np.testing.assert_array_equal(raw.gyroscope, cut.gyroscope)
        np.testing.assert_array_equal(raw.accelerometer, cut.accelerometer)
    assert [packet.event_count for packet in found] == event_counts(recording, ends_ns)
    seen = np.concatenate([packet.events for packet in found])["t_ns"]
    begin = np.searchsorted(recording.events["t_ns"], start_ns - shift)
    np.testing.assert_array_equal(seen, recording.events["t_ns"][begin : begin + seen.size])
    turned = gyroscope_in_camera(recording)
    for packet in found:
        until_ns = packet.end_ns + delay - shift
        a, b = np.searchsorted(turned["t_ns"], [until_ns - INTERVAL - delay, until_ns], side="right")
        np.testing.assert_array_equal(packet.turning, turned[a:b])
        assert packet.events.size == 0 or packet.events["t_ns"][-1] <= until_ns


def feed(packetizer: Packetizer, at: float, **rows: RecordArray) -> list[RawPacket]:
    packetizer.feed(Chunk(at, **rows))
    found = []
    while (packet := packetizer.next()) is not None:
        found.append(packet)
    return found


@pytest.fixture
def packetizer() -> Packetizer:
    return Packetizer(calibration(0), (32, 32), INTERVAL, DELAY, PATIENCE)


def test_a_silent_camera_is_not_waited_for(packetizer: Packetizer) -> None:
    feed(packetizer, 0.0, events=events_at(np.array([0, 50])))
    steady = samples_at(np.arange(0, 3000, 10))
    found = feed(packetizer, 1.0, gyroscope=steady, accelerometer=steady)
    assert [packet.end_ns for packet in found] == list(range(100, 2000 - DELAY, 100))
    assert sum(packet.event_count for packet in found) == 1  # the event at the very start is of no packet


def test_a_declared_time_spares_the_wait(packetizer: Packetizer) -> None:
    feed(packetizer, 0.0, events=events_at(np.array([0, 50])))
    steady = samples_at(np.arange(0, 400, 10))
    assert feed(packetizer, 1.0, gyroscope=steady, accelerometer=steady) == []
    packetizer.feed(Chunk(2.0, complete_ns=300))
    packet = packetizer.next()
    assert packet is not None
    assert packet.end_ns == 100


def test_disorder_is_sorted_and_late_rows_are_counted(packetizer: Packetizer) -> None:
    shuffled = events_at(np.arange(0, 400))[np.random.default_rng(1).permutation(400)]
    steady = samples_at(np.arange(0, 400, 10))
    found = feed(packetizer, 0.0, events=shuffled, gyroscope=steady, accelerometer=steady[::-1].copy())
    found += feed(
        packetizer, 1.0, events=events_at(np.array([900])), gyroscope=samples_at(np.array([900, 901]))
    )
    found += feed(packetizer, 2.0, accelerometer=samples_at(np.array([900, 901])))
    assert found
    for packet in found:
        for rows in (packet.events, packet.gyroscope, packet.accelerometer):
            assert (np.diff(rows["t_ns"]) >= 0).all()
    taken = np.concatenate([packet.events["t_ns"] for packet in found])
    np.testing.assert_array_equal(taken, np.r_[np.arange(taken.size)])
    packetizer.feed(Chunk(3.0, events=events_at(np.array([5, 6]))))
    assert packetizer.late()[0] == 2


def test_repeated_samples_are_dropped(packetizer: Packetizer) -> None:
    steady = samples_at(np.arange(0, 400, 10))
    doubled = np.repeat(steady, 2)
    found = feed(
        packetizer, 0.0, events=events_at(np.arange(0, 400)), gyroscope=doubled, accelerometer=doubled
    )
    assert found[0].gyroscope["t_ns"].tolist() == list(range(0, 101, 10))
    assert packetizer.late()[1] == 2 * steady.size
