"""Events as text, `t[s] x y p` a line, decoded exactly: decimal seconds never pass through a float.

A compiled loop takes the lines as they are usually printed; any other line is looked at in Python.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numba import njit

from asyneio.errors import RecordingError
from asyneio.io.csv_table import MAX_BAD_LINES, bad_lines_note
from asyneio.io.event_checks import MAX_STAMP_NS
from asyneio.io.event_source import FAR_OUTSIDE, SAMPLE_DTYPE
from asyneio.io.seconds_table import parse_seconds
from asyneio.io.zip_member import DAMAGE, ZipMember
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray

#: Small enough for the allocator to hand out the same memory again: fresh pages cost more than parsing.
CHUNK_BYTES = 2**20

#: The shortest line, `0 0 0 0` and a line feed.
_SHORTEST_LINE = 8
#: No number of an event needs more than this; a longer line is garbage.
_LONGEST_LINE = 200
_POLARITY = {"-1": -1, "0": 0, "1": 1, "+1": 1, "true": 1, "false": 0}

_BLANK, _TAB, _RETURN, _NEWLINE, _POINT, _MINUS, _ZERO = (ord(c) for c in " \t\r\n.-0")
#: Nanoseconds of the last digit, by the count of decimals.
_SCALE = 10 ** np.arange(9, -1, -1)
#: Larger seconds than this do not fit; they go the slow way and are refused there.
_MAX_SECONDS = MAX_STAMP_NS // NS_PER_S


class TextEvents:
    """An EventSource on a text file. Polarity is 0 and 1, -1 and 1, or true and false.

    Args:
        path: the file, or an archive.
        member: the file in the archive.
    """

    def __init__(self, path: Path, member: ZipMember | None = None) -> None:
        self.path = path
        self._file: Path | ZipMember = member or path
        self._bad: list[int] = []
        self._line = 0
        self._cut = False
        #: Whether polarity 0, and polarity -1, were met: both in one file are a third kind of value.
        self._met = np.zeros(2, dtype=np.bool_)

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, binary, or too many bad lines."""
        try:
            with self._open() as stream:
                size = max(self._size(), 1)
                rest = b""
                while block := stream.read(CHUNK_BYTES):
                    text = rest + block
                    end = text.rfind(b"\n") + 1
                    rest = text[end:]
                    if len(rest) > CHUNK_BYTES:
                        raise RecordingError(f"{self._file} has a line of {len(rest)} bytes; that is no text")
                    yield self._parse(text, end), stream.tell() / size
                self._cut = bool(rest)
                if rest:
                    yield self._parse(rest + b"\n", len(rest) + 1), 1.0
        except OSError as error:
            raise RecordingError(f"cannot read {self._file}: {error.strerror or error}") from error
        except DAMAGE as error:
            raise RecordingError(f"{self._file} is damaged: {error}; get the archive again") from error

    def samples(self) -> RecordArray:
        """None: inertial samples are in a file of their own."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Sentences on skipped lines."""
        notes = bad_lines_note(self._file, self._bad)
        if self._cut and self._line in self._bad:
            notes += (
                f"{self._file.name} ends in the middle of line {self._line}: cut off? read up to there",
            )
        return notes

    def _open(self) -> IO[bytes]:
        return self._file.open() if isinstance(self._file, ZipMember) else self._file.open("rb")

    def _size(self) -> int:
        return self._file.size() if isinstance(self._file, ZipMember) else self._file.stat().st_size

    def _parse(self, text: bytes, end: int) -> RecordArray:
        """Events of the whole lines, each with its line feed, that fill `text` up to `end`."""
        data = np.frombuffer(text, dtype=np.uint8, count=end)
        events = np.zeros(data.size // _SHORTEST_LINE + 1, dtype=EVENT_DTYPE)
        t_ns, x, y, p = (events[name] for name in ("t_ns", "x", "y", "p"))
        position, count = 0, 0
        while position < data.size:
            done = _parse_lines(data, position, t_ns[count:], x[count:], y[count:], p[count:], self._met)
            position, parsed = map(int, done)
            count += parsed
            self._line += parsed
            if position < data.size:
                stop = text.index(b"\n", position)
                self._line += 1
                event = self._parse_unusual(text[position : min(stop, position + _LONGEST_LINE + 1)])
                if event is not None:
                    events[count] = event
                    count += 1
                position = stop + 1
        if self._met.all():
            raise RecordingError(
                f"{self._file} has the polarities -1, 0 and 1; expected two kinds, 0 and 1 or -1 and 1"
            )
        return events[:count]

    def _parse_unusual(self, line: bytes) -> tuple[int, int, int, int] | None:
        """One line by Python's means: signs, exponents, `1.0` for 1; None where it holds no event."""
        text = line.split(b"#", 1)[0].decode("latin-1").replace(",", " ").strip()
        if not text and b"\0" not in line:
            return None
        event = self._parse_tokens(text.split()) if len(line) <= _LONGEST_LINE else None
        if event is None:
            self._bad.append(self._line)
            if len(self._bad) > MAX_BAD_LINES:
                raise RecordingError(
                    f"{self._file} has more than {MAX_BAD_LINES} unreadable lines, the last at {self._line}: "
                    f"{text[:60]!r}; expected t[s] x y p, polarity 0 and 1 or -1 and 1"
                )
        return event

    def _parse_tokens(self, tokens: list[str]) -> tuple[int, int, int, int] | None:
        if len(tokens) != 4:
            return None
        t_ns, x, y = parse_seconds(tokens[0]), _whole(tokens[1]), _whole(tokens[2])
        p = _POLARITY.get(tokens[3].lower(), _whole(tokens[3]))
        if t_ns is None or abs(t_ns) >= MAX_STAMP_NS or x is None or y is None or p not in (-1, 0, 1):
            return None
        if p != 1:
            self._met[-p] = True
        return t_ns, _pixel(x), _pixel(y), max(p, 0)


def is_event_text(head: bytes) -> bool:
    """True when the first line of numbers in the start of a file has four: seconds, two whole numbers and a
    polarity. But for comments, at most one line, of names, may stand before it: matrices are no events."""
    names = 0
    for line in head.decode("latin-1").split("\n")[:50]:
        tokens = line.split("#", 1)[0].replace(",", " ").split()
        try:
            values = [float(token) for token in tokens]
        except ValueError:
            names += 1
            if names > 1:
                return False
            continue
        if len(values) > 2:
            return len(values) == 4 and parse_seconds(tokens[0]) is not None and values[3] in (-1.0, 0.0, 1.0)
    return False


def _whole(text: str) -> int | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return int(value) if value.is_integer() else None


def _pixel(value: int) -> int:
    return value if 0 <= value < FAR_OUTSIDE else FAR_OUTSIDE


@njit(cache=True)
def _parse_lines(
    data: np.ndarray,
    start: int,
    t_ns: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    met: np.ndarray,
) -> tuple[np.uint64, np.uint64]:
    """Parse `data` (uint8, ends in a line feed) from `start` up to the first unusual line.

    Returns the position where it stopped (the start of a line, or the end) and the count of events.
    Usual: digits with up to nine decimals, whole x and y, polarity 0, 1 or -1, parted by one blank or tab.
    The line feed at the end stops every inner loop. Unsigned indices spare numba's test for negative ones,
    which halves the time.
    """
    one, size = np.uint64(1), np.uint64(data.size)
    count, line = np.uint64(0), np.uint64(start)
    while line < size:
        i, seconds = _digits(data, line)
        if i == line or i - line > np.uint64(10) or seconds >= _MAX_SECONDS:
            break
        time = seconds * NS_PER_S
        if data[i] == _POINT:
            point = i + one
            i, fraction = _digits(data, point)
            decimals = i - point
            if decimals > np.uint64(9):
                break
            time += fraction * _SCALE[decimals]
        if data[i] != _BLANK and data[i] != _TAB:
            break
        first = i + one
        i, column = _digits(data, first)
        if i == first or i - first > np.uint64(5) or (data[i] != _BLANK and data[i] != _TAB):
            break
        first = i + one
        i, row = _digits(data, first)
        if i == first or i - first > np.uint64(5) or (data[i] != _BLANK and data[i] != _TAB):
            break
        i += one
        negative = data[i] == _MINUS
        if negative:
            i += one
        polarity = data[i] - _ZERO
        if not (polarity == 1 or (polarity == 0 and not negative)):
            break
        i += one
        if data[i] == _RETURN:
            i += one
        if data[i] != _NEWLINE:
            break
        if negative:
            met[1] = True
            polarity = 0
        elif polarity == 0:
            met[0] = True
        t_ns[count] = time
        x[count] = min(column, FAR_OUTSIDE)
        y[count] = min(row, FAR_OUTSIDE)
        p[count] = polarity
        count += one
        line = i + one
    return line, count


@njit(cache=True)
def _digits(data: np.ndarray, i: np.uint64) -> tuple[np.uint64, np.int64]:
    """Position after the decimal digits at `i`, and their value (wrong, without harm, beyond 18 digits)."""
    value = np.int64(0)
    digit = np.uint8(data[i] - np.uint8(_ZERO))
    while digit <= 9:
        value = 10 * value + np.int64(digit)
        i += np.uint64(1)
        digit = np.uint8(data[i] - np.uint8(_ZERO))
    return i, value
