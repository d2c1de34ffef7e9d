"""Text tables whose first column is time in decimal seconds, read exactly to the nanosecond."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal, InvalidOperation

from asyneio.errors import RecordingError
from asyneio.io.csv_table import MAX_BAD_LINES, TextFile, read_text
from asyneio.types import NS_PER_S

Row = tuple[int, tuple[float, ...]]


def format_seconds(t_ns: int) -> str:
    """Nanoseconds as seconds with nine decimals, exactly: a float holds only seven at today's epoch."""
    sign = "-" if t_ns < 0 else ""
    seconds, rest = divmod(abs(t_ns), NS_PER_S)
    return f"{sign}{seconds}.{rest:09d}"


def parse_seconds(text: str, decimals: int = 9) -> int | None:
    """Seconds as decimal text to int64 nanoseconds, exactly; None for what is no such time.

    `decimals` is how many make a nanosecond: 9 of a second, 3 of a microsecond.
    """
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        return None
    # The exponent is checked before any arithmetic: 1e999999 would otherwise fill the memory.
    if not seconds.is_finite() or seconds.adjusted() > 18:
        return None
    t_ns = int(seconds.scaleb(decimals).to_integral_value())
    return t_ns if abs(t_ns) < 2**63 else None


def read_rows(
    path: TextFile, columns: str, valid: Callable[[tuple[float, ...]], bool] | None = None
) -> tuple[list[Row], list[int]]:
    """Rows of `columns` (names parted by blanks, time first) and the numbers of the lines skipped.

    Values may be separated by blanks or commas; `#` starts a comment. A row counts when all its values are
    finite and `valid`, if given, accepts them (without the time).

    Raises:
        RecordingError: unreadable, more than MAX_BAD_LINES lines skipped, or no row at all.
    """
    rows: list[Row] = []
    bad: list[int] = []
    count = len(columns.split()) - 1
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        text = line.split("#", 1)[0].replace(",", " ").strip()
        if not text:
            continue
        row = _parse_row(text.split(), count)
        if row is not None and (valid is None or valid(row[1])):
            rows.append(row)
            continue
        bad.append(number)
        if len(bad) > MAX_BAD_LINES:
            raise RecordingError(
                f"{path} has more than {MAX_BAD_LINES} unreadable lines, the last at {number}: "
                f"{text[:60]!r}; expected {columns}"
            )
    if not rows:
        raise RecordingError(f"{path} holds no readable row; expected lines of {columns}")
    return rows, bad


def _parse_row(tokens: list[str], count: int) -> Row | None:
    if len(tokens) != count + 1:
        return None
    t_ns = parse_seconds(tokens[0])
    try:
        values = tuple(float(token) for token in tokens[1:])
    except ValueError:
        return None
    return (t_ns, values) if t_ns is not None and all(map(math.isfinite, values)) else None
