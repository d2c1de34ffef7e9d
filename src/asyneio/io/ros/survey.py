# SPDX-License-Identifier: Apache-2.0
"""One pass over a bag without decoding events: topics, counts, inertial samples, poses, intrinsics, clocks.

Topics are classified by the fields of their messages, not by topic or type names.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.ros.bag import Bag, Message, Topic
from asyneio.io.ros.event_arrays import EventArrayDecoder, EventFields, event_fields
from asyneio.io.ros.event_packets import Packet, first_time
from asyneio.io.ros.field_offsets import LayoutFinder, MessageLayout, find_layout
from asyneio.io.ros.known_definitions import schema_of
from asyneio.io.ros.number_table import STAMP, NumberTable, stamp_of
from asyneio.io.ros.schema import Schema

_XYZ, _XYZW = "xyz", "xyzw"
IMU_NAMES = tuple(
    f"{sensor}.{axis}" for sensor in ("angular_velocity", "linear_acceleration") for axis in _XYZ
)
_PACKET_PATHS = {"encoding", "events[]", "time_base", "seq"}
_PATH_PATHS = {f"poses[].{STAMP}.sec", "poses[].pose.position.x", "poses[].pose.orientation.w"}
#: Position and orientation in the types of messages with a pose.
_POSES = (
    ("pose.position", "pose.orientation"),
    ("transform.translation", "transform.rotation"),
    ("pose.pose.position", "pose.pose.orientation"),
)


@dataclass
class EventTopic:
    """A topic of events; `decoder` is set for event arrays and None for packets.

    `sensor_ns` and `host_ns` are sensor time of the first event and stamp of each message, if the sensor has
    its own clock.
    """

    finder: LayoutFinder
    fields: EventFields | None
    decoder: EventArrayDecoder | None
    size: tuple[int, int] = (0, 0)
    encodings: dict[str, int] = field(default_factory=dict)
    sensor_ns: array[int] = field(default_factory=lambda: array("q"))
    host_ns: array[int] = field(default_factory=lambda: array("q"))
    big_endian: bool = False
    seen: bool = False

    def packet(self, message: Message) -> Packet:
        """The packet in a message. Raises ValueError: the message is too short."""
        return packet_of(self._layout(message), message)

    def add(self, message: Message) -> None:
        """Collect what is needed before decoding. Raises ValueError: the message is too short."""
        if self.decoder is not None:
            if self.fields is not None and self.fields.split and self.seen:
                return
            found = self.decoder.decode(message.data)
            self.seen, self.size = True, max(self.size, (found.width, found.height))
            if self.fields is not None and not self.fields.split and found.events.size:
                self.sensor_ns.append(int(found.events["t_ns"][0]))
                self.host_ns.append(found.stamp_ns or message.logged_ns)
            return
        layout = self._layout(message)
        packet = packet_of(layout, message)
        self.encodings[packet.encoding] = self.encodings.get(packet.encoding, 0) + 1
        if not self.size[0]:
            sides = [layout.number(message.data, name) for name in ("width", "height")]
            self.size = (sides[0], sides[1])
        if "is_bigendian" in layout.fields:
            self.big_endian |= bool(layout.number(message.data, "is_bigendian"))
        time_ns = first_time(packet)
        if time_ns is not None:
            self.sensor_ns.append(time_ns)
            self.host_ns.append(packet.stamp_ns)

    def _layout(self, message: Message) -> MessageLayout:
        return self.finder.find_layout(message.data)


@dataclass
class PathTopic:
    """A topic whose messages contain all previous poses: the longest message, and its definition."""

    schema: Schema
    data: bytes = b""

    def add(self, message: Message) -> None:
        """Add a message."""
        if len(message.data) >= len(self.data):
            self.data = bytes(message.data)


@dataclass
class Survey:
    """Content of a bag: number of messages of each topic, and data of the relevant topics.

    `broken` counts damaged CameraInfo messages; `cameras` are the first CameraInfo of each topic.
    """

    counts: dict[Topic, int] = field(default_factory=dict)
    events: dict[Topic, EventTopic] = field(default_factory=dict)
    imus: dict[Topic, NumberTable] = field(default_factory=dict)
    poses: dict[Topic, NumberTable] = field(default_factory=dict)
    cameras: dict[Topic, tuple[MessageLayout, bytes]] = field(default_factory=dict)
    paths: dict[Topic, PathTopic] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    broken: int = 0


def survey(bag: Bag) -> Survey:
    """Read a bag once. Raises RecordingError like the bag."""
    found = Survey()
    roles: dict[Topic, _Role] = {}
    for message, _ in bag.messages(found.notes):
        topic = message.topic
        if topic not in roles:
            roles[topic] = _role(found, topic)
            found.counts[topic] = 0
        found.counts[topic] += 1
        role = roles[topic]
        try:
            if isinstance(role, NumberTable | PathTopic | EventTopic):
                role.add(message)
            elif isinstance(role, Schema) and topic not in found.cameras:
                data = bytes(message.data)
                found.cameras[topic] = find_layout(role, data, topic.cdr), data
        except ValueError:
            # Damaged event messages are reported when they are decoded.
            found.broken += not isinstance(role, EventTopic)
    for topic in bag.topics():
        found.counts.setdefault(topic, 0)
    return found


#: Use of the messages of a topic: rows of numbers, poses, events, intrinsics (its schema), or none.
_Role = NumberTable | PathTopic | EventTopic | Schema | None


def _role(found: Survey, topic: Topic) -> _Role:
    try:
        schema = schema_of(topic)
    except RecordingError:
        return None
    if schema is None:
        return None
    paths = schema.paths()
    fields = event_fields(schema)
    if fields is not None:
        decoder = EventArrayDecoder(schema, topic.cdr, fields)
        found.events[topic] = EventTopic(LayoutFinder(schema, topic.cdr), fields, decoder)
        return found.events[topic]
    if paths >= _PACKET_PATHS:
        found.events[topic] = EventTopic(LayoutFinder(schema, topic.cdr), None, None)
        return found.events[topic]
    if paths >= _PATH_PATHS:
        found.paths[topic] = PathTopic(schema)
        return found.paths[topic]
    if f"{STAMP}.sec" not in paths:
        return None
    if paths.issuperset(IMU_NAMES):
        found.imus[topic] = NumberTable(schema, topic.cdr, IMU_NAMES)
        return found.imus[topic]
    for position, orientation in _POSES:
        names = tuple(f"{position}.{axis}" for axis in _XYZ) + tuple(f"{orientation}.{q}" for q in _XYZW)
        if paths.issuperset(names):
            found.poses[topic] = NumberTable(schema, topic.cdr, names)
            return found.poses[topic]
    is_camera = {"width", "height", "distortion_model"} <= paths and ("K[]" in paths or "k[]" in paths)
    return schema if is_camera else None


def packet_of(layout: MessageLayout, message: Message) -> Packet:
    """The packet in a message. Raises ValueError: the message is too short."""
    data = message.data
    if "events" not in layout.fields:
        raise ValueError("the message is too short")
    return Packet(
        encoding=layout.text(data, "encoding"),
        data=np.ascontiguousarray(layout.values(data, "events")),
        time_base=layout.number(data, "time_base"),
        seq=layout.number(data, "seq"),
        stamp_ns=stamp_of(layout, data) or message.logged_ns,
    )
