# SPDX-License-Identifier: Apache-2.0
"""Checks of time stamps: order, duplicates, rate, and whether two streams share one clock and unit."""

from __future__ import annotations

import shlex

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.clock_wraps import unwrapped
from asyneio.io.parsing.isolated_stamps import MAX_DISORDER_NS as MAX_DISORDER_NS
from asyneio.io.parsing.isolated_stamps import drop_isolated_rows
from asyneio.types import NS_PER_S, IntArray, RecordArray

#: A larger share of bad rows means a wrong file.
MAX_BAD_SHARE = 0.01

#: More steps back are no resets of a sensor.
_MOST_RESETS = 10

#: IMU rates outside this range mean a wrong time unit.
PLAUSIBLE_RATE_HZ = (5.0, 50_000.0)

#: A shorter pause is not a gap, however fast the sensor is.
GAP_NS = 5_000_000

#: Event sensors have a clock of microseconds.
_SENSOR_TICK_NS = 1000

#: Durations of complete streams of one recording agree to within this factor.
_LENGTH_TOLERANCE = 1.2
#: Their stamps agree to within this factor, although one may start earlier.
_STAMP_TOLERANCE = 2.5
#: Largest ratio of a recording to an excerpt of it; beyond, different stamps mean different clocks.
_MAX_LENGTH_RATIO = 1000

#: Factors between nanoseconds and other time units.
_UNITS = {10**3: "microseconds", 10**6: "milliseconds", 10**9: "seconds"}


def sort_command(name: str) -> str:
    """The command that sorts a text file with times in the first column, in its folder."""
    return f"sort -s -g {shlex.quote(name)} > sorted.txt"


