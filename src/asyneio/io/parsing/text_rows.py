# SPDX-License-Identifier: Apache-2.0
"""Text files of numbers, with or without a header, with times in any unit."""

from __future__ import annotations

import math
import re
from array import array
from collections import Counter
from dataclasses import dataclass
from decimal import Decimal
from io import TextIOWrapper
from itertools import chain, pairwise
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.column_names import Column, TimeColumn, find_time
from asyneio.io.parsing.csv_table import MAX_BAD_LINES
from asyneio.io.parsing.decimal_seconds import parse_seconds
from asyneio.io.parsing.text_dialect import (
    Dialect,
    dialect_of,
    header_columns,
    header_names,
    is_comment,
    is_number,
    numbers_of,
)
from asyneio.io.parsing.text_lines import (
    FIRST,
    BoundedLines,
    LastNumber,
    head_of,
    judge_last_number,
    open_end_note,
    reject_no_text,
)
from asyneio.io.parsing.zip_member import DAMAGE, ZipMember
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Decimals from a time unit to a nanosecond.
DECIMALS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
#: Unix time of the years 2000 to 2100 [s]: a unit in which a stamp is in this range is the right one.
_EPOCH_S = (946_684_800, 4_102_444_800)
#: Plausible rates of any recording [Hz].
_ANY_RATE_HZ = (0.05, 50_000.0)
_MAX_BYTES = 2**30
#: Stamps with more decimals are in seconds.
_FINE_DECIMALS = 3
#: If a larger share of stamps repeats, they were printed with too few digits.
_MAX_REPEATED = 0.5


@dataclass(frozen=True)
class TextRows:
    """Content of a file.

    Attributes:
        path: the file.
        columns: as named in the header; empty without a header.
        time: the column of the time.
        times: its N texts.
        values: all columns, (N, columns); NaN for text columns.
        bad: numbers of the skipped lines.
        notes: how the lines were read, if unusual.
        first: the first line of numbers, for messages.
        mark: the only separator of fields; "" if blanks separate as well.
    """

    path: Path | ZipMember
    columns: tuple[Column, ...]
    time: TimeColumn
    times: list[str]
    values: FloatArray
    bad: list[int]
    notes: tuple[str, ...] = ()
    first: str = ""
    mark: str = ""

    def stamps(self, rates_hz: tuple[float, float], slow: bool = False) -> tuple[IntArray, str]:
        """Times [ns], exactly as printed, and their unit: from the header, else the only one that fits.

        Units differ by a factor of 1000: with bounds closer than that, no step fits two units. `slow` allows
        lower rates for times that look like seconds.

        Raises:
            RecordingError: no unit fits, or a time is out of range.
        """
        self._reject_repeated()
        self._reject_unit()
        unit = self.time.unit or self._unit(rates_hz, slow)
        stamps = [parse_seconds(text, DECIMALS[unit]) for text in self.times]
        if None in stamps:
            text = self.times[stamps.index(None)]
            raise RecordingError(f"{self.path}: {text[:40]} {unit} does not fit into 64 bits of nanoseconds")
        return np.array(stamps, dtype=np.int64), unit

    def _first_times(self) -> list[Decimal]:
        return [Decimal(text) for text in self.times[: FIRST + 1]]

    def _reject_repeated(self) -> None:
        exact = self._first_times()
        steps = sorted(abs(float(after - before)) for before, after in pairwise(exact))
        if len(exact) > 2 and steps[int(_MAX_REPEATED * len(steps))] == 0.0:
            raise RecordingError(
                f"{self.path}: time does not advance: only {len(set(exact))} different stamps in the first "
                f"{len(exact)} lines, starting with {self.times[0][:30]}: printed with too few digits. "
                "Write seconds with nine decimals (%.9f)"
            )

    def _reject_unit(self) -> None:
        """Reject a unit in the header if the times since 1970 are in another one."""
        if not self.time.unit:
            return
        first = abs(float(self.times[0]))
        years = {unit: first * 10.0**decimals / NS_PER_S for unit, decimals in DECIMALS.items()}
        other = [unit for unit, epoch_s in years.items() if _within(epoch_s, _EPOCH_S)]
        if other and other[0] != self.time.unit and self.time.nanoseconds is None:
            raise RecordingError(
                f"{self.path}: the header names {self.time.unit} as the unit of time, but "
                f"{self.times[0][:30]} is a time since 1970 in {other[0]}: write {other[0]} in the header"
            )

    def _unit(self, rates_hz: tuple[float, float], slow: bool) -> str:
        if len(self.times) < 2:
            return "s"
        exact = self._first_times()
        steps = sorted(abs(float(after - before)) for before, after in pairwise(exact))
        step = float(np.median(steps))
        rates = {unit: NS_PER_S / (step * 10.0**decimals) for unit, decimals in DECIMALS.items() if step}
        for unit, rate in rates.items():
            epoch = float(abs(exact[0])) * 10.0 ** DECIMALS[unit] / NS_PER_S
            if _EPOCH_S[0] <= epoch <= _EPOCH_S[1] and _within(rate, _ANY_RATE_HZ):
                return unit
        in_seconds = slow and _within(rates.get("s", 0.0), _ANY_RATE_HZ)
        if in_seconds and min(-int(time.as_tuple().exponent) for time in exact) > _FINE_DECIMALS:
            return "s"
        for unit, rate in rates.items():
            if _within(rate, rates_hz):
                return unit
        if in_seconds:
            return "s"
        raise RecordingError(
            f"{self.path}: time advances by {step:g} per line, which is {rates_hz[0]:g} to {rates_hz[1]:g} "
            f"lines per second in no unit; the first line is {self.first[:60]!r}. Name the unit in a header "
            "line, such as t_ns or t[us]"
        )


