# SPDX-License-Identifier: Apache-2.0
"""The interface of this package: the contents of a report as plain arrays.

The caller computes these from a run; the plots need no estimator, no files and no alignment with ground
truth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.types import FloatArray, IntArray
from asyneio.viz.tracks import TrackScene

Rows = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Series:
    """A vector over time: `t_s` (N,), `value` (N,3), `sigma` (N,3) standard deviations in the same unit.

    `truth` (N,3) is the ground truth, if known. A row that is not finite separates two segments.
    """

    t_s: FloatArray
    value: FloatArray
    sigma: FloatArray
    truth: FloatArray | None = None

    def scaled(self, factor: float) -> Series:
        """The same series in a unit that is smaller by a factor."""
        truth = None if self.truth is None else factor * self.truth
        return Series(self.t_s, factor * self.value, factor * self.sigma, truth)


@dataclass(frozen=True)
class Comparison:
    """An estimate and its ground truth; segments are aligned individually and separated as in `Series`.

    `position_estimate` and `position_truth` (N,3) [m] are aligned, in the world of the ground truth.
    `position_error` [m, world axes] and `orientation_error` [deg, body axes] are relative to the first
    estimate, like their sigmas.
    """

    position_estimate: FloatArray
    position_truth: FloatArray
    position_error: Series
    orientation_error: Series


@dataclass(frozen=True)
class States:
    """Estimated states: `paths`, (N,3) [m] each, of the segments in their own worlds; velocity [m/s] and
    biases [rad/s, m/s^2] over all segments."""

    paths: tuple[FloatArray, ...]
    velocity: Series
    bias_gyroscope: Series
    bias_accelerometer: Series


@dataclass(frozen=True)
class Features:
    """Feature tracks over time: `t_s` (N,), number of live tracks `alive` (N,), quartiles of their ages
    `age_s` (N,3)."""

    t_s: FloatArray
    alive: IntArray
    age_s: FloatArray


@dataclass(frozen=True)
class EventRate:
    """Event rate over time: `t_s` (N,), and `rate` (N,) [events/s] of the packet that ends then."""

    t_s: FloatArray
    rate: FloatArray


@dataclass(frozen=True)
class Timing:
    """Processing time of each step: `t_s` (N,), `step_s` (N,), and its real-time limit `interval_s`."""

    t_s: FloatArray
    step_s: FloatArray
    interval_s: float


@dataclass(frozen=True)
class HealthChange:
    """A change of health: from `t_s` on, the estimator is in `state` in this segment, for this reason."""

    t_s: float
    state: str
    segment: int
    reason: str


@dataclass(frozen=True)
class HealthTimeline:
    """Health of the estimator at each step: `t_s` (N,), `state` (N,) index into `names`, `segment` (N,); and
    its changes with reasons."""

    t_s: FloatArray
    state: IntArray
    segment: IntArray
    names: tuple[str, ...]
    changes: tuple[HealthChange, ...] = ()


@dataclass(frozen=True)
class ReportData:
    """A run; times are relative to the start of the recording.

    `states` is None without estimates, `comparison` without ground truth; `events` and `scene` (the tracks
    over their events) are None for a recording of tracks. `settings` are names and values of settings that
    differ from the defaults. `failure` is the reason for an incomplete trajectory.
    """

    health: HealthTimeline
    features: Features
    timing: Timing
    states: States | None = None
    comparison: Comparison | None = None
    events: EventRate | None = None
    scene: TrackScene | None = None
    settings: Rows = ()
    notes: tuple[str, ...] = ()
    failure: str = ""


def finite_rows(position: FloatArray) -> FloatArray:
    """Rows of (N,3) that can be plotted: finite and within a million km."""
    return position[(np.isfinite(position) & (np.abs(position) < 1e9)).all(axis=1)]
