# SPDX-License-Identifier: Apache-2.0
"""Names of columns in files of any tool: quantity, axis, unit.

`gyro_x [deg/s]`, `field.angular_velocity.x`, `w_RS_S_x [rad s^-1]` and `gyroX` name the x axis of one sensor.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

#: Stems of axis names, without blanks, dots and underscores.
GYROSCOPE = frozenset(
    [
        "g",
        "w",
        "gyro",
        "gyr",
        "gyroscope",
        "omega",
        "angularvelocity",
        "angvel",
        "angularrate",
        "rotationrate",
        "wrss",
    ]
)
ACCELEROMETER = frozenset(
    [
        "a",
        "acc",
        "accel",
        "accelerometer",
        "acceleration",
        "linearacceleration",
        "linearacc",
        "linacc",
        "specificforce",
        "arss",
    ]
)
POSITION = frozenset(["p", "t", "pos", "position", "translation", "prsr", "prss", "posemsgposition"])
QUATERNION = frozenset(["q", "quat", "quaternion", "orientation", "rotation", "rot", "qrs"])

#: Words in names of columns that are not measurements: b_w_RS_S_x is a bias.
_OTHER = frozenset(["b", "bias", "cov", "covariance", "std", "sigma", "mag", "var", "variance"])
_UNITS_OF_TIME = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "ms": "ms", "msec": "ms", "milliseconds": "ms",
    "us": "us", "usec": "us", "µs": "us", "μs": "us", "micros": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nsecs": "ns", "nanosec": "ns", "nanosecs": "ns", "nanoseconds": "ns",
}  # fmt: skip
#: Units written as the last words of a name.
_UNIT_WORDS = {
    "dps": "deg/s", "degs": "deg/s", "degps": "deg/s", "rads": "rad/s", "radps": "rad/s",
    "ms2": "m/s^2", "mps2": "m/s^2", "mss": "m/s^2", "g": "g", "mg": "mg",
    "mdps": "mdeg/s", "mdegs": "mdeg/s", "mrads": "mrad/s", "mms2": "mm/s^2",
}  # fmt: skip
_TIMES = frozenset(
    ["t", "ts", "time", "times", "stamp", "stamps", "timestamp", "timestamps", "rosbagtimestamp"]
)
_AXES = ("x", "y", "z", "w")
_BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]")
_WORD = re.compile(r"[A-Z]?[a-zµμ]+|[A-Z]+(?![a-z])|[0-9]+")


@dataclass(frozen=True)
class Column:
    """A column of a header: the words of its name in lower case, and its unit ("" if not given)."""

    words: tuple[str, ...]
    unit: str = ""

    @property
    def axis(self) -> str:
        """The last letter if it names an axis, else ""."""
        last = self.words[-1] if self.words else ""
        return last[-1] if last[-1:] in ("x", "y", "z", "w") else ""

    def stems(self) -> set[str]:
        """The name before the axis, with and without its first words."""
        if not self.axis or _OTHER.intersection(self.words):
            return set()
        words = (*self.words[:-1], self.words[-1][:-1])
        return {"".join(words[start:]) for start in range(len(words))}


@dataclass(frozen=True)
class TimeColumn:
    """The column of the time, its unit ("" if not given), and a column of nanoseconds to add to whole
    seconds."""

    index: int
    unit: str = ""
    nanoseconds: int | None = None


def parse_column(text: str) -> Column:
    """A column of a header, `name [unit]`, `name (unit)` or `name`."""
    text = text.strip().strip("\"'")
    found = _BRACKETS.search(text)
    unit = "".join(found.group(1).split()).lower() if found else ""
    words = tuple(word.lower() for word in _WORD.findall(_BRACKETS.sub("", text)))
    if len(words) > 1 and words[0] in _AXES and words[-1][-1] not in _AXES:
        # x_gyro
        words = (*words[1:], words[0])
    for count in (3, 2, 1):
        # gyro_x_dps, acc_x_m_s2
        if not unit and len(words) > count and "".join(words[-count:]) in _UNIT_WORDS:
            return Column(words[:-count], _UNIT_WORDS["".join(words[-count:])])
    return Column(words, unit)


def find_axes(columns: Sequence[Column], stems: frozenset[str], axes: str = "xyz") -> tuple[int, ...] | None:
    """Positions of the axes of a quantity; None if the header lacks one, or names one twice."""
    found: dict[str, int] = {}
    for index, column in enumerate(columns):
        if column.axis in axes and column.axis and stems.intersection(column.stems()):
            if column.axis in found:
                return None
            found[column.axis] = index
    return tuple(found[axis] for axis in axes) if len(found) == len(axes) else None


def find_bare_axes(columns: Sequence[Column]) -> tuple[int, ...] | None:
    """Positions of the columns named exactly x, y and z."""
    names = [column.words for column in columns]
    if all(names.count((axis,)) == 1 for axis in "xyz"):
        return tuple(names.index((axis,)) for axis in "xyz")
    return None


def find_time(columns: Sequence[Column]) -> TimeColumn | None:
    """The column of the time; a ROS header stamp takes precedence over the recording time. None without
    one."""
    best: TimeColumn | None = None
    rank = 0
    for index, column in enumerate(columns):
        words, unit = column.words, _UNITS_OF_TIME.get(column.unit, "")
        if words and words[-1] in _UNITS_OF_TIME and (len(words) > 1 or words[-1] not in ("s", "ms")):
            words, unit = words[:-1], _UNITS_OF_TIME[words[-1]]
        if words and words[-1] not in _TIMES:
            continue
        in_header = "header" in words
        if not words or in_header or words[-1] == "stamp":
            partner = _partner(columns, column) if unit == "s" else None
            if partner is not None:
                return TimeColumn(index, "s", partner)
        if not words:
            continue
        score = 2 if in_header else 1
        if score > rank:
            best, rank = TimeColumn(index, unit), score
    return best


def _partner(columns: Sequence[Column], seconds: Column) -> int | None:
    """The column of nanoseconds for one of whole seconds: the same name except for the last word."""
    for index, column in enumerate(columns):
        same = column.words[:-1] == seconds.words[:-1] and column is not seconds
        if same and column.words and _UNITS_OF_TIME.get(column.words[-1]) == "ns":
            return index
    return None
