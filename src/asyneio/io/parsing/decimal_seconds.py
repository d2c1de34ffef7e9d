"""Time in decimal text, read and written exactly to the nanosecond."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation

from asyneio.types import NS_PER_S


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
