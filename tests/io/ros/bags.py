"""Bags for tests, their messages serialised by the rosbags package."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from asyneio.types import NS_PER_S, EventRecording, RecordArray

START_NS = 1_600_000_000 * NS_PER_S

PACKET_MSG = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    "bool is_bigendian\nuint8[] events\n"
)
EVENT_ARRAYS = {
    "dvs_msgs": ("uint16 x\nuint16 y\n{time} ts\nbool polarity\n", "Event[] events\n"),
    # The same with other names, another order and other types.
    "other_msgs": ("bool p\n{time} t\nuint32 y\nuint32 x\n", "Event[] array\nuint8 flag\n"),
    "old_msgs": ("uint16 x\nuint16 y\nuint64 ts\nbool polarity\n", "Event[] events\n"),
}


@dataclass(frozen=True)
class Record:
    """A message: when recorded [ns], topic, type's name, and the values of its fields."""

    logged_ns: int
    topic: str
    kind: str
    values: dict[str, Any]


def typestore(ros: int) -> Typestore:
    """The types of ROS 1 or 2 with those of events."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    time = "time" if ros == 1 else "builtin_interfaces/Time"
    for package, (event, tail) in EVENT_ARRAYS.items():
        store.register(get_types_from_msg(event.format(time=time), f"{package}/msg/Event"))
        array = f"std_msgs/Header header\nuint32 height\nuint32 width\n{tail}"
        store.register(get_types_from_msg(array, f"{package}/msg/EventArray"))
    store.register(get_types_from_msg(PACKET_MSG, "event_camera_msgs/msg/EventPacket"))
    return store


def write_bag(
    path: Path,
    ros: int,
    records: Iterable[Record],
    packing: str = "",
    storage: str = "mcap",
    order: str = "<",
) -> Path:
    """Write a bag of ROS 1 (packing: lz4, bz2) or 2 (storage: mcap, sqlite3; packing: message, storage)."""
    store = typestore(ros)
    big_endian = order == ">"
    connections: dict[str, Any] = {}
    if ros == 1:
        writer: Any = Writer1(path)
        if packing:
            writer.set_compression(Writer1.CompressionFormat[packing.upper()])
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
        if packing:
            writer.set_compression(CompressionMode[packing.upper()], CompressionFormat.ZSTD)
    with writer:
        for record in records:
            if record.topic not in connections:
                connections[record.topic] = writer.add_connection(record.topic, record.kind, typestore=store)
            message = build(store, record.kind, record.values)
            data = (
                store.serialize_ros1(message, record.kind)
                if ros == 1
                else store.serialize_cdr(message, record.kind, little_endian=not big_endian)
            )
            writer.write(connections[record.topic], record.logged_ns, data)
    return path


def build(store: Typestore, kind: str, values: Any) -> Any:
    """A message of a type from the values of its fields; fields without a value are zero."""
    fields = {}
    for name, (tag, rest) in store.get_msgdef(kind).fields:
        given = values.get(name)
        if tag.name == "NAME":
            fields[name] = build(store, rest, given or {})
        elif tag.name == "BASE":
            fields[name] = ("" if rest[0] == "string" else 0) if given is None else given
        else:
            item_tag, item = rest[0]
            count = rest[1] if tag.name == "ARRAY" else 0
            if item_tag.name == "NAME":
                fields[name] = [build(store, item, value) for value in given or []]
            else:
                fields[name] = np.array([0] * count if given is None else given, dtype=_numpy(item[0]))
    return store.types[kind](**fields)


def _numpy(name: str) -> str:
    return {"octet": "uint8", "byte": "uint8", "char": "uint8"}.get(name, name)


def header(t_ns: int) -> dict[str, Any]:
    """A header with a stamp."""
    return {"stamp": stamp(t_ns), "frame_id": "dvs"}


def stamp(t_ns: int) -> dict[str, int]:
    """A time of ROS."""
    return dict(zip(("sec", "nanosec"), divmod(t_ns, NS_PER_S), strict=True))


def event_record(
    package: str, events: RecordArray, size: tuple[int, int], topic: str = "/dvs/events"
) -> Record:
    """A message that holds events one by one."""
    last_ns = int(events["t_ns"][-1])
    names = {"dvs_msgs": ("ts", "polarity"), "other_msgs": ("t", "p"), "old_msgs": ("ts", "polarity")}[
        package
    ]
    items = [
        {
            "x": int(event["x"]),
            "y": int(event["y"]),
            names[0]: int(event["t_ns"]) // 1000 if package == "old_msgs" else stamp(int(event["t_ns"])),
            names[1]: bool(event["p"]),
        }
        for event in events
    ]
    values = {"header": header(last_ns), "width": size[0], "height": size[1]}
    values["array" if package == "other_msgs" else "events"] = items
    return Record(last_ns, topic, f"{package}/msg/EventArray", values)


def recording_records(
    recording: EventRecording, package: str = "dvs_msgs", length: int = 500
) -> list[Record]:
    """All of a recording as messages, by time of recording."""
    size = recording.width, recording.height
    pieces = [recording.events[i : i + length] for i in range(0, recording.events.size, length)]
    records = [event_record(package, piece, size) for piece in pieces]
    for rate, force in zip(recording.gyroscope, recording.accelerometer, strict=True):
        t_ns = int(rate["t_ns"])
        values = {
            "header": header(t_ns),
            "angular_velocity": dict(zip("xyz", rate["xyz"].tolist(), strict=True)),
            "linear_acceleration": dict(zip("xyz", force["xyz"].tolist(), strict=True)),
        }
        records.append(Record(t_ns, "/dvs/imu", "sensor_msgs/msg/Imu", values))
    truth = recording.ground_truth
    if truth is not None:
        for t_ns, p, q in zip(
            truth.t_ns.tolist(), truth.position.tolist(), truth.quaternion.tolist(), strict=True
        ):
            pose = {
                "position": dict(zip("xyz", p, strict=True)),
                "orientation": dict(zip("xyzw", q, strict=True)),
            }
            values = {"header": header(t_ns), "pose": pose}
            records.append(Record(t_ns, "/optitrack/davis", "geometry_msgs/msg/PoseStamped", values))
    return sorted(records, key=lambda record: record.logged_ns)


def camera_record(t_ns: int, ros: int, k: list[float], d: list[float], model: str = "plumb_bob") -> Record:
    """A CameraInfo of a 240 x 180 sensor."""
    values = {"header": header(t_ns), "width": 240, "height": 180, "distortion_model": model}
    values |= {"K" if ros == 1 else "k": k, "D" if ros == 1 else "d": d}
    return Record(t_ns, "/dvs/camera_info", "sensor_msgs/msg/CameraInfo", values)
