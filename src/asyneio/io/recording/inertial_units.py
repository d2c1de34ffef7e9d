# SPDX-License-Identifier: Apache-2.0
"""Units of inertial samples, checked by gravity: by its magnitude and by its rotation in the body frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.types import NS_PER_S, FloatArray, RecordArray

STANDARD_GRAVITY = 9.80665
#: Absurd values overflow to inf, which quantiles cannot interpolate; this is outside all bounds too.
_LARGEST_NORM = 1e300
_DEGREE = float(np.pi / 180.0)

#: Bounds on the median specific force [m/s^2]: outside the first, a note; outside the second, an error.
_EXPECTED_FORCE = (8.8, 10.8)
_USABLE_FORCE = (4.0, 30.0)
#: Median norm of an accelerometer in g.
_FORCE_IN_G = (0.8, 1.25)
#: Common gyroscopes measure up to 2000 deg/s = 35 rad/s; hand-held motion in deg/s does exceed 35.
_LARGEST_RATE = 35.0

#: The direction of gravity is averaged over the first [s], and compared after the second [s].
_SMOOTH_S, _LATER_S = 0.1, 0.3
#: Largest and smallest number of comparisons.
_PAIRS = (400, 20)
#: Smallest rotation [rad] that determines the unit; smallest error of gravity [rad] that rejects a unit, and
#: by which factor the other unit must be better.
_LEAST_TURN, _WRONG_TURN, _BETTER = 0.6, 0.4, 3.0

#: Gravity in other units, and in the counts of common full-scale ranges.
_FORCE_UNITS = (
    (1000.0, "mg"),
    (STANDARD_GRAVITY * 1000.0, "mm/s^2"),
    (STANDARD_GRAVITY * 100.0, "cm/s^2"),
    (STANDARD_GRAVITY**2, "m/s^2 multiplied by 9.81 again"),
    (STANDARD_GRAVITY / 4.0, "a full-scale range four times the driver's"),
    (STANDARD_GRAVITY * 4.0, "a full-scale range a quarter of the driver's"),
    *((count, f"raw counts of {count:.0f} per g") for count in (2048.0, 4096.0, 8192.0, 16384.0)),
)
#: A unit fits up to this factor; quartiles of the norm farther apart than this share of the median show that
#: it contains no gravity.
_NEAR, _VARIES = 1.12, 0.5

_FACTORS: dict[str, dict[float, tuple[str, ...]]] = {
    "gyroscope": {
        1.0: ("", "rad/s", "rads^-1", "rads-1", "rad/sec", "rads", "radps", "radians/s"),
        _DEGREE: ("deg/s", "degs^-1", "degs-1", "deg/sec", "dps", "°/s", "degrees/s", "degps"),
        1e-3 * _DEGREE: ("mdeg/s", "mdps", "millideg/s", "m°/s"),
        1e-3: ("mrad/s", "mrads^-1", "mrad/sec"),
    },
    "accelerometer": {
        1.0: ("", "m/s^2", "m/s2", "ms^-2", "ms-2", "m/s²", "m/s/s", "m/sec^2", "m/s**2", "m*s^-2"),
        STANDARD_GRAVITY: ("g", "gs", "g's", "g0", "gn"),
        1e-3 * STANDARD_GRAVITY: ("mg", "milli-g", "millig"),
        1e-6 * STANDARD_GRAVITY: ("ug", "µg"),
        1e-3: ("mm/s^2", "mm/s2", "mm/s²"),
        1e-2: ("cm/s^2", "cm/s2", "cm/s²", "gal"),
    },
}


@dataclass(frozen=True)
class InertialStreams:
    """Gyroscope [rad/s] and accelerometer [m/s^2], INERTIAL_DTYPE ascending, and notes on repairs."""

    gyroscope: RecordArray
    accelerometer: RecordArray
    notes: tuple[str, ...]


def factor_of(sensor: str, unit: str) -> float | None:
    """The SI value of a unit (lower case, without blanks); None if unknown."""
    return next((factor for factor, names in _FACTORS[sensor].items() if unit in names), None)


def check_units(
    gyroscope: RecordArray, accelerometer: RecordArray, notes: tuple[str, ...]
) -> InertialStreams:
    """Repair swapped columns and convert g and deg/s, if gravity shows that this is necessary.

    `notes` precede those added here.

    Raises:
        RecordingError: gravity explains the accelerometer in no known unit.
    """
    if _exchanged(gyroscope, accelerometer):
        gyroscope, accelerometer = accelerometer, gyroscope
        notes += ("gravity is in the gyroscope columns: gyroscope and accelerometer were swapped",)
    force = _median_norm(accelerometer)
    in_g = _within(force, _FORCE_IN_G)
    if in_g:
        accelerometer = _scaled(accelerometer, STANDARD_GRAVITY)
        force *= STANDARD_GRAVITY
        notes += (
            "the median norm of the accelerometer is about one, so it is in g: multiplied by "
            f"{STANDARD_GRAVITY}",
        )
    rate = _DEGREE * float(np.percentile(_norms(gyroscope), 95.0))
    if rate > _LARGEST_RATE and _within(force, _USABLE_FORCE):
        raise RecordingError(
            f"the gyroscope exceeds {_LARGEST_RATE:g} rad/s even as deg/s (95 % of its readings are below "
            f"{rate / _DEGREE:.4g}): counts or thousandths of a unit? Name the unit in the header, such as "
            "gx[mdeg/s], or convert the readings to rad/s"
        )
    in_degrees, unit_notes = _in_degrees(gyroscope, accelerometer, in_g)
    if in_degrees:
        gyroscope = _scaled(gyroscope, _DEGREE)
    notes += unit_notes
    if not _within(force, _USABLE_FORCE):
        raise RecordingError(
            f"the median norm of the accelerometer is {force:.4g}; expected about 9.81 m/s^2 (with gravity). "
            + _force_cause(accelerometer, force)
        )
    if not _within(force, _EXPECTED_FORCE):
        notes += (f"the median norm of the accelerometer is {force:.2f} m/s^2, expected about 9.81",)
    return InertialStreams(gyroscope, accelerometer, notes)


def supported_units(sensor: str) -> str:
    """The units of a sensor that headers may name, as text."""
    return ", ".join(next(name for name in names if name) for names in _FACTORS[sensor].values())


def _force_cause(accelerometer: RecordArray, force: float) -> str:
    """The likely reason for an impossible median `force`, and what to do."""
    if force == 0.0:
        return "All readings are zero: the sensor is dead or not read"
    if force < _USABLE_FORCE[0] and _relative_spread(accelerometer) > _VARIES:
        return "Check that gravity was not removed: export the raw acceleration, not the linear one"
    for true, unit in _FORCE_UNITS:
        if abs(np.log(force / true)) < np.log(_NEAR):
            return f"This fits {unit}: multiply the readings by {STANDARD_GRAVITY / true:.6g}"
    return "Check the unit, the column order, and that gravity was not removed"


def _in_degrees(
    gyroscope: RecordArray, accelerometer: RecordArray, in_g: bool
) -> tuple[bool, tuple[str, ...]]:
    """Whether the gyroscope is in deg/s, and a note on it."""
    if float(np.percentile(_norms(gyroscope), 95.0)) > _LARGEST_RATE:
        note = f"the gyroscope exceeds {_LARGEST_RATE:g} rad/s, so it is in deg/s: converted to rad/s"
        return True, (note,)
    in_degrees = turns_in_degrees(gyroscope, accelerometer)
    if in_degrees:
        return True, ("the rotation of gravity fits a gyroscope in deg/s, not rad/s: converted to rad/s",)
    if in_g and in_degrees is None:
        note = "the gyroscope is assumed to be in rad/s; an accelerometer in g often comes with deg/s: check"
        return False, (note,)
    return False, ()


def turns_in_degrees(gyroscope: RecordArray, accelerometer: RecordArray) -> bool | None:
    """Whether the rotation of gravity in the accelerometer fits the gyroscope in deg/s and not in rad/s.

    A vector that is constant in the world rotates in the body frame by the inverse of the body rotation. None
    if the rotation is too small, or the samples are too few, to decide.
    """
    starts = _starts(gyroscope["t_ns"], accelerometer["t_ns"])
    if starts.size < _PAIRS[1]:
        return None
    later = starts + round(_LATER_S * NS_PER_S)
    before, after = (_directions(accelerometer, t_ns) for t_ns in (starts, later))
    middle = round(0.5 * _SMOOTH_S * NS_PER_S)
    turning, wrong = _errors(gyroscope, starts + middle, before, after, 1.0)
    _, other = _errors(gyroscope, starts + middle, before, after, _DEGREE)
    if not turning >= _LEAST_TURN:
        return None
    return wrong > max(_WRONG_TURN, _BETTER * other)


def _starts(gyroscope_ns: np.ndarray, accelerometer_ns: np.ndarray) -> np.ndarray:
    """Start times of the comparisons, while both sensors have samples; empty if that time is short."""
    begin, end = max(gyroscope_ns[0], accelerometer_ns[0]), min(gyroscope_ns[-1], accelerometer_ns[-1])
    end -= round((_LATER_S + _SMOOTH_S) * NS_PER_S)
    if end <= begin:
        return np.empty(0, dtype=np.int64)
    step = max((int(end) - int(begin)) // _PAIRS[0], round(0.02 * NS_PER_S))
    return np.arange(int(begin), int(end), step, dtype=np.int64)


def _directions(accelerometer: RecordArray, t_ns: np.ndarray) -> FloatArray:
    """Unit vectors (N,3) of the specific force averaged from each time on; NaN without samples."""
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(accelerometer["xyz"], axis=0)])
    first, last = (
        np.searchsorted(accelerometer["t_ns"], t_ns + after) for after in (0, round(_SMOOTH_S * NS_PER_S))
    )
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        means = (sums[last] - sums[first]) / (last - first)[:, None]
        return np.asarray(means / np.linalg.norm(means, axis=1, keepdims=True))


def _errors(
    gyroscope: RecordArray, t_ns: np.ndarray, before: FloatArray, after: FloatArray, factor: float
) -> tuple[float, float]:
    """Medians of the rotation angle [rad] and of the angle between predicted and measured gravity [rad]."""
    rates = factor * gyroscope["xyz"]
    stamps = (gyroscope["t_ns"] - gyroscope["t_ns"][0]) / NS_PER_S
    start = (t_ns - gyroscope["t_ns"][0]) / NS_PER_S
    turned, total = before.copy(), np.zeros(len(before))
    steps = 30
    for k in range(steps):
        at = start + (k + 0.5) * _LATER_S / steps
        omega = np.stack([np.interp(at, stamps, rates[:, axis]) for axis in range(3)], axis=1)
        angle = omega * (_LATER_S / steps)
        turned = Rotation.from_rotvec(-angle).apply(turned)
        total += np.linalg.norm(angle, axis=1)
    cosine = np.clip((turned * after).sum(axis=1), -1.0, 1.0)
    good = np.isfinite(cosine)
    if np.count_nonzero(good) < _PAIRS[1]:
        return float("nan"), float("nan")
    return float(np.median(total[good])), float(np.median(np.arccos(cosine[good])))


def _exchanged(gyroscope: RecordArray, accelerometer: RecordArray) -> bool:
    """True if the gyroscope columns contain gravity: a norm near 9.81 that varies less than the other one.

    The second condition excludes a gyroscope in deg/s together with an accelerometer in g.
    """
    return (
        _within(_median_norm(gyroscope), _EXPECTED_FORCE)
        and not _within(_median_norm(accelerometer), _EXPECTED_FORCE)
        and _relative_spread(gyroscope) < _relative_spread(accelerometer)
    )


def _relative_spread(stream: RecordArray) -> float:
    low, middle, high = np.percentile(_norms(stream), [25.0, 50.0, 75.0])
    return float((high - low) / max(middle, np.finfo(np.float64).tiny))


def _scaled(stream: RecordArray, factor: float) -> RecordArray:
    scaled = stream.copy()
    scaled["xyz"] *= factor
    return scaled


def _norms(stream: RecordArray) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    with np.errstate(over="ignore"):
        return np.minimum(np.sqrt((stream["xyz"] ** 2).sum(axis=1)), _LARGEST_NORM)


def _median_norm(stream: RecordArray) -> float:
    return float(np.median(_norms(stream)))


def _within(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= value <= bounds[1]
