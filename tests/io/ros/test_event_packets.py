"""Packets of events: real ones and noise against plain decoders, lost ones, and the camera's own clock."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import evt3
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from asyneio.io.prophesee.evt3 import HIGH_NS
from asyneio.io.recording.event_source import FAR_OUTSIDE
from asyneio.io.ros.bag import Bag
from asyneio.io.ros.event_packets import Packet, PacketDecoder
from asyneio.io.ros.rosbag1 import Rosbag1
from asyneio.io.ros.rosbag2 import open_rosbag2
from asyneio.io.ros.sensor_clock import fit_clock
from asyneio.types import NS_PER_S, RecordArray
from tests.io.prophesee.test_evt3 import at
from tests.io.ros.bags import START_NS, Record, header, write_bag

Rows = list[tuple[int, int, int, int]]


def plain_cmp(data: bytes, base: int) -> Rows:
    """libcaer_cmp, word by word."""
    rows: Rows = []
    high = low = 0
    x = y = FAR_OUTSIDE
    p = 0
    for (word,) in struct.iter_unpack("<H", data[: len(data) // 2 * 2]):
        code, rest = word >> 12, word & 0xFFF
        t = base + 1000 * (4096 * high + low)
        if code == 0:
            high = rest
        elif code == 1:
            low = rest
        elif code == 2:
            x = rest % 2048
        elif code == 3:
            rows.append((t, x, rest % 2048, rest // 2048))
        elif code == 4:
            y, p = rest % 2048, rest // 2048
        elif code == 5:
            rows += [(t, x, min(y + k, FAR_OUTSIDE), p) for k in range(8) if rest & 1 << k]
            y += 8
    return rows


def plain_libcaer(data: bytes, base: int) -> Rows:
    """libcaer, event by event."""
    rows: Rows = []
    turns, before = 0, None
    for word, low in struct.iter_unpack("<II", data[: len(data) // 8 * 8]):
        low %= 2**31
        if before is not None and low - before < -(2**30):
            turns += 1
        before = low
        t = base + 1000 * (low + turns * 2**31)
        rows.append((t, word >> 17 & 0x7FFF, word >> 2 & 0x7FFF, word >> 1 & 1))
    return rows


def plain_mono(data: bytes, base: int) -> Rows:
    """mono, event by event."""
    rows: Rows = []
    for dt, x, upper in struct.iter_unpack("<IHH", data[: len(data) // 8 * 8]):
        rows.append((base + dt, x, upper % 2**15, upper // 2**15))
    return rows


PLAIN = {"libcaer_cmp": plain_cmp, "libcaer": plain_libcaer, "mono": plain_mono}


def packet(encoding: str, data: bytes, base: int = 0, seq: int = 0, stamp_ns: int = 0) -> Packet:
    return Packet(encoding, np.frombuffer(data, np.uint8), base, seq, stamp_ns)


def rows_of(events: RecordArray) -> Rows:
    return [tuple(map(int, event)) for event in events[["t_ns", "x", "y", "p"]].tolist()]  # type: ignore[misc]


@pytest.mark.parametrize("encoding", sorted(PLAIN))
@given(data=st.binary(max_size=200), base=st.integers(0, 2**61))
def test_any_bytes(encoding: str, data: bytes, base: int) -> None:
    decoder = PacketDecoder()
    assert rows_of(decoder.decode(packet(encoding, data, base))) == PLAIN[encoding](data, base)
    width = 2 if encoding == "libcaer_cmp" else 8
    assert (f"{len(data) % width} byte(s)" in " ".join(decoder.notes("run"))) == bool(len(data) % width)


def messages(bag: Bag) -> list[Any]:
    """The packets of a bag by struct alone: header, sizes, seq, base, encoding, flag, data."""
    found = []
    for message, _ in bag.messages([]):
        data = bytes(message.data)
        start = data.index(b"evt3") if b"evt3" in data[:100] else data.index(b"libcaer_cmp")
        name = data[start:].split(b"\0")[0][:11] if b"libcaer" in data[:100] else b"evt3"
        (base,) = struct.unpack_from("<Q", data, start - 12)
        at = start + len(name) + (2 if message.topic.cdr else 1)
        at += -(at - 4) % 4 if message.topic.cdr else 0
        (count,) = struct.unpack_from("<I", data, at)
        assert len(data) == at + 4 + count
        found.append((base, data[at + 4 :]))
    return found


def test_real_evt3(data_dir: Path) -> None:
    path = data_dir / "formats" / "event_packet_evt3.bag"
    found = open_recording(path)
    words = b"".join(data for _, data in messages(Rosbag1(path)))
    wanted = evt3.decode_bytes(words, 640, 480)
    assert found.events.size == len(wanted) == 343_474
    t_ns = wanted.t.astype(np.int64) * 1000
    # The camera's time came to that of the host; differences stay.
    np.testing.assert_array_equal(np.diff(found.events["t_ns"]), np.diff(t_ns))
    for name, column in (("x", wanted.x), ("y", wanted.y), ("p", wanted.p)):
        np.testing.assert_array_equal(found.events[name], column)
    assert (found.width, found.height) == (640, 480)
    # Messages came every 4 ms; the last event is not stamped after the last message.
    assert 0 < 1_675_956_552_394_717_609 - found.events["t_ns"][-1] < 10_000_000
    notes = " ".join(found.notes)
    assert "the camera clock was shifted by 1675956543.17" in notes
    assert "4157 external trigger(s)" in notes


@pytest.mark.slow
def test_real_libcaer_cmp(data_dir: Path) -> None:
    path = data_dir / "formats" / "event_packet_libcaer_cmp_ros2"
    found = open_recording(path)
    wanted = [row for base, data in messages(open_rosbag2(path)) for row in plain_cmp(data, base)]
    assert len(wanted) == found.events.size == 571_266
    assert rows_of(found.events) == sorted(wanted, key=lambda row: row[0])
    assert (found.width, found.height) == (346, 260)
    # This driver's time is that of the host already.
    assert not any("own clock" in note for note in found.notes)


def packet_record(k: int, t_ns: int, data: bytes, encoding: str = "evt3", **values: Any) -> Record:
    content = {"header": header(t_ns), "width": 240, "height": 180, "seq": k, "encoding": encoding}
    content |= {"events": list(data)} | values
    return Record(t_ns, "/event_camera/events", "event_camera_msgs/msg/EventPacket", content)


def words(high: int, low: int = 0) -> bytes:
    return np.array(at(high, low, 5), dtype="<u2").tobytes()


def test_lost_packets(tmp_path: Path) -> None:
    """50 s are lost, almost three turns of the clock; the stamps of the messages tell."""
    step = HIGH_NS
    times = [*range(10), *(12_207 + k for k in range(10))]
    records = [
        packet_record(k + 5 * (k > 9), START_NS + t * step + 1_000_000, words(t)) for k, t in enumerate(times)
    ]
    found = open_recording(write_bag(tmp_path / "run", 2, records))
    np.testing.assert_array_equal(found.events["t_ns"] - found.events["t_ns"][0], np.array(times) * step)
    assert any("5 packet(s) were lost before recording, in 1 gap(s)" in note for note in found.notes)
    assert abs(int(found.events["t_ns"][0]) - START_NS - 1_000_000) < 1000


@pytest.mark.parametrize(
    ("records", "words"),
    [
        ([packet_record(0, START_NS, b"", "evt9")], "with the encoding 'evt9'; expected one of evt3"),
        ([packet_record(0, START_NS, b"", "trigger")], "expected one of"),
        (
            [packet_record(0, START_NS, bytes(8), "mono"), packet_record(1, START_NS, b"", "evt3")],
            "with the encoding 'mono', 'evt3'",
        ),
        ([packet_record(0, START_NS, bytes(8), "mono", is_bigendian=True)], "big-endian machine"),
    ],
)
def test_refused(tmp_path: Path, records: list[Record], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        open_recording(write_bag(tmp_path / "run", 1, records))


def test_driver_started_anew(tmp_path: Path) -> None:
    """In the middle the camera's clock begins at 0 again."""
    records = [
        packet_record(k, START_NS + k * NS_PER_S // 10, bytes(8), "mono", time_base=k % 50 * NS_PER_S // 10)
        for k in range(100)
    ]
    with pytest.raises(RecordingError, match="jump relative to each other by"):
        open_recording(write_bag(tmp_path / "run", 1, records))


@pytest.mark.parametrize("drift", [0.0, 40e-6, -80e-6])
def test_clock_from_late_stamps(rng: np.random.Generator, drift: float) -> None:
    """Ten minutes of stamps that come 1 ms late at least, mostly a little more, now and then much more."""
    sensor = np.arange(0, 600 * NS_PER_S, 5_000_000)
    late = (
        1e6
        + rng.exponential(3e5, sensor.size)
        + (rng.random(sensor.size) < 0.02) * rng.exponential(5e7, sensor.size)
    )
    host = START_NS + sensor + np.rint(drift * sensor + late).astype(np.int64)
    clock = fit_clock(sensor, host, "events")
    error = clock.to_host(sensor) - (START_NS + sensor + np.rint(drift * sensor).astype(np.int64))
    assert np.abs(error - 1e6).max() < 1e5
    assert clock.drift == pytest.approx(drift, abs=2e-7)


def test_short_recordings_have_no_drift(rng: np.random.Generator) -> None:
    sensor = np.arange(0, 5 * NS_PER_S, 5_000_000)
    host = START_NS + sensor + np.rint(rng.exponential(2e6, sensor.size)).astype(np.int64)
    clock = fit_clock(sensor, host, "events")
    assert clock.drift == 0.0
    assert abs(clock.offset_ns - START_NS) < 500_000
