# SPDX-License-Identifier: Apache-2.0
"""What a text that is not event text contains, and how to change it, for error messages."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np

from asyneio.io.parsing.column_meaning import are_pixels, is_polarity
from asyneio.io.parsing.decimal_commas import decimal_commas
from asyneio.io.text.layout import first_rows, without_bom

#: Beginnings of text in UTF-16, as Windows PowerShell writes it.
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_SHOWN = 60


def described_text(path: Path, head: bytes, least: int = 1) -> str:
    """Columns, header and first line of a text that is not event text; empty if it is not a table.

    Args:
        path: of the file, for the command that converts it.
        head: its first bytes.
        least: lines of numbers that make a table.
    """
    quoted = shlex.quote(str(path))
    if head.startswith(_UTF_16):
        return f"text in UTF-16. Type: iconv -f UTF-16 -t UTF-8 {quoted} > {quoted}.txt"
    commas = decimal_commas(path, without_bom(head))
    if commas:
        return f"unreadable ({commas})"
    header, texts, numbers = first_rows(without_bom(head))
    if not texts or numbers.shape[0] < least:
        return ""
    shown = f"text of {numbers.shape[1]} columns"
    shown += f" named {', '.join(part.strip() for part in header)[:_SHOWN]}" if header else " without names"
    shown += f", the first line of numbers is {' '.join(texts[0])[:_SHOWN]!r}; expected t x y p; "
    return shown + _missing(header, numbers)


def _missing(header: list[str], numbers: np.ndarray) -> str:
    """The reason why the columns are not those of events, and what to do."""
    if numbers.shape[1] < 4:
        return "events have four columns; time, column, row, or the polarity is missing"
    pixels = [index for index, column in enumerate(numbers.T) if are_pixels(column)]
    if len(pixels) < 2:
        return "no two columns are integers, as column and row are: these are no events"
    if not any(is_polarity(column) for column in numbers.T):
        two = [index for index in pixels if np.unique(numbers[:, index]).size == 2]
        if not two:
            return "no column is a polarity, 0 and 1 or -1 and 1"
        low, high = np.unique(numbers[:, two[0]])
        return f"column {two[0] + 1} has the values {low:g} and {high:g}: a polarity is 0 and 1, or -1 and 1"
    again = "" if not header else ", with these names"
    return f"name the columns in the first line{again}, such as: t[us] x y p"