def sort_in_time(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Rows in ascending `t_ns`, equal stamps in file order, and notes on what changed.

    A clock that wraps around continues, then isolated wrong stamps are dropped.

    Raises:
        RecordingError: a stamp is more than MAX_DISORDER_NS earlier than a previous one.
    """
    rows, wrapped = unwrapped(rows, what)
    rows, notes = drop_isolated_rows(rows, what)
    notes = wrapped + notes
    t_ns = rows["t_ns"]
    backward = np.flatnonzero(t_ns[1:] < t_ns[:-1])
    if backward.size == 0:
        return rows, notes
    latest = np.maximum.accumulate(t_ns)
    # Unsigned differences are exact for every pair of int64 with latest >= t.
    disorder = latest.astype(np.uint64) - t_ns.astype(np.uint64)
    worst = int(np.argmax(disorder))
    if int(disorder[worst]) > MAX_DISORDER_NS:
        if backward.size > _MOST_RESETS:
            text = what.lower().endswith(".txt")
            sort = f"(in the folder of the file: {sort_command(what)})" if text else "by their time"
            raise RecordingError(
                f"{what}: its rows are not sorted by time, which runs backwards {backward.size} times, by up "
                f"to {int(disorder[worst]) / 1e6:.1f} ms: sort them {sort}"
            )
        raise RecordingError(
            f"{what}: time runs backwards by {int(disorder[worst]) / 1e6:.1f} ms at row {worst + 1} "
            f"(t_ns = {int(t_ns[worst])}); up to {MAX_DISORDER_NS / 1e6:.0f} ms is sorted, more means "
            "a sensor reset, or two recordings in one file: split the file there"
        )
    order = np.argsort(t_ns, kind="stable")
    worst_ms = int(disorder[worst]) / 1e6
    return rows[order], (
        *notes,
        f"{what}: sorted {backward.size} backward step(s) in time, at most {worst_ms:.2f} ms",
    )


def drop_equal_stamps(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Keep the first of ascending rows with equal stamps, and a note if any row was dropped."""
    keep = np.ones(rows.size, dtype=bool)
    keep[1:] = rows["t_ns"][1:] != rows["t_ns"][:-1]
    dropped = int(rows.size - keep.sum())
    if dropped == 0:
        return rows, ()
    return rows[keep], (f"{what}: dropped {dropped} sample(s) with a repeated time stamp",)


def check_rate(t_ns: IntArray, declared_hz: float | None, what: str) -> tuple[str, ...]:
    """Check the median rate of ascending stamps against the plausible range and the declared rate; note gaps.

    Raises:
        RecordingError: fewer than two samples, or an implausible rate (wrong time unit).
    """
    if t_ns.size < 2:
        raise RecordingError(f"{what} contains {t_ns.size} sample(s); at least two are needed")
    steps_ns = np.diff(t_ns).astype(np.float64)
    rate_hz = median_rate_hz(t_ns)
    low, high = PLAUSIBLE_RATE_HZ
    if not low <= rate_hz <= high:
        raise RecordingError(
            f"{what}: the median interval gives {rate_hz:.4g} Hz, expected {low:g} to {high:g} Hz; "
            f"t_ns must be whole nanoseconds{_unit_hint(rate_hz / 500.0)}"
        )
    notes: tuple[str, ...] = ()
    if declared_hz is not None and not 0.8 <= rate_hz / declared_hz <= 1.25:
        notes += (f"{what}: measured rate {rate_hz:.1f} Hz, but the calibration says {declared_hz:.1f} Hz",)
    gaps_ns = steps_ns[steps_ns > max(GAP_NS, 2.5 * NS_PER_S / rate_hz)]
    if gaps_ns.size:
        notes += (f"{what}: {gaps_ns.size} gap(s) without samples, at most {gaps_ns.max() / 1e6:.1f} ms",)
    return notes


def median_rate_hz(t_ns: IntArray) -> float:
    """The rate [Hz] from the median interval of at least two ascending stamps."""
    return NS_PER_S / float(np.median(np.diff(t_ns)))


def check_overlap(
    first: IntArray, second: IntArray, first_name: str, second_name: str, first_tick_ns: int = 1
) -> None:
    """Check that two ascending series of stamps overlap and are in the same time unit.

    Args:
        first, second: the stamps [ns]; the first and last are sufficient.
        first_name, second_name: for messages.
        first_tick_ns: resolution of the event clock in `first`, see `tick_of`. Event sensors count
            microseconds: if all stamps are multiples of these, the unit is right. Regular samples do not show
            their resolution.

    Raises:
        RecordingError: no common interval, or one series is in a smaller unit.
    """
    a0, a1 = int(first[0]), int(first[-1])
    b0, b1 = int(second[0]), int(second[-1])
    ranges = f"{first_name} from {_range(a0, a1)}, {second_name} from {_range(b0, b1)}"
    if a1 <= b0 or b1 <= a0:
        raise RecordingError(
            f"{ranges}: they do not overlap; both must be nanoseconds of one clock"
            f"{_likely_cause((a0, a1), (b0, b1), first_name, second_name)}"
        )
    cause = _scaled_cause((a0, a1), (b0, b1), first_name, second_name)
    whole = first_tick_ns % _SENSOR_TICK_NS == 0 and a1 - a0 < b1 - b0
    if cause and not whole:
        raise RecordingError(f"{ranges}: the durations differ by a power of a thousand{cause}")


def tick_of(t_ns: IntArray) -> int:
    """Greatest common divisor [ns] of the steps between stamps; 0 if all steps are 0."""
    return int(np.gcd.reduce(np.diff(t_ns), initial=0))


def _range(start: int, end: int) -> str:
    return f"{start} to {end} ns ({(end - start) / NS_PER_S:.3f} s)"


def _scaled_cause(first: tuple[int, int], second: tuple[int, int], first_name: str, second_name: str) -> str:
    """A hint if one interval is the other one in a smaller unit, else empty.

    A wrong unit scales stamps and duration alike: the shorter interval times the factor is as long as the
    longer one and overlaps it. An excerpt of the longer interval, times the factor, does not overlap it.
    """
    lengths = (first[1] - first[0], second[1] - second[0])
    factor = _unit_factor(*lengths, _LENGTH_TOLERANCE)
    short, long = (first, second) if lengths[0] < lengths[1] else (second, first)
    if short[0] * factor < long[1] and long[0] < short[1] * factor:
        return _unit_cause(*lengths, factor, first_name, second_name)
    return ""


def _likely_cause(first: tuple[int, int], second: tuple[int, int], first_name: str, second_name: str) -> str:
    lengths, ends = (first[1] - first[0], second[1] - second[0]), (abs(first[1]), abs(second[1]))
    factor = _unit_factor(*lengths, _LENGTH_TOLERANCE)
    if factor:
        return _unit_cause(*lengths, factor, first_name, second_name)
    # An excerpt differs from the whole in duration, but not in the magnitude of its stamps.
    factor = _unit_factor(*ends, _STAMP_TOLERANCE)
    smaller, larger = lengths if ends[0] < ends[1] else lengths[::-1]
    if factor and larger * _MAX_LENGTH_RATIO >= smaller * factor:
        return _unit_cause(*ends, factor, first_name, second_name)
    offset_s = (second[0] - first[0]) / NS_PER_S
    # A calibration contains shifts up to a second.
    fix = "see timeshift_cam_imu" if abs(offset_s) < 1.0 else f"add these to the stamps of {first_name}"
    return f" (if the unit is right, the clocks are about {offset_s:.3f} s apart: {fix})"


def _unit_factor(first: int, second: int, tolerance: float) -> int:
    """The power of a thousand by which two magnitudes differ, to within a factor; 0 if they do not."""
    if min(first, second) <= 0:
        return 0
    ratio = max(first, second) / min(first, second)
    return next((f for f in _UNITS if f / tolerance < ratio < f * tolerance), 0)


def _unit_cause(first: int, second: int, factor: int, first_name: str, second_name: str) -> str:
    """A hint that the smaller of two magnitudes has a wrong unit; empty if `factor` is 0."""
    smaller = first_name if first < second else second_name
    return f" (likely factor {factor}: are the stamps of {smaller} in {_UNITS[factor]}?)" if factor else ""


def _unit_hint(factor: float) -> str:
    for power, unit in _UNITS.items():
        if power / 30.0 < factor < power * 30.0:
            return f" (likely factor {power}: are the stamps in {unit}?)"
    return ""
