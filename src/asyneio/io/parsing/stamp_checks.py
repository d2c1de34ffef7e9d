"""Checks on time stamps: order, duplicates, rate, and whether two streams share one clock and unit."""

from __future__ import annotations

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.isolated_stamps import drop_isolated_rows
from asyneio.types import NS_PER_S, IntArray, RecordArray

#: More than this share of bad rows is a wrong file, not bad luck.
MAX_BAD_SHARE = 0.01

#: Disorder up to this is the jitter of a driver and is sorted away; beyond it the stream was reset.
MAX_DISORDER_NS = 10_000_000

#: Sample rates of inertial units outside this range mean a wrong time unit.
PLAUSIBLE_RATE_HZ = (5.0, 50_000.0)

#: A shorter pause is no gap, however fast the sensor is.
GAP_NS = 5_000_000

#: Event sensors stamp in microseconds.
_SENSOR_TICK_NS = 1000

#: Streams of one whole run are as long as each other to within this factor.
_LENGTH_TOLERANCE = 1.2
#: Their stamps are, though one began earlier.
_STAMP_TOLERANCE = 2.5
#: A recording is no more times as long as an excerpt of it: beyond, other stamps are those of another clock.
_MOST_LONGER = 1000

#: Factors between the time units that people write by mistake, against nanoseconds.
_UNITS = {10**3: "microseconds", 10**6: "milliseconds", 10**9: "seconds"}


def sort_in_time(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Rows in ascending `t_ns`, equal stamps in file order, with a note when anything moved.

    Isolated wrong stamps are dropped first, and counted.

    Raises:
        RecordingError: a stamp lies more than MAX_DISORDER_NS before one that precedes it.
    """
    rows, notes = drop_isolated_rows(rows, what)
    t_ns = rows["t_ns"]
    backward = np.flatnonzero(t_ns[1:] < t_ns[:-1])
    if backward.size == 0:
        return rows, notes
    latest = np.maximum.accumulate(t_ns)
    # Unsigned differences are exact for every pair of int64 with latest >= t.
    disorder = latest.astype(np.uint64) - t_ns.astype(np.uint64)
    worst = int(np.argmax(disorder))
    if int(disorder[worst]) > MAX_DISORDER_NS:
        raise RecordingError(
            f"{what}: time runs backwards by {int(disorder[worst]) / 1e6:.1f} ms at row {worst + 1} "
            f"(t_ns = {int(t_ns[worst])}); up to {MAX_DISORDER_NS / 1e6:.0f} ms is sorted, more means "
            "a sensor reset or two recordings in one file: split the file there"
        )
    order = np.argsort(t_ns, kind="stable")
    worst_ms = int(disorder[worst]) / 1e6
    return rows[order], (
        *notes,
        f"{what}: sorted {backward.size} backward step(s) in time, at most {worst_ms:.2f} ms",
    )


def drop_equal_stamps(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Keep the first row of each stamp of ascending rows, with a note when any was dropped."""
    keep = np.ones(rows.size, dtype=bool)
    keep[1:] = rows["t_ns"][1:] != rows["t_ns"][:-1]
    dropped = int(rows.size - keep.sum())
    if dropped == 0:
        return rows, ()
    return rows[keep], (f"{what}: dropped {dropped} sample(s) with a repeated time stamp",)


def check_rate(t_ns: IntArray, declared_hz: float | None, what: str) -> tuple[str, ...]:
    """Compare the median rate of ascending stamps with the plausible range and the declared rate; note gaps.

    Raises:
        RecordingError: fewer than two samples, or a rate that only a wrong time unit explains.
    """
    if t_ns.size < 2:
        raise RecordingError(f"{what} holds {t_ns.size} sample(s); at least two are needed")
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
        notes += (
            f"{what}: measured rate {rate_hz:.1f} Hz, but the calibration declares {declared_hz:.1f} Hz",
        )
    gaps_ns = steps_ns[steps_ns > max(GAP_NS, 2.5 * NS_PER_S / rate_hz)]
    if gaps_ns.size:
        notes += (f"{what}: {gaps_ns.size} gap(s) without samples, at most {gaps_ns.max() / 1e6:.1f} ms",)
    return notes


def median_rate_hz(t_ns: IntArray) -> float:
    """The rate [Hz] of the median interval of at least two ascending stamps."""
    return NS_PER_S / float(np.median(np.diff(t_ns)))


def check_overlap(
    first: IntArray, second: IntArray, first_name: str, second_name: str, first_tick_ns: int = 1
) -> None:
    """Require that two ascending series of stamps share an interval and look like one time unit.

    Args:
        first, second: the stamps [ns]; the ends alone will do.
        first_name, second_name: what they are of, for messages.
        first_tick_ns: step of the clock of events in `first`, see `tick_of`. A sensor tells microseconds:
            where these are whole, the stamps are in no smaller unit. Regular stamps tell no such thing.

    Raises:
        RecordingError: no common interval, or one span is the other in a smaller unit.
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
        raise RecordingError(f"{ranges}: the spans differ by a power of a thousand{cause}")


def tick_of(t_ns: IntArray) -> int:
    """Greatest common divisor [ns] of the steps between stamps; 0 where there is none."""
    return int(np.gcd.reduce(np.diff(t_ns), initial=0))


def _range(start: int, end: int) -> str:
    return f"{start} to {end} ns ({(end - start) / NS_PER_S:.3f} s)"


def _scaled_cause(first: tuple[int, int], second: tuple[int, int], first_name: str, second_name: str) -> str:
    """A hint when one span is the other in a smaller unit, otherwise nothing.

    A wrong unit scales the stamps as well as the length: the shorter span, times the factor, is as long as
    the longer one and overlaps it. That of an excerpt from within the longer span lies far away.
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
    # An excerpt differs from the whole in length, but not in the order of magnitude of its stamps.
    factor = _unit_factor(*ends, _STAMP_TOLERANCE)
    smaller, larger = lengths if ends[0] < ends[1] else lengths[::-1]
    if factor and larger * _MOST_LONGER >= smaller * factor:
        return _unit_cause(*ends, factor, first_name, second_name)
    offset_s = (second[0] - first[0]) / NS_PER_S
    # A calibration tells no more than a second.
    cure = "see timeshift_cam_imu" if abs(offset_s) < 1.0 else f"add these to the stamps of {first_name}"
    return f" (if the unit is right, the clocks are about {offset_s:.3f} s apart: {cure})"


def _unit_factor(first: int, second: int, tolerance: float) -> int:
    """The power of a thousand by which two magnitudes differ, to within a factor; 0 where they do not."""
    if min(first, second) <= 0:
        return 0
    ratio = max(first, second) / min(first, second)
    return next((f for f in _UNITS if f / tolerance < ratio < f * tolerance), 0)


def _unit_cause(first: int, second: int, factor: int, first_name: str, second_name: str) -> str:
    """A hint that the smaller of two magnitudes is in a smaller unit, nothing where `factor` is 0."""
    smaller = first_name if first < second else second_name
    return f" (likely factor {factor}: are the stamps of {smaller} in {_UNITS[factor]}?)" if factor else ""


def _unit_hint(factor: float) -> str:
    for power, unit in _UNITS.items():
        if power / 30.0 < factor < power * 30.0:
            return f" (likely factor {power}: are the stamps in {unit}?)"
    return ""
