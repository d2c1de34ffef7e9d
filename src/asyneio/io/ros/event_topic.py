# SPDX-License-Identifier: Apache-2.0
"""EventSource for one topic of a bag."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.prophesee.evt3 import WRAP_NS
from asyneio.io.recording.event_source import SAMPLE_DTYPE, join_events
from asyneio.io.ros.bag import Bag, Message, Topic
from asyneio.io.ros.event_packets import PacketDecoder
from asyneio.io.ros.sensor_clock import SensorClock
from asyneio.io.ros.survey import EventTopic
from asyneio.types import RecordArray

#: Messages are joined to pieces of about this size, as every piece has a fixed cost.
_PIECE_EVENTS = 2**16


class RosEvents:
    """An EventSource for one topic.

    Args:
        bag: the messages.
        topic: the topic with the events.
        known: result of the survey for this topic.
        unit_ns: unit of event times.
        clock: from sensor time to host time.
    """

    def __init__(self, bag: Bag, topic: Topic, known: EventTopic, unit_ns: int, clock: SensorClock) -> None:
        self.path: Path = bag.path
        self._bag, self._topic, self._known = bag, topic, known
        self._unit_ns, self._clock = unit_ns, clock
        self._packets = PacketDecoder()
        #: Wraps of the EVT3 clock between survey and decoder [ns]; None: not determined yet.
        self._wraps_ns: int | None = None if "evt3" in known.encodings else 0
        self._decoded = self._broken = 0
        self._reason = ""

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, or no message can be decoded."""
        waiting: list[RecordArray] = []
        count = 0
        # The survey has already reported damage.
        for message, fraction in self._bag.messages([]):
            if message.topic != self._topic:
                continue
            try:
                waiting.append(self._decode(message))
            except ValueError as error:
                self._broken += 1
                self._reason = self._reason or str(error)
                continue
            self._decoded += 1
            count += waiting[-1].size
            if count >= _PIECE_EVENTS:
                yield self._joined(waiting), fraction
                waiting, count = [], 0
        if self._broken and not self._decoded:
            raise RecordingError(
                f"none of {self._broken} message(s) of {self._topic.name} can be decoded: {self._reason}"
            )
        waiting.append(self._packets.finish())
        yield self._joined(waiting), 1.0

    def samples(self) -> RecordArray:
        """Empty: inertial samples are read by the survey."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Notes on messages that could not be decoded, and on lost packets."""
        notes = self._packets.notes(self._topic.name)
        if self._broken:
            notes += (f"{self._topic.name}: skipped {self._broken} damaged message(s): {self._reason}",)
        return notes

    def _decode(self, message: Message) -> RecordArray:
        if self._known.decoder is not None:
            return self._known.decoder.decode(message.data).events
        return self._packets.decode(self._known.packet(message))

    def _joined(self, pieces: list[RecordArray]) -> RecordArray:
        """Pieces joined into one, with host times."""
        events = join_events(pieces)
        if not events.size:
            return events
        if self._wraps_ns is None:
            behind = self._clock.origin_ns - int(events["t_ns"][0])
            self._wraps_ns = round(behind / WRAP_NS) * WRAP_NS
        limit = 2**62 // self._unit_ns
        if self._unit_ns > 1:
            if events["t_ns"].max() > limit or events["t_ns"].min() < -limit:
                raise RecordingError(f"{self._topic.name}: a time stamp is out of range")
            events["t_ns"] *= self._unit_ns
        if self._wraps_ns or self._clock.offset_ns or self._clock.drift:
            events["t_ns"] = self._clock.to_host(events["t_ns"] + self._wraps_ns)
        return events
