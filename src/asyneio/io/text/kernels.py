# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over lines of events: one for the usual layout, one for any other.

A loop stops at a line that it cannot parse, which is then parsed in Python. The line feed at the end
terminates every inner loop. Unsigned indices avoid numba's handling of negative ones, which halves the time.
"""

from __future__ import annotations

import numpy as np

from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.io.recording.event_source import FAR_OUTSIDE
from asyneio.jit import njit
from asyneio.types import NS_PER_S, IntArray

#: Roles of columns, for `parse_columns`.
IGNORED, TIME, COLUMN, ROW, POLARITY = range(5)

_BLANK, _TAB, _RETURN, _NEWLINE, _POINT, _MINUS, _ZERO = (ord(c) for c in " \t\r\n.-0")
_COMMA, _SEMICOLON = ord(","), ord(";")
#: Nanoseconds of the last digit, by the number of decimals.
_SCALE = 10 ** np.arange(9, -1, -1)
#: Larger values do not fit; they are left to Python, which rejects them.
_MAX_SECONDS = MAX_STAMP_NS // NS_PER_S
#: Digits that fit into 64 bits.
_MAX_DIGITS = 19


# One pass over the bytes: a call for each byte would cost more than the parsing.
@njit(cache=True)
def parse_columns(  # noqa: C901
    data: np.ndarray,
    start: int,
    roles: IntArray,
    unit_ns: int,
    t_ns: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    met: np.ndarray,
) -> tuple[np.int64, np.int64]:
    """Like `parse_lines`, for columns in any order (`roles`, one per column), separated by blank, tab, comma
    or semicolon, with the time in any unit."""
    line, count = np.int64(start), np.int64(0)
    while line < data.size:
        i, column, good = line, 0, True
        time = polarity = across = down = 0
        while good:
            negative = bool(data[i] == _MINUS)
            i += 1 if negative else 0
            first = i
            i, value = _signed_digits(data, i)
            role = roles[column]
            good = bool(i > first and i - first <= _MAX_DIGITS and value >= 0)
            if data[i] == _POINT and good:
                point = i + 1
                i, fraction = _signed_digits(data, point)
                decimals = i - point
                good = role == IGNORED or (role == TIME and decimals <= 9)
                if role == TIME and good:
                    time = fraction * unit_ns // _SCALE[9 - decimals]
            if role == TIME:
                good = good and not negative and value < MAX_STAMP_NS // unit_ns
                time += value * unit_ns
            elif role == POLARITY:
                good = good and value <= 1 and not (negative and value == 0)
                polarity = -value if negative else value
            elif role != IGNORED:
                good = good and not negative
                value = min(value, FAR_OUTSIDE)
                across, down = (value, down) if role == COLUMN else (across, value)
            column += 1
            if column == roles.size:
                break
            mark = data[i]
            good = good and mark in (_BLANK, _TAB, _COMMA, _SEMICOLON)
            i += 1 if good else 0
            while good and data[i] == _BLANK:
                i += 1
        if data[i] == _RETURN:
            i += 1
        if not good or data[i] != _NEWLINE:
            break
        if polarity < 1:
            met[-polarity] = True
        t_ns[count], x[count], y[count], p[count] = time, across, down, max(polarity, 0)
        count += 1
        line = i + 1
    return line, count


# One pass over the bytes: a call for each byte would cost more than the parsing.
@njit(cache=True)
def parse_lines(  # noqa: C901
    data: np.ndarray,
    start: int,
    t_ns: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    met: np.ndarray,
) -> tuple[np.uint64, np.uint64]:
    """Parse `data` (uint8, ends in a line feed) from `start` up to the first unusual line.

    Returns the position where it stopped (the start of a line, or the end) and the number of events. A usual
    line has digits with up to nine decimals, integers x and y, and polarity 0, 1 or -1, separated by one
    blank or tab.
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
    """Position after the decimal digits at `i`, and their value (invalid and unused beyond 18 digits)."""
    value = np.int64(0)
    digit = np.uint8(data[i] - np.uint8(_ZERO))
    while digit <= 9:
        value = 10 * value + np.int64(digit)
        i += np.uint64(1)
        digit = np.uint8(data[i] - np.uint8(_ZERO))
    return i, value


@njit(cache=True)
def _signed_digits(data: np.ndarray, i: np.int64) -> tuple[np.int64, np.int64]:
    """Like `_digits`, with signed positions."""
    end, value = _digits(data, np.uint64(i))
    return np.int64(end), value
