"""Serialized messages of all types become the records of the recording."""

from __future__ import annotations

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg

from asyneio.errors import RecordingError
from asyneio.io.prophesee.evt3 import EVT_ADDR_X, EVT_ADDR_Y, EVT_TIME_HIGH, EVT_TIME_LOW
from asyneio.ros2.serialized import EVENT_TYPES, EventMessages, ImuMessages
from asyneio.types import EVENT_DTYPE, RecordArray
from tests.io.ros.bags import header, stamp
from tests.ros2.messages import PACKET, STORE, imu, packet, serialized

_EVENT = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
_ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\nEvent[] events\n"
for _package in ("prophesee_event_msgs", "dv_ros2_msgs"):
    STORE.register(get_types_from_msg(_EVENT, f"{_package}/msg/Event"))
    STORE.register(get_types_from_msg(_ARRAY, f"{_package}/msg/EventArray"))


def some_events(rng: np.random.Generator, count: int) -> RecordArray:
    events = np.zeros(count, dtype=EVENT_DTYPE)
    events["t_ns"] = 17 * 10**17 + np.sort(rng.integers(0, 10**7, count)) // 1000 * 1000
    events["x"], events["y"] = rng.integers(0, 240, count), rng.integers(0, 180, count)
    events["p"] = rng.integers(0, 2, count)
    return events


@pytest.mark.parametrize("package", ["dvs_msgs", "prophesee_event_msgs", "dv_ros2_msgs"])
@pytest.mark.parametrize("count", [1, 2, 57])
def test_event_arrays(rng: np.random.Generator, package: str, count: int) -> None:
    events = some_events(rng, count)
    items = [
        {"x": int(e["x"]), "y": int(e["y"]), "ts": stamp(int(e["t_ns"])), "polarity": bool(e["p"])}
        for e in events
    ]
    kind = f"{package}/msg/EventArray"
    values = {"header": header(18 * 10**17), "width": 240, "height": 180, "events": items}
    found = EventMessages(kind).decode(serialized(kind, values))
    np.testing.assert_array_equal(found.events, events)
    assert (found.stamp_ns, found.width, found.height) == (18 * 10**17, 240, 180)


def test_event_packets(rng: np.random.Generator) -> None:
    events = some_events(rng, 1000)
    found = EventMessages(PACKET).decode(packet(events, (240, 180), 0, stamp_ns=5))
    np.testing.assert_array_equal(found.events, events)
    assert (found.stamp_ns, found.width, found.height) == (5, 240, 180)


def _evt3(events: RecordArray) -> np.ndarray:
    """EVT3 words, each event with its whole time."""
    t_us = events["t_ns"].astype(np.int64) // 1000
    words = np.empty((events.size, 4), dtype="<u2")
    words[:, 0] = EVT_TIME_HIGH << 12 | t_us >> 12 & 0xFFF
    words[:, 1] = EVT_TIME_LOW << 12 | t_us & 0xFFF
    words[:, 2] = EVT_ADDR_Y << 12 | events["y"]
    words[:, 3] = EVT_ADDR_X << 12 | events["p"].astype(np.uint16) << 11 | events["x"]
    return words.ravel()


def test_evt3_packets_are_not_held_back(rng: np.random.Generator) -> None:
    """Small packets: a live stream cannot wait until thousands of words have arrived."""
    events = some_events(rng, 400)
    events["t_ns"] -= 17 * 10**17
    messages, found = EventMessages(PACKET), []
    for seq, piece in enumerate(np.split(events, 8)):
        values = {
            "header": header(10**18 + seq),
            "width": 240,
            "height": 180,
            "seq": seq,
            "encoding": "evt3",
            "events": _evt3(piece).view(np.uint8),
        }
        found.append(messages.decode(serialized(PACKET, values)).events)
    assert [part.size for part in found] == [50] * 8
    np.testing.assert_array_equal(np.concatenate(found), events)


def test_imu_samples() -> None:
    gyroscope, accelerometer = ImuMessages().decode(imu(10**18 + 3, [0.1, 0.2, 0.3], [1.0, 2.0, 9.8]))
    assert gyroscope["t_ns"].tolist() == accelerometer["t_ns"].tolist() == [10**18 + 3]
    assert gyroscope["xyz"].tolist() == [[0.1, 0.2, 0.3]]
    assert accelerometer["xyz"].tolist() == [[1.0, 2.0, 9.8]]


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (imu(0, [0.0] * 3, [0.0] * 3), "no time stamp"),
        (imu(1, [0.0, np.nan, 0.0], [0.0] * 3), "not finite"),
        (imu(1, [0.0] * 3, [0.0] * 3)[:100], "too short"),
    ],
)
def test_damaged_samples_are_rejected(data: bytes, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        ImuMessages().decode(data)


@pytest.mark.parametrize("kind", EVENT_TYPES)
@pytest.mark.parametrize("data", [b"", b"\x00\x01", b"\x00\x01\x00\x00" + b"\xff" * 64])
def test_damaged_events_are_rejected(kind: str, data: bytes) -> None:
    with pytest.raises(ValueError, match=r"too short|not plain CDR|more than fit"):
        EventMessages(kind).decode(data)


def test_other_types_are_rejected() -> None:
    with pytest.raises(RecordingError, match=r"expected one of .*dvs_msgs/msg/EventArray"):
        EventMessages("sensor_msgs/msg/Image")
