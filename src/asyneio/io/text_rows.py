"""Lines of numbers with or without a header, time in whatever unit: what strangers' text files share."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from itertools import chain, islice, pairwise
from pathlib import Path
from typing import IO

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.csv_table import MAX_BAD_LINES
from asyneio.io.seconds_table import parse_seconds
from asyneio.io.table_hints import refuse_decimal_commas
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Decimals between a unit of time and a nanosecond.
_DECIMALS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
_SPELLINGS = {"sec": "s", "seconds": "s", "nsec": "ns", "usec": "us", "µs": "us", "msec": "ms"}
_TIME = re.compile(r"^(t|time|timestamps?|stamp)(_?(s|sec|ms|us|ns)|\((s|sec|ms|us|ns)\))?$")
_LONGEST_LINE = 1000
_MAX_BYTES = 2**30
#: So many lines tell the usual count of columns and the rate.
_FIRST = 1000


@dataclass(frozen=True)
class TextRows:
    """What a file holds.

    Attributes:
        path: the file.
        names: of the columns, lower case without units; empty where there is no header.
        time: position of the column of time.
        unit: of time as the header says; "" where it does not.
        times: what stands in that column, N texts.
        values: all columns, (N, columns).
        bad: numbers of the lines left out.
    """

    path: Path
    names: tuple[str, ...]
    time: int
    unit: str
    times: list[str]
    values: FloatArray
    bad: list[int]

    def stamps(self, rates_hz: tuple[float, float]) -> tuple[IntArray, str]:
        """Time [ns], exactly as printed, and its unit: the header's, or the only one with such a rate.

        Units lie a factor 1000 apart: where the bounds are closer, no step fits two of them.

        Raises:
            RecordingError: no unit gives such a rate, or a stamp does not fit.
        """
        unit = self.unit or self._unit_by_rate(rates_hz)
        stamps = [parse_seconds(text, _DECIMALS[unit]) for text in self.times]
        if None in stamps:
            text = self.times[stamps.index(None)]
            raise RecordingError(f"{self.path}: {text[:40]} {unit} is no time that fits into 64 bits of ns")
        return np.array(stamps, dtype=np.int64), unit

    def _unit_by_rate(self, rates_hz: tuple[float, float]) -> str:
        exact = [Decimal(text) for text in self.times[: _FIRST + 1]]
        step = float(np.median([float(after - before) for before, after in pairwise(exact)]))
        for unit, decimals in _DECIMALS.items():
            if step > 0.0 and rates_hz[0] <= NS_PER_S / (step * 10.0**decimals) <= rates_hz[1]:
                return unit
        raise RecordingError(
            f"{self.path}: time advances by {step:g} a line, which is {rates_hz[0]:g} to {rates_hz[1]:g} "
            "lines a second in no unit; name the unit in a header line, as t_ns or t[us]"
        )


def read_text_rows(path: Path, least: int, expected: str) -> TextRows:
    """Read a file of numbers parted by blanks, commas or semicolons; `#` and `%` start a comment.

    A header is the last comment before the numbers, or a first line that is none. Numbers that are not finite
    are kept.

    Raises:
        RecordingError: unreadable, fewer than two lines or `least` columns, or too many other lines.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise RecordingError(f"{path} has {path.stat().st_size} bytes; expected {expected}")
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            rows = _collect(path, _bounded(stream, path, expected), expected)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    if rows.values.shape[1] < least or len(rows.times) < 2:
        raise RecordingError(
            f"{path} holds {len(rows.times)} line(s) of {rows.values.shape[1]} numbers; expected {expected}"
        )
    return rows


def _collect(path: Path, lines: Iterator[tuple[int, str]], expected: str) -> TextRows:
    header, start = "", []
    for number, text in lines:
        refuse_decimal_commas(path, number, text)
        if not _is_comment(text) and _is_number(_split(text)[0]):
            start = [(number, text), *islice(lines, _FIRST)]
            break
        header = text
    if not start:
        raise RecordingError(f"{path} holds no line of numbers; expected {expected}")
    counts = [len(_split(text)) for _, text in start if not _is_comment(text)]
    count = max(set(counts), key=counts.count)
    names, time, unit = _header(header, count)
    times: list[str] = []
    values = array("d")
    bad: list[int] = []
    for number, text in chain(start, lines):
        if _is_comment(text):
            continue
        tokens = _split(text.split("#", 1)[0])
        row = _numbers(tokens) if len(tokens) == count else None
        if row is not None and math.isfinite(row[time]):
            times.append(tokens[time])
            values.extend(row)
            continue
        bad.append(number)
        if len(bad) > MAX_BAD_LINES:
            raise RecordingError(
                f"{path} has more than {MAX_BAD_LINES} unreadable lines, the last at {number}: "
                f"{text[:60]!r}; expected {expected}"
            )
    table = np.array(values, dtype=np.float64).reshape(-1, count)
    return TextRows(path, names, time, unit, times, table, bad)


def _bounded(stream: IO[str], path: Path, expected: str) -> Iterator[tuple[int, str]]:
    """Numbers and texts of the lines that are not empty. Raises RecordingError: one has no end."""
    number = 0
    while line := stream.readline(_LONGEST_LINE + 1):
        number += 1
        if len(line) > _LONGEST_LINE:
            raise RecordingError(f"{path}: line {number} is longer than any; expected {expected}")
        text = line.strip(" \t\r\n,;\0")
        if text:
            yield number, text


def _header(text: str, count: int) -> tuple[tuple[str, ...], int, str]:
    """Names without units, the position of time and its unit; no names where there are not `count`."""
    columns = _columns(text)
    if len(columns) != count:
        return (), 0, ""
    names, units = zip(*(_name_and_unit(column) for column in columns), strict=True)
    for index, name in enumerate(names):
        match = _TIME.match(name)
        if match:
            unit = match.group(3) or match.group(4) or units[index]
            unit = _SPELLINGS.get(unit, unit)
            return names, index, unit if unit in _DECIMALS else ""
    return names, 0, ""


def _columns(text: str) -> list[str]:
    text = text.lstrip("#% ")
    if "," in text:
        return text.split(",")
    # A unit in brackets belongs to the name before it, and may hold blanks itself.
    joined = re.sub(r"\[[^\]]*\]", lambda unit: unit.group().replace(" ", ""), text)
    return re.sub(r"\s+(?=\[)", "", joined).split()


def _name_and_unit(column: str) -> tuple[str, str]:
    name, _, unit = column.partition("[")
    return name.strip().lower(), unit.rstrip("] \t").strip().lower()


def _split(text: str) -> list[str]:
    return text.replace(",", " ").replace(";", " ").split() or [""]


def _is_comment(text: str) -> bool:
    return text.startswith(("#", "%"))


def _is_number(token: str) -> bool:
    return _numbers([token]) is not None


def _numbers(tokens: list[str]) -> list[float] | None:
    try:
        row = [float(token) for token in tokens]
    except ValueError:
        return None
    # Python takes 1_000 for a number.
    return None if any("_" in token for token in tokens) else row