def read_text_rows(
    path: Path | ZipMember, least: int, expected: str, columns: str = "", least_lines: int = 2
) -> TextRows:
    """Read a file of numbers separated by blanks, commas or semicolons; `#` and `%` start a comment.

    The last line before the numbers is the header. Numbers that are not finite are kept. With decimal commas
    (`0,5;1,5`) fields are separated by semicolons, tabs or blanks. Text columns become NaN.

    Args:
        path: the file.
        least: required number of columns.
        expected: what the file should contain, for messages.
        columns: a header for a file without one, names separated by commas or blanks.
        least_lines: required number of lines of numbers.

    Raises:
        RecordingError: unreadable, too few lines or columns, or too many unreadable lines.
    """
    try:
        size = path.size() if isinstance(path, ZipMember) else path.stat().st_size
        if size > _MAX_BYTES:
            raise RecordingError(f"{path} is too large ({size} bytes); expected {expected}")
        with path.open("rb") if isinstance(path, Path) else path.open() as raw:
            reject_no_text(path, raw.read(8), expected)
            raw.seek(0)
            stream = TextIOWrapper(raw, encoding="utf-8-sig", errors="replace")
            rows = _collect(path, BoundedLines(stream, path, expected), expected, columns)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    except DAMAGE as error:
        raise RecordingError(f"{path} is damaged: {error}; download the archive again") from error
    if rows.values.shape[1] < least or len(rows.times) < least_lines:
        raise RecordingError(
            f"{path} contains {len(rows.times)} line(s) of {rows.values.shape[1]} numbers, the first "
            f"{rows.first[:60]!r}; expected {expected}"
        )
    return rows


def _collect(path: Path | ZipMember, lines: BoundedLines, expected: str, given: str) -> TextRows:
    header, start = head_of(path, lines, expected)
    texts = [text.split("#", 1)[0] for _, text in start if not is_comment(text)]
    dialect = dialect_of(texts[:50])
    counts = Counter(len(dialect.split(text)) for text in texts)
    count = counts.most_common(1)[0][0]
    columns = header_columns(given or header, count, dialect)
    if given and not columns:
        raise RecordingError(
            f"{path} has {count} columns, but {len(header_names(given, dialect))} names were given: "
            f"{given}; name every column, with - for those to ignore"
        )
    time = find_time(columns) or TimeColumn(0)
    texts_in = _text_columns(dialect, texts, count, time)
    times: list[str] = []
    values = array("d")
    bad: list[int] = []
    last = 0
    for number, text in chain(start, lines):
        if is_comment(text):
            continue
        tokens = dialect.split(text.split("#", 1)[0])
        row = numbers_of(tokens, texts_in) if len(tokens) == count else None
        if row is not None and math.isfinite(row[time.index]):
            times.append(_time_text(tokens, time))
            values.extend(row)
            last = number
            continue
        bad.append(number)
        if len(bad) > MAX_BAD_LINES:
            raise RecordingError(
                f"{path} has more than {MAX_BAD_LINES} unreadable lines, the last at {number}: "
                f"{text[:60]!r}; expected {expected}{_date_hint(tokens, time)}"
            )
    notes = _comma_notes(path.name, dialect)
    if last and last == lines.open_line and count - 1 not in texts_in:
        state = _state_of_end(dialect, texts[: len(times) - 1], tokens)
        if state is not LastNumber.COMPLETE:
            times.pop()
            del values[-count:]
            notes += (open_end_note(path.name, last, state),)
    table = np.array(values, dtype=np.float64).reshape(-1, count)
    return TextRows(path, columns, time, times, table, bad, notes, texts[0], dialect.mark)


def _comma_notes(name: str, dialect: Dialect) -> tuple[str, ...]:
    return (f"{name}: commas read as decimal points",) if dialect.decimal_comma else ()


def _state_of_end(dialect: Dialect, texts: list[str], tokens: list[str]) -> LastNumber:
    """Whether the last of `tokens`, where a file ends without a line feed, is complete."""
    rows = (dialect.split(text) for text in texts)
    return judge_last_number([row[-1] for row in rows if len(row) == len(tokens)], tokens[-1])


def _text_columns(dialect: Dialect, texts: list[str], count: int, time: TimeColumn) -> frozenset[int]:
    """Columns with text in the first complete line, such as names of frames."""
    whole = next(tokens for tokens in map(dialect.split, texts) if len(tokens) == count)
    return frozenset(index for index, token in enumerate(whole) if not is_number(token)) - {time.index}


def _time_text(tokens: list[str], time: TimeColumn) -> str:
    """The text of the time: one field, or whole seconds and nanoseconds combined."""
    text = tokens[time.index]
    if time.nanoseconds is None:
        return text
    return f"{int(float(text))}.{int(float(tokens[time.nanoseconds])):09d}"


def _date_hint(tokens: list[str], time: TimeColumn) -> str:
    """A hint if the time is a date."""
    text = tokens[time.index] if time.index < len(tokens) else ""
    if not re.match(r"\d{4}-\d\d-\d\d|\d\d?:\d\d", text):
        return ""
    return f". Times must be numbers: {text!r} is a date; write seconds or nanoseconds of the event clock"


def _within(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= value <= bounds[1]
