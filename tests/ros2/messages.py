"""Serialized messages of a recording, and mutable messages as a node fills them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from asyneio.types import EventRecording, RecordArray
from tests.io.ros.bags import build, header, typestore

STORE = typestore(2)
PACKET, IMU = "event_camera_msgs/msg/EventPacket", "sensor_msgs/msg/Imu"


def serialized(kind: str, values: dict[str, Any]) -> bytes:
    """A message as `rclpy` hands it to a raw subscription."""
    return bytes(STORE.serialize_cdr(build(STORE, kind, values), kind))


def packet(events: RecordArray, size: tuple[int, int], seq: int, stamp_ns: int | None = None) -> bytes:
    """An EventPacket with the encoding `mono`."""
    base = int(events["t_ns"][0])
    words = (events["t_ns"] - base).astype(np.uint64)
    words |= events["x"].astype(np.uint64) << np.uint64(32)
    words |= events["y"].astype(np.uint64) << np.uint64(48)
    words |= events["p"].astype(np.uint64) << np.uint64(63)
    values = {
        "header": header(base if stamp_ns is None else stamp_ns),
        "width": size[0],
        "height": size[1],
        "seq": seq,
        "time_base": base,
        "encoding": "mono",
        "events": words.view(np.uint8),
    }
    return serialized(PACKET, values)


def imu(t_ns: int, rate: list[float], force: list[float]) -> bytes:
    """A sensor_msgs/Imu."""
    vectors = {"angular_velocity": rate, "linear_acceleration": force}
    fields = {name: dict(zip("xyz", xyz, strict=True)) for name, xyz in vectors.items()}
    return serialized(IMU, {"header": header(t_ns), **fields})


def live_messages(recording: EventRecording, length: int = 5000) -> list[tuple[str, bytes]]:
    """All of a recording, in the order in which messages arrive: packets after their last event."""
    size = recording.width, recording.height
    pieces = [recording.events[i : i + length] for i in range(0, recording.events.size, length)]
    found = [(int(piece["t_ns"][-1]), "events", packet(piece, size, seq)) for seq, piece in enumerate(pieces)]
    for rate, force in zip(recording.gyroscope, recording.accelerometer, strict=True):
        t_ns = int(rate["t_ns"])
        found.append((t_ns, "imu", imu(t_ns, rate["xyz"].tolist(), force["xyz"].tolist())))
    return [(topic, data) for _, topic, data in sorted(found, key=lambda item: item[0])]


def empty(kind: str) -> Any:
    """A mutable message of a type, as rclpy makes it: all fields zero."""
    return _mutable(build(STORE, kind, {}))


def _mutable(message: Any) -> Any:
    if not hasattr(message, "__msgtype__"):
        return message
    fields = {name: _mutable(value) for name, value in vars(message).items() if name != "__msgtype__"}
    return SimpleNamespace(**fields)


def frozen(kind: str, message: Any) -> Any:
    """A filled message after serialization and deserialization, which check all types."""
    data = STORE.serialize_cdr(build(STORE, kind, _plain(message)), kind)
    return STORE.deserialize_cdr(data, kind)


def _plain(value: Any) -> Any:
    if isinstance(value, SimpleNamespace):
        return {name: _plain(item) for name, item in vars(value).items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    # A level is one byte, which rosbags represents by its number.
    return value[0] if isinstance(value, bytes) else value
