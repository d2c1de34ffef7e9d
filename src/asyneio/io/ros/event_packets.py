# SPDX-License-Identifier: Apache-2.0
"""The encodings of event_camera_msgs/EventPacket (formerly event_array_msgs/EventArray).

| encoding | events | time [ns] |
|---|---|---|
| `evt3` | see `evt3` | sensor time, from the words only |
| `mono` | 64 bits: time bits 0-31, x 32-47, y 48-62, polarity 63 | `time_base` + bits |
| `libcaer` | polarity bit 1, y 2-16, x 17-31, time [us] 32-63, wraps at 2^31 | `time_base` + bits |
| `libcaer_cmp` | 16-bit words with the code in the four high bits, see below | `time_base` + bits [us] |
| `trigger` | no events | |

`libcaer_cmp`: 0, 1 high and low 12 bits of the time; 2 column; 3 event: row (bits 0-10), polarity (bit 11);
4 first row and polarity of the vectors after it; 5 vector of 8 rows. All numbers are little-endian
(github.com/ros-event-camera/event_camera_codecs).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.io.prophesee.evt3 import EVT_TIME_HIGH, EVT_TIME_LOW, WRAP_NS, Evt3Decoder
from asyneio.io.recording.event_source import FAR_OUTSIDE, pack_events
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

ENCODINGS = ("evt3", "mono", "libcaer", "libcaer_cmp")
TRIGGER = "trigger"

_LIBCAER_WRAP_US = 2**31
_US = 1000
_LIMIT_NS = 2**62
#: Number of words of evt3 decoded at once: a call costs as much as some thousand words.
_LEAST_WORDS = 2**15


@dataclass(frozen=True)
class Packet:
    """Content of a message: encoded bytes (N,) uint8, `time_base` [ns], `stamp_ns` of its header."""

    encoding: str
    data: np.ndarray
    time_base: int
    seq: int
    stamp_ns: int


class PacketDecoder:
    """Decodes the packets of one topic in order, with sensor times."""

    def __init__(self) -> None:
        self._evt3 = Evt3Decoder()
        self._held: list[np.ndarray] = []
        self._last: Packet | None = None
        self._lost = self._gaps = self._triggers = self._rest = self._unknown = 0

    def decode(self, packet: Packet) -> RecordArray:
        """Events of a packet, EVENT_DTYPE, and those that waited; evt3 words wait, as packets may be small.

        Raises:
            ValueError: unknown encoding.
        """
        lost_ns = self._count_lost(packet)
        base = min(packet.time_base, _LIMIT_NS)
        if packet.encoding == "evt3":
            return self._decode_evt3(self._complete_words(packet.data, np.dtype("<u2")), lost_ns)
        if packet.encoding == "mono":
            return _decode_mono(self._complete_words(packet.data, np.dtype("<u8")), base)
        if packet.encoding == "libcaer":
            return _decode_libcaer(self._complete_words(packet.data, np.dtype("<u8")), base)
        if packet.encoding == "libcaer_cmp":
            words = self._complete_words(packet.data, np.dtype("<u2"))
            events = np.zeros(int(_count_cmp(words)), dtype=EVENT_DTYPE)
            columns = (events[name] for name in ("t_ns", "x", "y", "p"))
            self._unknown += int(_decode_cmp(words, base, *columns))
            return events
        if packet.encoding == TRIGGER:
            self._triggers += 1
            return np.empty(0, dtype=EVENT_DTYPE)
        raise ValueError(f"unknown encoding {packet.encoding[:20]!r}")

    def flush(self) -> RecordArray:
        """Events of the words that wait, except those whose time the next words decide; for live use."""
        return self._feed(last=False) if self._held else np.empty(0, dtype=EVENT_DTYPE)

    def finish(self) -> RecordArray:
        """The remaining events."""
        if self._last is None or self._last.encoding != "evt3":
            return np.empty(0, dtype=EVENT_DTYPE)
        return self._feed(last=True)

    def notes(self, name: str) -> tuple[str, ...]:
        """Notes on lost packets and on data that are not events."""
        notes = self._evt3.notes(name)
        if self._lost:
            notes += (f"{name}: {self._lost} packet(s) were lost before recording, in {self._gaps} gap(s)",)
        counts = {
            "trigger packet(s)": self._triggers,
            "byte(s) at the ends of packets, less than a word": self._rest,
            "word(s) of unknown type: is the file damaged?": self._unknown,
        }
        return notes + tuple(f"{name}: skipped {count} {what}" for what, count in counts.items() if count)

    def _count_lost(self, packet: Packet) -> int | None:
        """Host time since the previous packet [ns] if packets were lost in between, else None."""
        before, self._last = self._last, packet
        if before is None or packet.seq <= before.seq + 1:
            return None
        self._gaps += 1
        self._lost += packet.seq - before.seq - 1
        return packet.stamp_ns - before.stamp_ns

    def _decode_evt3(self, words: np.ndarray, lost_ns: int | None) -> RecordArray:
        events = np.empty(0, dtype=EVENT_DTYPE)
        if lost_ns is not None or sum(map(len, self._held)) >= _LEAST_WORDS:
            events = self._feed(last=lost_ns is not None)
        if lost_ns is not None:
            self._evt3.pass_time(lost_ns)
        if words.size:
            self._held.append(words)
        return events

    def _feed(self, last: bool) -> RecordArray:
        words = np.concatenate([np.empty(0, np.uint16), *self._held])
        self._held = []
        return self._evt3.feed(words, last)

    def _complete_words(self, data: np.ndarray, dtype: np.dtype[np.generic]) -> np.ndarray:
        rest = data.size % dtype.itemsize
        self._rest += rest
        return data[: data.size - rest].view(dtype)


def first_time(packet: Packet) -> int | None:
    """Sensor time of the first event of a packet [ns], for evt3 modulo the wrap of its clock; None:
    unknown."""
    data, base = packet.data, min(packet.time_base, _LIMIT_NS)
    if packet.encoding == "evt3":
        time = int(_first_evt3(data[: data.size // 2 * 2].view("<u2")))
        return time * _US if time >= 0 else None
    if packet.encoding in ("mono", "libcaer") and data.size >= 8:
        low, high = (int(value) for value in data[:8].view("<u4"))
        return base + low if packet.encoding == "mono" else base + (high & (_LIBCAER_WRAP_US - 1)) * _US
    return base if packet.encoding == "libcaer_cmp" else None


def unwrap_first_times(sensor_ns: IntArray, host_ns: IntArray) -> IntArray:
    """Times (N,) of the EVT3 clock, unwrapped with the host clock."""
    if sensor_ns.size == 0:
        return sensor_ns
    steps = np.diff(sensor_ns)
    steps += np.rint((np.diff(host_ns) - steps) / WRAP_NS).astype(np.int64) * WRAP_NS
    return sensor_ns[0] + np.concatenate([[0], np.cumsum(steps)])


def _decode_mono(words: np.ndarray, base: int) -> RecordArray:
    t_ns = (words & 0xFFFFFFFF).astype(np.int64) + base
    return pack_events(t_ns, words >> 32 & 0xFFFF, words >> 48 & 0x7FFF, words >> 63)


def _decode_libcaer(words: np.ndarray, base: int) -> RecordArray:
    t_us = (words >> 32 & 0x7FFFFFFF).astype(np.int64)
    if t_us.size:
        # A wrap is a step back by most of the range; smaller steps are disorder.
        t_us[1:] += np.cumsum(np.diff(t_us) < -_LIBCAER_WRAP_US // 2) * _LIBCAER_WRAP_US
    return pack_events(t_us * _US + base, words >> 17 & 0x7FFF, words >> 2 & 0x7FFF, words >> 1 & 1)


@njit(cache=True)
def _first_evt3(words: np.ndarray) -> int:
    """The first complete time in words (N,) uint16 [us]; -1 if there is none."""
    high = -1
    for word in words:
        if word >> 12 == EVT_TIME_HIGH:
            high = int(word & 0xFFF)
        elif word >> 12 == EVT_TIME_LOW and high >= 0:
            return high << 12 | int(word & 0xFFF)
    return -1


@njit(cache=True)
def _count_cmp(words: np.ndarray) -> int:
    """Number of events in words (N,) uint16 of libcaer_cmp."""
    count = 0
    for word in words:
        code = word >> 12
        if code == 3:
            count += 1
        elif code == 5:
            bits = int(word & 0xFF)
            while bits:
                bits &= bits - 1
                count += 1
    return count


@njit(cache=True)
def _decode_cmp(
    words: np.ndarray, base: int, t_ns: IntArray, x: np.ndarray, y: np.ndarray, p: np.ndarray
) -> int:
    """Events of words (N,) uint16 of libcaer_cmp; returns the number of words of unknown type.

    Unsigned indices avoid numba's handling of negative ones.
    """
    one, events = np.uint64(1), np.uint64(0)
    high, low, column, row, polarity = 0, 0, FAR_OUTSIDE, FAR_OUTSIDE, 0
    time, unknown = base, 0
    for k in range(words.size):
        word = int(words[np.uint64(k)])
        code = word >> 12
        if code == 3:
            t_ns[events] = time
            x[events] = column
            y[events] = word & 0x7FF
            p[events] = word >> 11 & 1
            events += one
        elif code == 2:
            column = word & 0x7FF
        elif code == 1:
            low = word & 0xFFF
            time = base + (high << 12 | low) * _US
        elif code == 0:
            high = word & 0xFFF
            time = base + (high << 12 | low) * _US
        elif code == 4:
            row, polarity = word & 0x7FF, word >> 11 & 1
        elif code == 5:
            for bit in range(8):
                if word >> bit & 1:
                    t_ns[events] = time
                    x[events] = column
                    y[events] = min(row + bit, FAR_OUTSIDE)
                    p[events] = polarity
                    events += one
            row = min(row + 8, FAR_OUTSIDE)
        else:
            unknown += 1
    return unknown
