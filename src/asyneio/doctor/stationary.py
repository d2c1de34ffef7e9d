"""Where in a recording do the inertial sensors lie still?"""

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

#: Rest is sought in spans of this length, in a shorter recording in the whole, but never in less than the
#: second; means stray by at most so many standard deviations in it.
_SPAN_NS, _SHORTEST_NS = 500_000_000, 100_000_000
_SIGMAS = 4.0
#: A mean turn rate above which nothing is at rest [rad/s].
_MOST_OFFSET = 0.1
#: What a steady hand does: mean turn rate, its changes, and those of the specific force [rad/s, m/s^2].
_STEADY_RATE, _STEADY_TURN, _STEADY_PUSH = 0.15, 0.05, 0.15


@dataclass(frozen=True)
class Rest:
    """Spans in which both sensors lay still, of how many, and what they read there.

    `force` [m/s^2] is the magnitude of the mean specific force at rest, in the stillest span where none is at
    rest but a hand held it steady, else None.
    """

    spans: int
    gyroscope: tuple[Stationarity, ...]
    accelerometer: tuple[Stationarity, ...]
    force: float | None = None

    @property
    def still(self) -> int:
        """Number of spans at rest."""
        return len(self.gyroscope)

    @property
    def throughout(self) -> bool:
        """Whether all of the recording is at rest."""
        return 0 < self.spans == self.still


Pairs = list[tuple[Stationarity | None, Stationarity | None]]


def find_rest(streams: InertialStreams) -> Rest:
    """Look at all half seconds in which both sensors have samples."""
    if min(streams.gyroscope.size, streams.accelerometer.size) < 2:
        return Rest(0, (), ())
    rate, force = streams.gyroscope, streams.accelerometer
    first = max(int(rows["t_ns"][0]) for rows in (rate, force))
    last = min(int(rows["t_ns"][-1]) for rows in (rate, force))
    span_ns = min(_SPAN_NS, last - first)
    if span_ns < _SHORTEST_NS:
        return Rest(0, (), ())
    # Only those with samples in them: stamps may be years apart.
    numbers = np.unique((rate["t_ns"] - first) // span_ns)
    starts = (first + numbers[(numbers >= 0) & (first + (numbers + 1) * span_ns <= last)] * span_ns).tolist()
    pairs: Pairs = [
        (
            measure_stationarity(rate["t_ns"], rate["xyz"], start, start + span_ns),
            measure_stationarity(force["t_ns"], force["xyz"], start, start + span_ns),
        )
        for start in starts
    ]
    still = [
        (turn, push)
        for turn, push in pairs
        if turn is not None
        and push is not None
        and float(np.linalg.norm(turn.mean)) < _MOST_OFFSET
        and _lies_still(turn, 0)
        and _lies_still(push, 1)
    ]
    return Rest(
        len(starts),
        tuple(rate for rate, _ in still),
        tuple(force for _, force in still),
        _gravity(still or _steadiest(pairs)),
    )


def _steadiest(pairs: Pairs) -> list[tuple[Stationarity, Stationarity]]:
    """The span in which the specific force changes least, if a hand held the sensor steady in it."""
    steady = [
        (rate, force)
        for rate, force in pairs
        if rate is not None
        and force is not None
        and float(np.linalg.norm(rate.mean)) < _STEADY_RATE
        and rate.bins.std(axis=0).max() < _STEADY_TURN
        and force.bins.std(axis=0).max() < _STEADY_PUSH
    ]
    return [min(steady, key=lambda pair: float(pair[1].bins.std(axis=0).max()))] if steady else []


def _gravity(still: list[tuple[Stationarity, Stationarity]]) -> float | None:
    """Median over spans of the magnitude of the mean specific force [m/s^2]."""
    return float(np.median([np.linalg.norm(force.mean) for _, force in still])) if still else None


def _lies_still(found: Stationarity, sensor: int) -> bool:
    density = max(LEAST_DENSITY[sensor], float(found.scatter.max() * np.sqrt(found.period_s)))
    return deviation(found, found.mean, density) < _SIGMAS and not shakes(
        found, LEAST_DENSITY[sensor], LEAST_SCATTER[sensor]
    )
