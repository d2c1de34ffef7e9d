# SPDX-License-Identifier: Apache-2.0
"""Spans of a recording in which the inertial sensors are stationary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.inertial.stationarity import (
    LEAST_DENSITY,
    LEAST_SCATTER,
    Stationarity,
    deviation,
    measure_stationarity,
    shakes,
)
from asyneio.io.recording.inertial_units import InertialStreams

#: Length of the spans; a shorter recording is one span, of at least the second length.
_SPAN_NS, _SHORTEST_NS = 500_000_000, 100_000_000
#: Maximum deviation of the means within a stationary span, in standard deviations.
_SIGMAS = 4.0
#: Maximum mean angular rate of a stationary span [rad/s].
_MAX_MEAN_RATE = 0.1
#: Limits for a sensor held steadily by hand: mean angular rate and standard deviations of the angular rate
#: [rad/s] and of the specific force [m/s^2].
_HELD_MEAN_RATE, _HELD_RATE_STD, _HELD_FORCE_STD = 0.15, 0.05, 0.15


@dataclass(frozen=True)
class StationarySpans:
    """Spans in which both sensors were stationary.

    Attributes:
        spans: number of spans examined.
        gyroscope: measurements of each stationary span.
        accelerometer: the same.
        force: magnitude of the mean specific force [m/s^2] over the stationary spans; without any, of the
            steadiest span if the sensor was held steadily by hand, else None.
    """

    spans: int
    gyroscope: tuple[Stationarity, ...]
    accelerometer: tuple[Stationarity, ...]
    force: float | None = None

    @property
    def count(self) -> int:
        """Number of stationary spans."""
        return len(self.gyroscope)

    @property
    def throughout(self) -> bool:
        """Whether the whole recording is stationary."""
        return 0 < self.spans == self.count


Pairs = list[tuple[Stationarity | None, Stationarity | None]]


def find_stationary(streams: InertialStreams) -> StationarySpans:
    """Test all half-second spans in which both sensors have samples."""
    if min(streams.gyroscope.size, streams.accelerometer.size) < 2:
        return StationarySpans(0, (), ())
    rates, forces = streams.gyroscope, streams.accelerometer
    first = max(int(rows["t_ns"][0]) for rows in (rates, forces))
    last = min(int(rows["t_ns"][-1]) for rows in (rates, forces))
    span_ns = min(_SPAN_NS, last - first)
    if span_ns < _SHORTEST_NS:
        return StationarySpans(0, (), ())
    # Only spans that contain samples: timestamps may be years apart.
    numbers = np.unique((rates["t_ns"] - first) // span_ns)
    starts = (first + numbers[(numbers >= 0) & (first + (numbers + 1) * span_ns <= last)] * span_ns).tolist()
    pairs: Pairs = [
        (
            measure_stationarity(rates["t_ns"], rates["xyz"], start, start + span_ns),
            measure_stationarity(forces["t_ns"], forces["xyz"], start, start + span_ns),
        )
        for start in starts
    ]
    stationary = [
        (rate, force)
        for rate, force in pairs
        if rate is not None
        and force is not None
        and float(np.linalg.norm(rate.mean)) < _MAX_MEAN_RATE
        and _is_stationary(rate, 0)
        and _is_stationary(force, 1)
    ]
    return StationarySpans(
        len(starts),
        tuple(rate for rate, _ in stationary),
        tuple(force for _, force in stationary),
        _mean_force(stationary or _steadiest(pairs)),
    )


def _steadiest(pairs: Pairs) -> list[tuple[Stationarity, Stationarity]]:
    """The span with the least variation of the specific force among those held steadily by hand, if any."""
    steady = [
        (rate, force)
        for rate, force in pairs
        if rate is not None
        and force is not None
        and float(np.linalg.norm(rate.mean)) < _HELD_MEAN_RATE
        and rate.bins.std(axis=0).max() < _HELD_RATE_STD
        and force.bins.std(axis=0).max() < _HELD_FORCE_STD
    ]
    return [min(steady, key=lambda pair: float(pair[1].bins.std(axis=0).max()))] if steady else []


def _mean_force(spans: list[tuple[Stationarity, Stationarity]]) -> float | None:
    """Median over spans of the magnitude of the mean specific force [m/s^2]."""
    return float(np.median([np.linalg.norm(force.mean) for _, force in spans])) if spans else None


def _is_stationary(found: Stationarity, sensor: int) -> bool:
    density = max(LEAST_DENSITY[sensor], float(found.scatter.max() * np.sqrt(found.period_s)))
    return deviation(found, found.mean, density) < _SIGMAS and not shakes(
        found, LEAST_DENSITY[sensor], LEAST_SCATTER[sensor]
    )
