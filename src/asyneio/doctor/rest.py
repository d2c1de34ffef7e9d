"""Where in a recording do the inertial sensors lie still?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.inertial.stillness import (
    LEAST_DENSITY,
    LEAST_SCATTER,
    Stillness,
    deviation,
    measure_stillness,
    shakes,
)
from asyneio.io.inertial_files import InertialStreams

#: Rest is sought in spans of this length, in a shorter recording in the whole, but never in less than the
#: second; means stray by at most so many standard deviations in it.
_SPAN_NS, _SHORTEST_NS = 500_000_000, 100_000_000
_SIGMAS = 4.0
#: A mean turn rate above which nothing is at rest [rad/s].
_MOST_OFFSET = 0.1


@dataclass(frozen=True)
class Rest:
    """Spans in which both sensors lay still, of how many, and what they read there."""

    spans: int
    gyroscope: tuple[Stillness, ...]
    accelerometer: tuple[Stillness, ...]

    @property
    def still(self) -> int:
        """Number of spans at rest."""
        return len(self.gyroscope)

    @property
    def throughout(self) -> bool:
        """Whether all of the recording is at rest."""
        return 0 < self.spans == self.still


def find_rest(streams: InertialStreams) -> Rest:
    """Look at all half seconds in which both sensors have samples."""
    if min(streams.gyroscope.size, streams.accelerometer.size) < 2:
        return Rest(0, (), ())
    first = max(int(rows["t_ns"][0]) for rows in (streams.gyroscope, streams.accelerometer))
    last = min(int(rows["t_ns"][-1]) for rows in (streams.gyroscope, streams.accelerometer))
    span_ns = min(_SPAN_NS, last - first)
    if span_ns < _SHORTEST_NS:
        return Rest(0, (), ())
    starts = range(first, last - span_ns + 1, span_ns)
    pairs = [
        tuple(
            measure_stillness(rows["t_ns"], rows["xyz"], start, start + span_ns)
            for rows in (streams.gyroscope, streams.accelerometer)
        )
        for start in starts
    ]
    still = [
        (rate, force)
        for rate, force in pairs
        if rate is not None
        and force is not None
        and float(np.linalg.norm(rate.mean)) < _MOST_OFFSET
        and _lies_still(rate, 0)
        and _lies_still(force, 1)
    ]
    return Rest(len(starts), tuple(rate for rate, _ in still), tuple(force for _, force in still))


def _lies_still(found: Stillness, sensor: int) -> bool:
    density = max(LEAST_DENSITY[sensor], float(found.scatter.max() * np.sqrt(found.period_s)))
    return deviation(found, found.mean, density) < _SIGMAS and not shakes(
        found, LEAST_DENSITY[sensor], LEAST_SCATTER[sensor]
    )
