# SPDX-License-Identifier: Apache-2.0
"""Detection of the layout of event text from its first lines."""

from __future__ import annotations

import re

import numpy as np

from asyneio.io.parsing.column_meaning import (
    Meaning,
    are_pixels,
    columns_by_name,
    columns_by_values,
    unit_of_time,
)
from asyneio.io.parsing.decimal_seconds import parse_seconds

#: Number of bytes from which the layout is determined.
HEAD_BYTES = 4096
_BOM = b"\xef\xbb\xbf"
_LINES = 200
_WORDS = {"true": 1.0, "false": 0.0, "on": 1.0, "off": 0.0}
#: A number in quotes with thousands separators, as spreadsheets export it.
_THOUSANDS = re.compile(r'"(\d{1,3}(?:,\d{3})+)"')
#: The default layout of files without column names.
USUAL = Meaning((0, 1, 2, 3), 4, "s", "like events.txt")


def without_bom(data: bytes) -> bytes:
    """Bytes without the byte order mark that Windows editors write at the start of UTF-8 files."""
    return data.removeprefix(_BOM)


def text_meaning(head: bytes) -> Meaning | None:
    """The meaning of the columns from the first bytes of a text; None if it is not event text.

    One line of names may precede the numbers, as a comment or not; apart from it, only comments may.
    """
    names, rows, numbers = first_rows(without_bom(head))
    if numbers.shape[0] == 0:
        return None
    count = numbers.shape[1]
    named = columns_by_name(names) if len(names) == count else None
    if named is not None:
        position, unit = named
        default, layout = "us", "camera exports"
    else:
        # Without names, further columns follow those of the events.
        found = columns_by_values(numbers if names else numbers[:, :4])
        if found is None:
            return USUAL if _is_usual(rows[0], numbers[0]) else None
        position, unit = found, ""
        usual = tuple(position[letter] for letter in "txyp") == (0, 1, 2, 3)
        default, layout = ("s", "events.txt") if usual else ("us", "camera exports")
    unit_source = "by its name"
    if not unit:
        unit, unit_source = unit_of_time(numbers[:, position["t"]], default, layout)
    columns = (position["t"], position["x"], position["y"], position["p"])
    return Meaning(columns, count, unit, unit_source, named is not None)


def is_event_text(head: bytes) -> bool:
    """True if the start of a file is event text with columns in any order."""
    return text_meaning(head) is not None


def split(line: str) -> list[str]:
    """The columns of a line of numbers, without quotes around them and thousands separators in them."""
    if '"' in line:
        line = _THOUSANDS.sub(lambda number: number.group(1).replace(",", ""), line).replace('"', " ")
    return line.replace(",", " ").replace(";", " ").split()


def first_rows(head: bytes) -> tuple[list[str], list[list[str]], np.ndarray]:
    """Column names, if a line contains them, the following lines of numbers, and the numbers (N,columns) of
    those with as many columns as the first one; (0,0) without any."""
    names, rows = _lines_of(head)
    count = len(rows[0]) if rows else 0
    numbers = [row for row in map(_numbers, rows) if row is not None and len(row) == count]
    return names, rows, np.array(numbers, dtype=np.float64).reshape(len(numbers), count)


def _lines_of(head: bytes) -> tuple[list[str], list[list[str]]]:
    lines = head.decode("utf-8", errors="replace").split("\n")
    if len(head) >= HEAD_BYTES - 3 and len(lines) > 1:
        # The last line may be incomplete.
        lines.pop()
    names: list[str] = []
    rows: list[list[str]] = []
    unparsed = 0
    for line in lines[:_LINES]:
        text, _, comment = line.partition("#")
        tokens = split(text)
        if not tokens:
            names = _names(comment) if comment.strip() and not rows else names
            continue
        if _numbers(tokens) is None:
            unparsed += 1
            if not rows and unparsed > 1:
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


def _is_usual(tokens: list[str], values: np.ndarray) -> bool:
    """Whether a single line can be t x y p, if all others are damaged."""
    if len(tokens) != 4 or parse_seconds(tokens[0]) is None:
        return False
    return are_pixels(values[1:3]) and values[3] in (-1.0, 0.0, 1.0)
