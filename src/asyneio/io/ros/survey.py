"""One pass over a bag that decodes no events: topics, counts, inertial samples, poses, intrinsics, clocks.

Topics are told apart by the fields of their messages, not by their names or the names of their types.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.ros.bag import Bag, Message, Topic
from asyneio.io.ros.event_arrays import EventArrayDecoder, EventFields, event_fields
from asyneio.io.ros.event_packets import Packet, first_time
from asyneio.io.ros.field_offsets import Located, Locator, locate
from asyneio.io.ros.known_definitions import schema_of
from asyneio.io.ros.number_table import STAMP, NumberTable, stamp_of
from asyneio.io.ros.schema import Schema

_XYZ, _XYZW = "xyz", "xyzw"
IMU_NAMES = tuple(
    f"{sensor}.{axis}" for sensor in ("angular_velocity", "linear_acceleration") for axis in _XYZ
)
_PACKET_PATHS = {"encoding", "events[]", "time_base", "seq"}
_PATH_PATHS = {f"poses[].{STAMP}.sec", "poses[].pose.position.x", "poses[].pose.orientation.w"}
#: Position and orientation of the kinds of messages that hold a pose.
_POSES = (
    ("pose.position", "pose.orientation"),
    ("transform.translation", "transform.rotation"),
    ("pose.pose.position", "pose.pose.orientation"),
)


@dataclass
class EventTopic:
    """What the survey knows of a topic of events; `decoder` where events stand one by one, else packets.

    `sensor_ns` and `host_ns` pair the sensor's time of a message's first event with the message's stamp,
    where the sensor has a clock of its own.
    """

    locator: Locator
    fields: EventFields | None
    decoder: EventArrayDecoder | None
    size: tuple[int, int] = (0, 0)
    encodings: dict[str, int] = field(default_factory=dict)
    sensor_ns: array[int] = field(default_factory=lambda: array("q"))
    host_ns: array[int] = field(default_factory=lambda: array("q"))
    big_endian: bool = False
    seen: bool = False

    def packet(self, message: Message) -> Packet:
        """The packet in a message. Raises ValueError: the message ends early."""
        return packet_of(self._located(message), message)

    def see(self, message: Message) -> None:
        """Take what is needed of a message before decoding. Raises ValueError: it ends early."""
        if self.decoder is not None:
            if self.fields is not None and self.fields.split and self.seen:
                return
            found = self.decoder.decode(message.data)
            self.seen, self.size = True, max(self.size, (found.width, found.height))
            if self.fields is not None and not self.fields.split and found.events.size:
                self.sensor_ns.append(int(found.events["t_ns"][0]))
                self.host_ns.append(found.stamp_ns or message.logged_ns)
            return
        located = self._located(message)
        packet = packet_of(located, message)
        self.encodings[packet.encoding] = self.encodings.get(packet.encoding, 0) + 1
        if not self.size[0]:
            sides = [located.number(message.data, name) for name in ("width", "height")]
            self.size = (sides[0], sides[1])
        if "is_bigendian" in located.places:
            self.big_endian |= bool(located.number(message.data, "is_bigendian"))
        time_ns = first_time(packet)
        if time_ns is not None:
            self.sensor_ns.append(time_ns)
            self.host_ns.append(packet.stamp_ns)

    def _located(self, message: Message) -> Located:
        return self.locator.locate(message.data)


@dataclass
class PathTopic:
    """Poses in a sequence, each message with all that went before: the longest, and its definition."""

    schema: Schema
    data: bytes = b""

    def add(self, message: Message) -> None:
        """Take a message."""
        if len(message.data) >= len(self.data):
            self.data = bytes(message.data)


@dataclass
class Survey:
    """What is in a bag: the count of messages of each topic, and what was read of those that matter.

    `broken` counts messages of lenses that end early; `cameras` are the first CameraInfo of each topic.
    """

    counts: dict[Topic, int] = field(default_factory=dict)
    events: dict[Topic, EventTopic] = field(default_factory=dict)
    imus: dict[Topic, NumberTable] = field(default_factory=dict)
    poses: dict[Topic, NumberTable] = field(default_factory=dict)
    cameras: dict[Topic, tuple[Located, bytes]] = field(default_factory=dict)
    paths: dict[Topic, PathTopic] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    broken: int = 0


def survey(bag: Bag) -> Survey:
    """Read a bag once. Raises RecordingError: as the bag says."""
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
            if isinstance(role, NumberTable | PathTopic):
                role.add(message)
            elif isinstance(role, EventTopic):
                role.see(message)
            elif isinstance(role, Schema) and topic not in found.cameras:
                data = bytes(message.data)
                found.cameras[topic] = locate(role, data, topic.cdr), data
        except ValueError:
            # Of messages with events it is said when they are decoded.
            found.broken += not isinstance(role, EventTopic)
    for topic in bag.topics():
        found.counts.setdefault(topic, 0)
    return found


#: What becomes of a topic's messages: rows of numbers, events, a intrinsics (its schema), or nothing.
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
        found.events[topic] = EventTopic(Locator(schema, topic.cdr), fields, decoder)
        return found.events[topic]
    if paths >= _PACKET_PATHS:
        found.events[topic] = EventTopic(Locator(schema, topic.cdr), None, None)
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


def packet_of(located: Located, message: Message) -> Packet:
    """The packet in a message. Raises ValueError: it has no events."""
    data = message.data
    if "events" not in located.places:
        raise ValueError("the message ends early")
    return Packet(
        encoding=located.text(data, "encoding"),
        data=np.ascontiguousarray(located.values(data, "events")),
        time_base=located.number(data, "time_base"),
        seq=located.number(data, "seq"),
        stamp_ns=stamp_of(located, data) or message.logged_ns,
    )
