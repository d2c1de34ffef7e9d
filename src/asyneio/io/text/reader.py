# SPDX-License-Identifier: Apache-2.0
"""Event text, usually `t[s] x y p` per line, decoded exactly: decimal seconds are never converted to float.

A compiled loop parses lines in the usual notation; other lines are parsed in Python.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import BufferedIOBase
from pathlib import Path
from typing import IO, cast

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.column_meaning import UNIT_WORDS
from asyneio.io.parsing.csv_table import MAX_BAD_LINES, bad_lines_note
from asyneio.io.parsing.decimal_commas import reject_decimal_commas
from asyneio.io.parsing.decimal_seconds import parse_seconds
from asyneio.io.parsing.gzip_file import GzipFile
from asyneio.io.parsing.zip_member import DAMAGE, ZipMember
from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.io.recording.event_source import FAR_OUTSIDE, SAMPLE_DTYPE, share_text
from asyneio.io.text.description import described_text
from asyneio.io.text.kernels import COLUMN, POLARITY, ROW, TIME, parse_columns, parse_lines
from asyneio.io.text.layout import HEAD_BYTES, USUAL, split, text_meaning, without_bom
from asyneio.types import EVENT_DTYPE, RecordArray

#: Small enough for the allocator to reuse memory: new pages cost more than parsing.
CHUNK_BYTES = 2**20

#: The shortest line, `0 0 0 0` and a line feed.
_SHORTEST_LINE = 8
#: No event needs a longer line.
_LONGEST_LINE = 200
#: Lines of numbers in another layout that show that the file is not damaged, but another table.
_LEAST_ROWS = 10
#: Decimals from a time unit to a nanosecond.
_DECIMALS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
_POLARITY = {"-1": -1, "0": 0, "1": 1, "+1": 1, "true": 1, "false": 0, "on": 1, "off": 0}


class TextEvents:
    """An EventSource on a text file. Polarity is 0 and 1, -1 and 1, or true and false.

    Args:
        path: the file, or an archive.
        member: the file in the archive, or the content of a compressed file.
    """

    def __init__(self, path: Path, member: ZipMember | GzipFile | None = None) -> None:
        self.path = path
        self._file: Path | ZipMember | GzipFile = member or path
        self._meaning = USUAL
        self._roles = np.empty(0, dtype=np.int64)
        self._bad: list[int] = []
        self._line = 0
        self._packed_cut = False
        self._cut = False
        #: Whether polarities 0 and -1 occurred: a file must not contain both.
        self._met = np.zeros(2, dtype=np.bool_)

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, binary, or too many bad lines."""
        try:
            with self._open() as stream:
                size = max(self._size(), 1)
                rest, head = b"", without_bom(self._read(stream, HEAD_BYTES))
                self._understand(head)
                while block := head + self._read(stream, max(CHUNK_BYTES - len(head), 1)):
                    head = b""
                    text = rest + block
                    end = text.rfind(b"\n") + 1
                    rest = text[end:]
                    if len(rest) > CHUNK_BYTES:
                        raise RecordingError(f"{self._file} has a line of {len(rest)} bytes; not a text file")
                    yield self._parse(text, end), stream.tell() / size
                if rest:
                    yield self._parse_last(rest), 1.0
        except OSError as error:
            raise RecordingError(f"cannot read {self._file}: {error.strerror or error}") from error
        except DAMAGE as error:
            raise RecordingError(f"{self._file} is damaged: {error}; download the archive again") from error

    def samples(self) -> RecordArray:
        """Empty: inertial samples are in another file."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Notes on skipped lines."""
        notes: tuple[str, ...] = () if self._meaning.usual else (self._meaning.note(self._file.name),)
        if self._bad:
            note = bad_lines_note(self._file, self._bad)[0]
            notes += (f"{note} ({share_text(len(self._bad), self._line)} of the lines)",)
        if self._packed_cut or self._cut:
            place = "inside" if self._cut else "after"
            notes += (f"{self._file.name} ends {place} line {self._line}: truncated? read up to there",)
        return notes

    def _open(self) -> IO[bytes]:
        return self._file.open("rb") if isinstance(self._file, Path) else self._file.open()

    def _read(self, stream: IO[bytes], size: int) -> bytes:
        """The next bytes; of a truncated gzip file, all that can be unpacked."""
        if not isinstance(self._file, GzipFile):
            return stream.read(size)
        data = bytearray()
        try:
            while len(data) < size and (piece := cast(BufferedIOBase, stream).read1(size - len(data))):
                data += piece
        except EOFError:
            self._packed_cut = True
        self._file.check_ratio(stream.tell())
        return bytes(data)

    def _size(self) -> int:
        return self._file.stat().st_size if isinstance(self._file, Path) else self._file.size()

    def _understand(self, head: bytes) -> None:
        """Determine the meaning of the columns. Raises RecordingError: another table."""
        found = text_meaning(head)
        self._meaning = found or USUAL
        other = "" if found else described_text(self.path, head, _LEAST_ROWS)
        if other:
            raise RecordingError(f"{self._file} is {other}")
        self._roles = np.zeros(self._meaning.count, dtype=np.int64)
        self._roles[list(self._meaning.columns)] = TIME, COLUMN, ROW, POLARITY

    def _parse(self, text: bytes, end: int) -> RecordArray:
        """Events of the complete lines in `text` up to `end`."""
        data = np.frombuffer(text, dtype=np.uint8, count=end)
        events = np.zeros(data.size // _SHORTEST_LINE + 1, dtype=EVENT_DTYPE)
        t_ns, x, y, p = (events[name] for name in ("t_ns", "x", "y", "p"))
        position, count = 0, 0
        while position < data.size:
            columns = (t_ns[count:], x[count:], y[count:], p[count:], self._met)
            if self._meaning.usual:
                done = parse_lines(data, position, *columns)
            else:
                done = parse_columns(data, position, self._roles, self._meaning.unit_ns, *columns)
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
                f"{self._file} has the polarities -1, 0 and 1; expected 0 and 1, or -1 and 1"
            )
        return events[:count]

    def _parse_last(self, rest: bytes) -> RecordArray:
        """The event of a last line without a line feed, unless its last number may have lost digits."""
        events = self._parse(rest + b"\n", len(rest) + 1)
        times_and_places, last = self._meaning.columns[:3], self._meaning.count - 1
        if events.size and (self._packed_cut or last in times_and_places):
            self._cut = True
            return events[:0]
        self._cut = self._line in self._bad
        return events

    def _parse_unusual(self, line: bytes) -> tuple[int, int, int, int] | None:
        """Parse one line with signs, exponents, or `1.0` for 1; None if it is not an event."""
        text = line.split(b"#", 1)[0].decode("latin-1").strip()
        if not text and b"\0" not in line:
            return None
        event = self._parse_tokens(split(text)) if len(line) <= _LONGEST_LINE else None
        if event is None:
            reject_decimal_commas(self._file, self._line, text)
            if self._meaning.named and self._line == 1:
                return None
            self._bad.append(self._line)
            if len(self._bad) > MAX_BAD_LINES:
                raise RecordingError(
                    f"{self._file} has more than {MAX_BAD_LINES} unreadable lines, the last at {self._line}: "
                    f"{text[:60]!r}; expected {self._expected()}, polarity 0 and 1 or -1 and 1"
                )
        return event

    def _expected(self) -> str:
        order, unit = self._meaning.order, self._meaning.unit
        return order.replace("t", "t[s]") if self._meaning.usual else f"{order} with t in {UNIT_WORDS[unit]}"

    def _parse_tokens(self, tokens: list[str]) -> tuple[int, int, int, int] | None:
        if len(tokens) != self._meaning.count:
            return None
        time, across, down, polarity = (tokens[column] for column in self._meaning.columns)
        t_ns, x, y = parse_seconds(time, _DECIMALS[self._meaning.unit]), _integer(across), _integer(down)
        p = _POLARITY.get(polarity.lower(), _integer(polarity))
        if t_ns is None or abs(t_ns) >= MAX_STAMP_NS or x is None or y is None or p not in (-1, 0, 1):
            return None
        if p != 1:
            self._met[-p] = True
        return t_ns, _pixel(x), _pixel(y), max(p, 0)


def _integer(text: str) -> int | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return int(value) if value.is_integer() else None


def _pixel(value: int) -> int:
    return value if 0 <= value < FAR_OUTSIDE else FAR_OUTSIDE
