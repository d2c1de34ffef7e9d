"""Lines of a text file: none without an end, the header told from the numbers after it."""

from __future__ import annotations

from collections.abc import Iterator
from io import TextIOWrapper
from itertools import islice
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.parsing.text_dialect import holds_numbers, is_comment
from asyneio.io.parsing.zip_member import ZipMember

#: So many lines tell the usual count of columns and the rate.
FIRST = 1000
_LONGEST_LINE = 4000


def bounded_lines(stream: TextIOWrapper, path: Path | ZipMember, expected: str) -> Iterator[tuple[int, str]]:
    """Numbers and texts of the lines that are not empty. Raises RecordingError: one has no end."""
    number = 0
    while line := stream.readline(_LONGEST_LINE + 1):
        number += 1
        if len(line) > _LONGEST_LINE:
            raise RecordingError(f"{path}: line {number} is longer than any; expected {expected}")
        text = line.strip(" \t\r\n\0")
        if text.strip(",;"):
            yield number, text


def head_of(
    path: Path | ZipMember, lines: Iterator[tuple[int, str]], expected: str
) -> tuple[str, list[tuple[int, str]]]:
    """The last line before the numbers, and their first lines. Raises RecordingError: there are none."""
    header, seen = "", [""]
    for number, text in lines:
        if not is_comment(text) and holds_numbers(text):
            return header, [(number, text), *islice(lines, FIRST)]
        header = text
        if number < FIRST:
            seen.append(text)
    if any(text.startswith("---") for text in seen) and any("stamp:" in text for text in seen):
        raise RecordingError(
            f"{path} is what `rostopic echo TOPIC` prints; expected {expected}. Record it as a table: "
            "rostopic echo -p TOPIC > FILE.csv, or give the bag itself"
        )
    shown = f"; its lines are like {seen[-1][:60]!r}" if seen[-1] else ""
    raise RecordingError(f"{path} holds no line of numbers{shown}; expected {expected}")
