# SPDX-License-Identifier: Apache-2.0
"""Lines of a text file with bounded length, and the header before its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from io import TextIOWrapper
from itertools import islice
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.parsing.text_dialect import holds_numbers, is_comment
from asyneio.io.parsing.zip_member import ZipMember

#: Number of lines that determine the number of columns and the rate.
FIRST = 1000
_LONGEST_LINE = 4000


def bounded_lines(stream: TextIOWrapper, path: Path | ZipMember, expected: str) -> Iterator[tuple[int, str]]:
    """Number and text of every line that is not empty. Raises RecordingError: a line is too long."""
    number = 0
    while line := stream.readline(_LONGEST_LINE + 1):
        number += 1
        if len(line) > _LONGEST_LINE:
            raise RecordingError(f"{path}: line {number} is too long; expected {expected}")
        text = line.strip(" \t\r\n\0")
        if text.strip(",;"):
            yield number, text


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
    shown = f"; a typical line is {seen[-1][:60]!r}" if seen[-1] else ""
    raise RecordingError(f"{path} contains no line of numbers{shown}; expected {expected}")
