"""The layout of a text file of events, from its first lines."""

from __future__ import annotations

import re

import numpy as np

from asyneio.io.parsing.column_meaning import Meaning, columns_by_name, columns_by_values, unit_of_time
from asyneio.io.parsing.decimal_seconds import parse_seconds

#: So many bytes of a file tell its layout.
HEAD_BYTES = 4096
_BOM = b"\xef\xbb\xbf"
_LINES = 200
_WORDS = {"true": 1.0, "false": 0.0}
#: The layout that files without names have.
USUAL = Meaning((0, 1, 2, 3), 4, "s", "as of events.txt")


def without_bom(data: bytes) -> bytes:
    """Bytes without the mark of UTF-8 that editors of Windows put at the start of a file."""
    return data.removeprefix(_BOM)


def text_meaning(head: bytes) -> Meaning | None:
    """What the columns of text mean, by its first bytes; None where they are no events.

    A line of names may stand before the numbers, as a comment or not. But for comments, no other line may.
    """
    names, rows = _first_rows(without_bom(head))
    if not rows:
        return None
    count = len(rows[0])
    numbers = _as_numbers([row for row in rows if len(row) == count])
    if numbers.shape[0] == 0:
        return None
    named = columns_by_name(names) if len(names) == count else None
    if named is not None:
        place, unit = named
        default, layout = "us", "cameras' exports"
    else:
        found = columns_by_values(numbers)
        if found is None:
            return USUAL if _is_usual(rows[0], numbers[0]) else None
        place, unit = found, ""
        usual = tuple(place[letter] for letter in "txyp") == (0, 1, 2, 3)
        default, layout = ("s", "events.txt") if usual else ("us", "cameras' exports")
    told_by = "by its name"
    if not unit:
        unit, told_by = unit_of_time(numbers[:, place["t"]], default, layout)
    columns = (place["t"], place["x"], place["y"], place["p"])
    return Meaning(columns, count, unit, told_by, named is not None)


def is_event_text(head: bytes) -> bool:
    """True when the start of a file is text of events in any order of columns."""
    return text_meaning(head) is not None


def split(line: str) -> list[str]:
    """The columns of a line of numbers."""
    return line.replace(",", " ").replace(";", " ").split()


def _first_rows(head: bytes) -> tuple[list[str], list[list[str]]]:
    """Names of the columns, where a line holds some, and the lines of numbers after it, in columns."""
    lines = head.decode("utf-8", errors="replace").split("\n")
    if len(head) >= HEAD_BYTES - 3 and len(lines) > 1:
        # The last one may be cut off.
        lines.pop()
    names: list[str] = []
    rows: list[list[str]] = []
    strange = 0
    for line in lines[:_LINES]:
        text, _, comment = line.partition("#")
        tokens = split(text)
        if not tokens:
            names = _names(comment) if comment.strip() and not rows else names
            continue
        if _numbers(tokens) is None:
            strange += 1
            if not rows and strange > 1:
                return [], []
            names = _names(text) if not rows else names
        elif len(tokens) > 2 or rows:
            rows.append(tokens)
    return names, rows


def _names(text: str) -> list[str]:
    text = text.strip("\r\n \t")
    for mark in (",", ";", "\t"):
        if mark in text:
            return text.split(mark)
    # A unit in brackets belongs to the name before it.
    return re.sub(r"\s+(?=\[)", "", re.sub(r"\[\s*(\w+)\s*\]", r"[\1]", text)).split()


def _numbers(tokens: list[str]) -> list[float] | None:
    try:
        return [float(_WORDS.get(token.lower(), token)) for token in tokens]
    except ValueError:
        return None


def _as_numbers(rows: list[list[str]]) -> np.ndarray:
    numbers = [row for row in map(_numbers, rows) if row is not None]
    return np.array(numbers, dtype=np.float64).reshape(len(numbers), -1)


def _is_usual(tokens: list[str], values: np.ndarray) -> bool:
    """Whether one line alone could be t x y p, where the others are damaged."""
    return len(tokens) == 4 and parse_seconds(tokens[0]) is not None and values[3] in (-1.0, 0.0, 1.0)
