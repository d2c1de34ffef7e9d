# SPDX-License-Identifier: Apache-2.0
"""The meaning of four columns of numbers: time, column, row and polarity, in any order and unit.

Columns are identified by name, else by value: a polarity has two values, a pixel is an integer below 65 535,
and time increases. The time unit follows from a name such as `t[us]`, from the magnitude of Unix times, or
from decimals, which only seconds have; other integers are in the default unit of the layout.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asyneio.types import FloatArray

#: Nanoseconds per time unit.
UNITS_NS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
UNIT_WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
#: Names of the four columns; a unit may follow.
_NAMES = {
    "t": re.compile(r"t|ts|time|times|timestamps?|stamps?|time_?stamps?"),
    "x": re.compile(r"xs?|col(umn)?s?|x_?(coord(inate)?|pos(ition)?|addr(ess)?|pix(el)?)s?|(pos|pixel)_?x"),
    "y": re.compile(r"ys?|rows?|y_?(coord(inate)?|pos(ition)?|addr(ess)?|pix(el)?)s?|(pos|pixel)_?y"),
    "p": re.compile(r"ps?|pols?|polarity|polarities|on|is_?on|signs?"),
}
#: Words before the names.
_PREFIX = re.compile(r"(events?|ev|dvs|cd)[ _./]")
#: Names of arrays (N,2) with column and row.
_PIXELS = re.compile(r"xys?|coord(inate)?s?|pixels?|positions?|locations?")
_UNIT = re.compile(r"(.*?)[ _]*[\[(_ ](s|sec|seconds|ms|us|µs|usec|microseconds|ns|nsec|nanoseconds)[\])]?")
_SPELLINGS = {
    "sec": "s", "seconds": "s", "µs": "us", "usec": "us", "microseconds": "us", "nsec": "ns",
    "nanoseconds": "ns",
}  # fmt: skip
#: Orders of columns without names, by preference; the first is that of UZH, the second that of Metavision.
_ORDERS = ("txyp", "xypt", "xytp", "tpxy")
#: Unix times from 2001 to 2096 [s].
_EPOCH_S = (1e9, 4e9)
_MOST_PIXELS = 65_535
#: Largest share of rows at which a time column may step back.
_BACK_SHARE = 0.1


@dataclass(frozen=True)
class Meaning:
    """Roles of the columns, and the time unit.

    Attributes:
        columns: positions of t, x, y, p.
        count: number of all columns.
        unit: of the time, a key of UNITS_NS.
        unit_source: how the unit was determined, for messages.
        named: whether the columns were identified by name.
    """

    columns: tuple[int, int, int, int]
    count: int
    unit: str
    unit_source: str
    named: bool = False

    @property
    def unit_ns(self) -> int:
        """Nanoseconds per time unit."""
        return UNITS_NS[self.unit]

    @property
    def order(self) -> str:
        """The columns in file order, such as "x y p t"."""
        return " ".join(letter for _, letter in sorted(zip(self.columns, "txyp", strict=True)))

    @property
    def usual(self) -> bool:
        """True for the layout of UZH: t x y p in seconds."""
        return self.columns == (0, 1, 2, 3) and self.count == 4 and self.unit == "s"

    def note(self, name: str) -> str:
        """A note on how the columns were read."""
        by = " (by their names)" if self.named else ""
        more = f"; {self.count - 4} further column(s) ignored" if self.count > 4 else ""
        unit = f"time in {UNIT_WORDS[self.unit]} ({self.unit_source})"
        return f"{name}: columns {self.order}{by}, {unit}{more}"


def columns_by_name(names: Sequence[str]) -> tuple[dict[str, int], str] | None:
    """Positions of t, x, y, p among names, and the time unit given in a name ("" if none).

    None if a column is missing or occurs twice.
    """
    found: dict[str, int] = {}
    unit = ""
    for position, name in enumerate(names):
        plain, name_unit = name_and_unit(name)
        plain = _PREFIX.sub("", plain, count=1) if _PREFIX.match(plain) else plain
        letter = next((letter for letter, names_of in _NAMES.items() if names_of.fullmatch(plain)), None)
        if letter is None:
            continue
        if letter in found:
            return None
        found[letter] = position
        if letter == "t":
            unit = name_unit
    return (found, unit) if len(found) == 4 else None


def names_pixels(name: str) -> bool:
    """Whether this is the name of an array (N,2) of column and row."""
    plain = name_and_unit(name)[0]
    return _PIXELS.fullmatch(_PREFIX.sub("", plain, count=1)) is not None


def name_and_unit(name: str) -> tuple[str, str]:
    """A column name in lower case without its unit, and the unit ("" if none)."""
    plain = name.strip().strip("\"'").lower()
    match = _UNIT.fullmatch(plain)
    if match is None or not match.group(1):
        return plain, ""
    return match.group(1).strip(), _SPELLINGS.get(match.group(2), match.group(2))


def columns_by_values(rows: FloatArray) -> dict[str, int] | None:
    """Positions of t, x, y, p in rows (N,4) without names; None if no order fits."""
    if rows.ndim != 2 or rows.shape[1] != 4 or rows.shape[0] == 0 or not np.isfinite(rows).all():
        return None
    fitting = []
    for preference, order in enumerate(_ORDERS):
        position = {letter: order.index(letter) for letter in "txyp"}
        if not is_polarity(rows[:, position["p"]]) or not all(
            are_pixels(rows[:, position[axis]]) for axis in "xy"
        ):
            continue
        back = float(np.mean(np.diff(rows[:, position["t"]]) < 0.0)) if rows.shape[0] > 1 else 0.0
        fitting.append((back > _BACK_SHARE, preference, position))
    return min(fitting, key=lambda one: one[:2])[2] if fitting else None


def unit_of_time(times: FloatArray, default_unit: str, layout: str) -> tuple[str, str]:
    """The unit of stamps (N,), and how it was determined.

    Args:
        times: a sample of the stamps.
        default_unit: of integers that are not Unix times.
        layout: name of the layout with this default unit.
    """
    largest = float(np.max(np.abs(times), initial=0.0))
    for unit, ns in UNITS_NS.items():
        scale = 1e9 / ns
        # Unix times in seconds have decimals or are covered by the default.
        if unit != "s" and _EPOCH_S[0] * scale <= largest <= _EPOCH_S[1] * scale:
            return unit, "stamps since 1970"
    if (times != np.round(times)).any():
        return "s", "they have decimals"
    return default_unit, f"as of {layout}"


def is_polarity(values: FloatArray) -> bool:
    """True if all values are -1, 0 or 1; -1 may be stored as an unsigned number of 8, 16 or 32 bits."""
    return bool(np.isin(values, (-1.0, 0.0, 1.0, 255.0, 65_535.0, 4_294_967_295.0)).all())


def are_pixels(values: FloatArray) -> bool:
    """True if all values are integers from 0 to 65 534."""
    return bool(((values >= 0) & (values < _MOST_PIXELS) & (values == np.round(values))).all())
