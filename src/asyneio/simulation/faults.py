# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors, as pure functions of records: spikes, saturation, steps, held samples, gaps, jumps,
wrong stamps and order, bursts of events, darkness.

All take records with a field `t_ns`, ascending (EVENT_DTYPE, INERTIAL_DTYPE, OBSERVATION_DTYPE), and return
new ones; the input stays as it is. Intervals are half open, [start, end).
"""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np

from asyneio.errors import SimulationError
from asyneio.types import (
    EVENT_DTYPE,
    NS_PER_S,
    EventRecording,
    FloatArray,
    IntArray,
    PoseTrajectory,
    RecordArray,
    Recording,
)

#: How long all pixels take to fire once when the light goes off or on [ns].
_LIGHT_CHANGE_NS = 20_000_000


def spikes(records: RecordArray, share: float, magnitude: float, rng: np.random.Generator) -> RecordArray:
    """Inertial samples of which some are off by `magnitude` [unit of the samples], in random directions.

    Args:
        records: INERTIAL_DTYPE.
        share: how many of the samples, 0 to 1; drawn for each sample by itself.
        magnitude: length of what is added.
        rng: source of randomness.

    Raises:
        SimulationError: the share is none.
    """
    if not 0.0 <= share <= 1.0:
        raise SimulationError(f"a share of {share} of the samples; expected 0 to 1")
    struck = rng.random(records.size) < share
    direction = rng.normal(size=(records.size, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return _with_readings(records, records["xyz"] + magnitude * struck[:, None] * direction)


def saturated(records: RecordArray, limit: float) -> RecordArray:
    """Inertial samples (INERTIAL_DTYPE) of a sensor that cannot read more than `limit` on an axis.

    Raises:
        SimulationError: the limit is not positive.
    """
    if not limit > 0.0:
        raise SimulationError(f"a limit of {limit}; expected a positive one")
    return _with_readings(records, np.clip(records["xyz"], -limit, limit))


def quantised(records: RecordArray, step: float) -> RecordArray:
    """Inertial samples (INERTIAL_DTYPE) of a sensor that reads multiples of `step` [unit of the samples].

    Raises:
        SimulationError: the step is not positive.
    """
    if not step > 0.0:
        raise SimulationError(f"a step of {step}; expected a positive one")
    return _with_readings(records, np.rint(records["xyz"] / step) * step)


def held(records: RecordArray, readings: float) -> RecordArray:
    """Inertial samples (INERTIAL_DTYPE) of a sensor whose value is renewed after a number of readings.

    With 7/3, say, a value lasts two or three readings.

    Raises:
        SimulationError: renewed more often than read.
    """
    if not readings >= 1.0:
        raise SimulationError(f"a value renewed every {readings} readings; expected 1 or more")
    index = np.arange(records.size)
    # The value at the first reading after each renewal.
    renewed = np.ceil(np.floor((index + 1e-9) / readings) * readings - 1e-9).astype(np.int64)
    return _with_readings(records, records["xyz"][np.minimum(renewed, index)])


def repeated(records: RecordArray, share: float, rng: np.random.Generator) -> RecordArray:
    """Records of which a share (0 to 1) arrives twice, with the same stamp and the same values.

    Raises:
        SimulationError: the share is none.
    """
    if not 0.0 <= share <= 1.0:
        raise SimulationError(f"a share of {share} of the records; expected 0 to 1")
    return np.repeat(records, 1 + (rng.random(records.size) < share))


def set_back(records: RecordArray, start_ns: int, end_ns: int, by_ns: int) -> RecordArray:
    """Records in order of arrival whose stamps in an interval are too early by `by_ns`.

    Raises:
        SimulationError: the interval ends before it starts.
    """
    begin, end = _cut(records, start_ns, end_ns)
    changed = records.copy()
    changed["t_ns"][begin:end] -= by_ns
    return changed


def disordered(
    records: RecordArray, start_ns: int, end_ns: int, delay_ns: int, rng: np.random.Generator
) -> RecordArray:
    """Records in order of arrival where those of an interval arrive up to `delay_ns` late; stamps are right.

    Raises:
        SimulationError: the interval ends before it starts.
    """
    begin, end = _cut(records, start_ns, end_ns)
    # The order before and after stays: it may have a fault of its own.
    last = max(end, int(np.searchsorted(records["t_ns"], end_ns + delay_ns)))
    arrival = records["t_ns"][begin:last].copy()
    arrival[: end - begin] += rng.integers(0, delay_ns + 1, end - begin)
    mixed = records.copy()
    mixed[begin:last] = records[begin:last][np.argsort(arrival, kind="stable")]
    return mixed


def with_burst(
    events: RecordArray,
    start_ns: int,
    end_ns: int,
    rate_hz: float,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> RecordArray:
    """Events (EVENT_DTYPE) with a burst of `rate_hz` events a second at random pixels in an interval.

    Args:
        events: of a sensor of `size`, width and height [px].
        start_ns, end_ns: of the burst.
        rate_hz: of the added events.
        size: of the sensor.
        rng: source of randomness.

    Raises:
        SimulationError: the interval ends before it starts.
    """
    _cut(events, start_ns, end_ns)
    count = round(rate_hz * (end_ns - start_ns) / NS_PER_S)
    pixel = rng.integers(0, size[0] * size[1], count)
    return _merged(events, rng.integers(start_ns, end_ns, count), pixel, rng.integers(0, 2, count), size[0])


def darkened(
    events: RecordArray, start_ns: int, end_ns: int, size: tuple[int, int], rng: np.random.Generator
) -> RecordArray:
    """Events (EVENT_DTYPE) where the light is off in an interval: every pixel of a sensor of `size` (width,
    height) fires OFF once, nothing follows, and every pixel fires ON once when the light is back.

    Raises:
        SimulationError: the interval ends before it starts.
    """
    dark = without(events, start_ns, end_ns)
    pixel = np.arange(size[0] * size[1])
    for at_ns, p in ((start_ns, 0), (end_ns, 1)):
        t_ns = rng.integers(at_ns, at_ns + _LIGHT_CHANGE_NS, pixel.size)
        dark = _merged(dark, t_ns, pixel, np.full(pixel.size, p), size[0])
    return dark


def without(records: RecordArray, start_ns: int, end_ns: int) -> RecordArray:
    """Records of a sensor that was silent in an interval: a dropout, a blackout.

    Raises:
        SimulationError: the interval ends before it starts.
    """
    begin, end = _cut(records, start_ns, end_ns)
    return _joined(records[:begin], records[end:])


def skipped(records: RecordArray, start_ns: int, end_ns: int) -> RecordArray:
    """Records without those of an interval, and what follows stamped earlier by its length.

    Of all sensors of a recording together, this is a kidnapping: no sensor sees the way from one place to
    the other, and the stamps have no gap.

    Raises:
        SimulationError: the interval ends before it starts.
    """
    begin, end = _cut(records, start_ns, end_ns)
    later = records[end:].copy()
    later["t_ns"] -= end_ns - start_ns
    return _joined(records[:begin], later)


@overload
def kidnapped(recording: Recording, start_ns: int, end_ns: int) -> Recording: ...


@overload
def kidnapped(recording: EventRecording, start_ns: int, end_ns: int) -> EventRecording: ...


def kidnapped(
    recording: Recording | EventRecording, start_ns: int, end_ns: int
) -> Recording | EventRecording:
    """A recording from which an interval (IMU clock) is skipped in all sensors; ground truth likewise.

    Tracks do not survive it: what follows bears new ids, as those of a tracker that starts again.

    Raises:
        SimulationError: the interval ends before it starts.
    """
    truth = recording.ground_truth
    if truth is not None:
        keep = (truth.t_ns < start_ns) | (truth.t_ns >= end_ns)
        t_ns = np.where(truth.t_ns >= end_ns, truth.t_ns - (end_ns - start_ns), truth.t_ns)[keep]
        truth = PoseTrajectory(t_ns, truth.position[keep], truth.quaternion[keep])
    gyroscope = skipped(recording.gyroscope, start_ns, end_ns)
    accelerometer = skipped(recording.accelerometer, start_ns, end_ns)
    if isinstance(recording, EventRecording):
        shift_ns = recording.calibration.timeshift_ns if recording.calibration else 0
        events = skipped(recording.events, start_ns - shift_ns, end_ns - shift_ns)
        return replace(
            recording, events=events, gyroscope=gyroscope, accelerometer=accelerometer, ground_truth=truth
        )
    observations = skipped(recording.observations, start_ns, end_ns)
    observations["id"][observations["t_ns"] >= start_ns] += recording.observations["id"].max(initial=0) + 1
    return replace(
        recording,
        observations=observations,
        gyroscope=gyroscope,
        accelerometer=accelerometer,
        ground_truth=truth,
    )


def without_bias(records: RecordArray, bias: FloatArray) -> RecordArray:
    """Inertial samples (N,) less their biases (N,3): what a sensor without bias would have read."""
    return _with_readings(records, records["xyz"] - bias)


def _merged(events: RecordArray, t_ns: IntArray, pixel: IntArray, p: IntArray, width: int) -> RecordArray:
    """Events with others, given by their pixel `y * width + x`, ascending in time."""
    more = np.zeros(t_ns.size, dtype=EVENT_DTYPE)
    more["t_ns"], more["p"] = t_ns, p
    more["y"], more["x"] = np.divmod(pixel, width)
    merged = _joined(events, more)
    return merged[np.argsort(merged["t_ns"], kind="stable")]


def _joined(first: RecordArray, second: RecordArray) -> RecordArray:
    """Both in one array of the layout of the first: `np.concatenate` leaves out the padding of records."""
    out = np.empty(first.size + second.size, dtype=first.dtype)
    out[: first.size], out[first.size :] = first, second
    return out


def _with_readings(records: RecordArray, xyz: FloatArray) -> RecordArray:
    changed = records.copy()
    changed["xyz"] = xyz
    return changed


def _cut(records: RecordArray, start_ns: int, end_ns: int) -> tuple[int, int]:
    if end_ns < start_ns:
        raise SimulationError(f"an interval from {start_ns} to {end_ns} ns; expected an end after its start")
    begin, end = np.searchsorted(records["t_ns"], [start_ns, end_ns])
    return int(begin), int(end)
