"""Checks on time stamps: order, duplicates, rate, and whether two streams share one clock and unit."""

from __future__ import annotations

import numpy as np

from asyneio.errors import RecordingError
from asyneio.types import NS_PER_S, IntArray, RecordArray

#: Disorder up to this is the jitter of a driver and is sorted away; beyond it the stream was reset.
MAX_DISORDER_NS = 10_000_000

#: Sample rates of inertial units outside this range mean a wrong time unit.
PLAUSIBLE_RATE_HZ = (5.0, 50_000.0)

#: A shorter pause is no gap, however fast the sensor is.
GAP_NS = 5_000_000

#: Event sensors stamp in microseconds.
_SENSOR_TICK_NS = 1000

#: Streams of one run start and end together within this share of its length.
_END_TOLERANCE = 0.2

#: Factors between the time units that people write by mistake, against nanoseconds.
_UNITS = {10**3: "microseconds", 10**6: "milliseconds", 10**9: "seconds"}


def sort_in_time(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Rows in ascending `t_ns`, equal stamps in file order, with a note when anything moved.

    Raises:
        RecordingError: a stamp lies more than MAX_DISORDER_NS before one that precedes it.
    """
    t_ns = rows["t_ns"]
    backward = np.flatnonzero(t_ns[1:] < t_ns[:-1])
    if backward.size == 0:
        return rows, ()
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
    ranges = f"{first_name} spans {_range(a0, a1)}, {second_name} spans {_range(b0, b1)}"
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

    A wrong unit scales the stamps as well as the length: start and end of the shorter span, each times the
    factor, are those of the longer one. An excerpt lies elsewhere in the longer span.
    """
    (name, (start, end)), (_, (long_start, long_end)) = sorted(
        ((first_name, first), (second_name, second)), key=lambda item: item[1][1] - item[1][0]
    )
    allowed = _END_TOLERANCE * (long_end - long_start)
    for factor, unit in _UNITS.items():
        if max(abs(start * factor - long_start), abs(end * factor - long_end)) <= allowed:
            return f" (likely factor {factor}: is {name} in {unit}?)"
    return ""


def _likely_cause(first: tuple[int, int], second: tuple[int, int], first_name: str, second_name: str) -> str:
    lengths = (first[1] - first[0], second[1] - second[0])
    # Stamps of one epoch are alike whatever part of the run they are of, lengths are not.
    for pair, tolerance in ((lengths, 1.0 + _END_TOLERANCE), ((abs(first[1]), abs(second[1])), 2.5)):
        cause = _unit_cause(*pair, first_name, second_name, tolerance)
        if cause:
            return cause
    offset_s = (second[0] - first[0]) / NS_PER_S
    return f" (if the unit is right, the clocks are about {offset_s:.3f} s apart: see timeshift_cam_imu)"


def _unit_cause(first: int, second: int, first_name: str, second_name: str, tolerance: float) -> str:
    """A hint when one of two magnitudes is a power of a thousand times the other, otherwise nothing."""
    if min(first, second) <= 0:
        return ""
    smaller = first_name if first < second else second_name
    ratio = max(first, second) / min(first, second)
    for factor, unit in _UNITS.items():
        if factor / tolerance < ratio < factor * tolerance:
            return f" (likely factor {factor}: is {smaller} in {unit}?)"
    return ""


def _unit_hint(factor: float) -> str:
    for power, unit in _UNITS.items():
        if power / 30.0 < factor < power * 30.0:
            return f" (likely factor {power}: are the stamps in {unit}?)"
    return ""
