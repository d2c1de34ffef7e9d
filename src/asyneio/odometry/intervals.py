# SPDX-License-Identifier: Apache-2.0
"""Inertial samples cut by time, and everything that was measured between two knots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.types import NS_PER_S, RecordArray

#: Inertial samples before an interval that are kept to interpolate at its start.
_EARLIER = 4


@dataclass(frozen=True)
class Interval:
    """What was measured between two knots.

    Attributes:
        start_ns: time of the first knot.
        end_ns: time of the second knot.
        gyroscope: gated samples up to `end_ns`, with a few before `start_ns` to interpolate there.
        accelerometer: the same of the accelerometer.
        observations: of the tracks that are not rejected, start < t <= end.
        gap_s: longest time without a sample of one of the sensors, see `sample_gap_s` [s].
        rejected_samples: share of the newest packet's inertial samples that the gates rejected.
        saturated: whether some of those were at the end of the sensor's range.
    """

    start_ns: int
    end_ns: int
    gyroscope: RecordArray
    accelerometer: RecordArray
    observations: TrackObservations
    gap_s: float = 0.0
    rejected_samples: float = 0.0
    saturated: bool = False

    @property
    def streams(self) -> tuple[RecordArray, RecordArray]:
        """Samples of the gyroscope and of the accelerometer."""
        return self.gyroscope, self.accelerometer


def rate_hz(samples: RecordArray) -> float:
    """Median rate of a stream; 1 Hz where there are fewer than two samples."""
    if len(samples) < 2:
        return 1.0
    return 1e9 / float(max(np.median(np.diff(samples["t_ns"])), 1.0))


def sample_gap_s(streams: tuple[RecordArray, RecordArray], start_ns: int, end_ns: int) -> float:
    """Longest time [s] between samples in (start, end], over both streams.

    A gap that began before `start_ns` counts from its beginning, as far as the streams still hold it; a gap
    that has not ended counts up to `end_ns`.
    """
    gaps = []
    for samples in streams:
        stamps = samples["t_ns"]
        a, b = np.searchsorted(stamps, [start_ns, end_ns], side="right")
        before = stamps[a - 1] if a else start_ns
        gaps.append(np.diff(np.r_[before, stamps[a:b], end_ns]).max())
    return float(max(gaps)) / NS_PER_S


def around(samples: RecordArray, start_ns: int, end_ns: int) -> RecordArray:
    """Samples with start < t <= end, and a few earlier ones."""
    return tail(until(samples, end_ns), start_ns)


def until(samples: RecordArray, end_ns: int) -> RecordArray:
    """Samples with t <= end."""
    return samples[: np.searchsorted(samples["t_ns"], end_ns, side="right")]


def tail(samples: RecordArray, t_ns: int) -> RecordArray:
    """Samples with t > t_ns, and a few earlier ones."""
    n = int(np.searchsorted(samples["t_ns"], t_ns, side="right"))
    return samples[max(n - _EARLIER, 0) :]
