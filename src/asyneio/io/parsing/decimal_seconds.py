# SPDX-License-Identifier: Apache-2.0
"""Times as decimal text, read and written exactly to the nanosecond."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation

from asyneio.types import NS_PER_S


def format_seconds(t_ns: int) -> str:
    """Nanoseconds as seconds with nine decimals, exactly: a float has only seven for current dates."""
    sign = "-" if t_ns < 0 else ""
    seconds, rest = divmod(abs(t_ns), NS_PER_S)
    return f"{sign}{seconds}.{rest:09d}"


def parse_seconds(text: str, decimals: int = 9) -> int | None:
    """Decimal text to int64 nanoseconds, exactly; None if the text is not such a time.

    `decimals` from the unit of the text to a nanosecond: 9 for seconds, 3 for microseconds.
    """
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        return None
    # The exponent is checked before any arithmetic: 1e999999 would fill the memory.
    if not seconds.is_finite() or seconds.adjusted() > 18:
        return None
    t_ns = int(seconds.scaleb(decimals).to_integral_value())
    return t_ns if abs(t_ns) < 2**63 else None
