# SPDX-License-Identifier: Apache-2.0
"""Lines of a text file with bounded length, the header before its numbers, and an end without a line feed."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator
from enum import Enum
from io import TextIOWrapper
from itertools import islice
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.parsing.text_dialect import holds_numbers, is_comment
from asyneio.io.parsing.zip_member import ZipMember

#: Number of lines that determine the number of columns and the rate.
FIRST = 1000
_LONGEST_LINE = 4000
#: Largest share of bytes of a text that are not UTF-8.
_MOST_DAMAGE = 0.05


#: Files that are no text, by their first bytes, and the command that makes text of them.
_NO_TEXT = {
    b"\x1f\x8b": "compressed with gzip: type `gunzip -k {0}`",
    b"\x28\xb5\x2f\xfd": "compressed with zstd: type `zstd -d {0}`",
    b"BZh": "compressed with bzip2: type `bunzip2 -k {0}`",
    b"\xfd7zXZ": "compressed with xz: type `unxz -k {0}`",
    b"PK\x03\x04": "a zip archive: type `unzip {0}`",
    b"\xff\xfe": "text in UTF-16: type `iconv -f UTF-16 -t UTF-8 {0} > {0}.txt`",
    b"\xfe\xff": "text in UTF-16: type `iconv -f UTF-16 -t UTF-8 {0} > {0}.txt`",
    b"#ROSBAG": "a ROS bag: write its topic to a table, `rostopic echo -b {0} -p TOPIC > {0}.csv`",
    b"\x89HDF": "HDF5: write its columns to a text file",
    b"SQLite ": "a SQLite file: write its topic to a table, `ros2 topic echo --csv TOPIC > FILE.csv`",
}


class BoundedLines:
    """Iterator over number and text of every line that is not empty.

    Attributes:
        open_line: number of the last line if no line feed ends it, else 0; valid at the end of the file.
    """

    def __init__(self, stream: TextIOWrapper, path: Path | ZipMember, expected: str) -> None:
        self._stream = stream
        self._path = path
        self._expected = expected
        self._number = 0
        self.open_line = 0

    def __iter__(self) -> Iterator[tuple[int, str]]:
        return self

    def __next__(self) -> tuple[int, str]:
        """The next line. Raises RecordingError: it is too long."""
        while line := self._stream.readline(_LONGEST_LINE + 1):
            self._number += 1
            if len(line) > _LONGEST_LINE:
                raise RecordingError(
                    f"{self._path}: line {self._number} is too long; expected {self._expected}"
                )
            if not line.endswith("\n"):
                self.open_line = self._number
            text = line.strip(" \t\r\n\0")
            if text.strip(",;"):
                return self._number, text
        raise StopIteration


class LastNumber(Enum):
    """Whether the number at the end of a file without a final line feed is complete."""

    COMPLETE = "complete"
    UNKNOWN = "unknown"
    CUT = "cut"


def judge_last_number(before: Iterable[str], last: str) -> LastNumber:
    """Compare the last number of a file with the texts of its column: a cut leaves fewer decimals.

    Decimals, with an exponent, are counted; in integers, all digits. As many as in the longest text:
    complete. Fewer than in the shortest: cut. In between, as where trailing zeros are not printed: unknown.
    """
    lengths = [_decimals(text) for text in before]
    found = _decimals(last)
    if not lengths or found >= max(lengths):
        return LastNumber.COMPLETE
    return LastNumber.CUT if found < min(lengths) else LastNumber.UNKNOWN


def open_end_note(name: str, line: int, state: LastNumber) -> str:
    """The note on a last line that is not used."""
    if state is LastNumber.CUT:
        return f"{name} ends inside line {line}: truncated? read up to there"
    return f"{name}: line {line} is not used: no line feed ends it, and its last number may lack digits"


def reject_no_text(path: Path | ZipMember, head: bytes, expected: str) -> None:
    """Reject a file that is no text, or compressed, by its first bytes. Raises RecordingError."""
    quoted = shlex.quote(str(path))
    for magic, what in _NO_TEXT.items():
        if head.startswith(magic):
            raise RecordingError(f"{path} is {what.format(quoted)}; expected {expected}")


def _decimals(text: str) -> int:
    whole, point, decimals = text.replace(",", ".").partition(".")
    return len(decimals) if point else len(whole.lstrip("+-"))


def head_of(
    path: Path | ZipMember, lines: Iterator[tuple[int, str]], expected: str
) -> tuple[str, list[tuple[int, str]]]:
    """The last line before the numbers, and the first lines of numbers. Raises RecordingError: no numbers."""
    header, seen = "", [""]
    for number, text in lines:
        if not is_comment(text) and holds_numbers(text):
            return header, [(number, text), *islice(lines, FIRST)]
        header = text
        if number < FIRST:
            seen.append(text)
    if any(text.startswith("---") for text in seen) and any("stamp:" in text for text in seen):
        raise RecordingError(
            f"{path} is the output of `rostopic echo TOPIC`; expected {expected}. Record a table: "
            "rostopic echo -p TOPIC > FILE.csv, or use the bag"
        )
    if sum(text.count("\ufffd") for text in seen) > _MOST_DAMAGE * sum(map(len, seen)):
        raise RecordingError(f"{path} is not text, or not in UTF-8; expected {expected}")
    shown = f"; a typical line is {seen[-1][:60]!r}" if seen[-1] else ""
    raise RecordingError(f"{path} contains no line of numbers{shown}; expected {expected}")
