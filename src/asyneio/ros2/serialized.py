# SPDX-License-Identifier: Apache-2.0
"""Serialized ROS 2 messages (CDR), as `rclpy` hands them to raw subscriptions, to event and sample records.

Raw subscriptions are used because rclpy turns an array of events into Python objects, which takes about a
microsecond per field and event.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.recording.event_source import join_events
from asyneio.io.ros.bag import Message, Topic
from asyneio.io.ros.event_arrays import EventArrayDecoder, event_fields
from asyneio.io.ros.event_packets import PacketDecoder
from asyneio.io.ros.field_offsets import LayoutFinder
from asyneio.io.ros.known_definitions import DEFINITIONS, schema_of
from asyneio.io.ros.number_table import stamp_of
from asyneio.io.ros.schema import Schema, plain_name
from asyneio.io.ros.survey import IMU_NAMES, packet_of
from asyneio.types import INERTIAL_DTYPE, RecordArray

_PACKETS = ("event_camera_msgs/EventPacket", "event_array_msgs/EventArray")
#: Message types with events, as ROS 2 names them.
EVENT_TYPES = tuple(
    name.replace("/", "/msg/") for name in DEFINITIONS if name in _PACKETS or name.endswith("/EventArray")
)


@dataclass(frozen=True)
class ArrivedEvents:
    """Events of one message: EVENT_DTYPE in the clock of the sensor, the stamp of the message [ns] (0: none),
    width and height [px] (0: unknown)."""

    events: RecordArray
    stamp_ns: int
    width: int
    height: int


class EventMessages:
    """Decodes the event messages of one topic, in order.

    Args:
        type_name: ROS 2 name of the message type, one of EVENT_TYPES.

    Raises:
        RecordingError: another type.
    """

    def __init__(self, type_name: str) -> None:
        if type_name not in EVENT_TYPES:
            raise RecordingError(
                f"message type {type_name!r} contains no known events; expected one of "
                f"{', '.join(EVENT_TYPES)}"
            )
        self._topic = Topic("events", type_name, "", cdr=True)
        schema = _schema(self._topic)
        self._finder = LayoutFinder(schema, cdr=True)
        fields = event_fields(schema)
        self._arrays = EventArrayDecoder(schema, True, fields) if fields is not None else None
        self._packets = PacketDecoder()

    def decode(self, data: bytes | memoryview) -> ArrivedEvents:
        """Events of a serialized message, and those that waited for it.

        Raises:
            ValueError: the message is damaged, or its encoding is unknown.
        """
        if self._arrays is not None:
            found = self._arrays.decode(data)
            return ArrivedEvents(found.events, found.stamp_ns, found.width, found.height)
        layout = self._finder.find_layout(data)
        packet = packet_of(layout, Message(self._topic, 0, data))
        events = join_events([self._packets.decode(packet), self._packets.flush()])
        width, height = (layout.number(data, side) for side in ("width", "height"))
        return ArrivedEvents(events, packet.stamp_ns, width, height)

    def notes(self) -> tuple[str, ...]:
        """Notes on lost packets and on data that are not events."""
        return self._packets.notes("events")


class ImuMessages:
    """Decodes sensor_msgs/Imu."""

    def __init__(self) -> None:
        self._finder = LayoutFinder(_schema(Topic("imu", "sensor_msgs/msg/Imu", "", cdr=True)), cdr=True)

    def decode(self, data: bytes | memoryview) -> tuple[RecordArray, RecordArray]:
        """Gyroscope and accelerometer sample (1,) INERTIAL_DTYPE of a serialized message.

        Raises:
            ValueError: the message is damaged, has no stamp, or has values that are not finite.
        """
        layout = self._finder.find_layout(data)
        if any(name not in layout.fields for name in IMU_NAMES):
            raise ValueError("the message is too short")
        t_ns = stamp_of(layout, data)
        values = np.array([float(layout.values(data, name)[0]) for name in IMU_NAMES])
        if t_ns <= 0:
            raise ValueError("the message has no time stamp")
        if not np.isfinite(values).all():
            raise ValueError("the message has values that are not finite")
        samples = np.zeros((2, 1), dtype=INERTIAL_DTYPE)
        samples["t_ns"] = t_ns
        samples["xyz"][:, 0] = values.reshape(2, 3)
        return samples[0], samples[1]


def _schema(topic: Topic) -> Schema:
    schema = schema_of(topic)
    if schema is None:
        raise RecordingError(f"the definition of {plain_name(topic.type)} is unknown")
    return schema
