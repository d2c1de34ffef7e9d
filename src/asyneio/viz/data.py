"""What a report shows, as plain arrays: no estimator, no files, no ground-truth logic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.types import FloatArray, IntArray
from asyneio.viz.tracks import TrackScene

Rows = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Series:
    """A vector over time: `t_s` (N,), `value` (N,3), `sigma` (N,3) standard deviations in the same unit.

    `truth` (N,3) where it is known. A row that is not finite parts two segments.
    """

    t_s: FloatArray
    value: FloatArray
    sigma: FloatArray
    truth: FloatArray | None = None

    def scaled(self, factor: float) -> Series:
        """The same in a unit that is smaller by a factor."""
        truth = None if self.truth is None else factor * self.truth
        return Series(self.t_s, factor * self.value, factor * self.sigma, truth)


@dataclass(frozen=True)
class Comparison:
    """An estimate beside ground truth; segments are aligned each on its own and parted as in `Series`.

    `position_estimate` and `position_truth` (N,3) [m] in the world of the truth, aligned. `position_error`
    [m, world axes] and `orientation_error` [deg, body axes] are relative to the first estimate, as their
    sigmas are.
    """

    position_estimate: FloatArray
    position_truth: FloatArray
    position_error: Series
    orientation_error: Series


@dataclass(frozen=True)
class States:
    """What was estimated: `paths`, (N,3) [m] each, of the segments in worlds of their own; velocity in m/s,
    biases in rad/s and m/s^2, over all segments."""

    paths: tuple[FloatArray, ...]
    velocity: Series
    bias_gyroscope: Series
    bias_accelerometer: Series


@dataclass(frozen=True)
class Features:
    """Feature tracks over time: `t_s` (N,), `alive` (N,) how many, `age_s` (N,3) quartiles of their ages."""

    t_s: FloatArray
    alive: IntArray
    age_s: FloatArray


@dataclass(frozen=True)
class EventRate:
    """Events over time: `t_s` (N,) and `rate` (N,) [events/s] of the packet that ended there."""

    t_s: FloatArray
    rate: FloatArray


@dataclass(frozen=True)
class Timing:
    """Processing time of each step: `t_s` (N,), `step_s` (N,), against the `interval_s` one may take."""

    t_s: FloatArray
    step_s: FloatArray
    interval_s: float


@dataclass(frozen=True)
class HealthChange:
    """From `t_s` on the estimator was in `state`, in so-numbered a segment, and said why."""

    t_s: float
    state: str
    segment: int
    reason: str


@dataclass(frozen=True)
class HealthTimeline:
    """State of the estimator at each step: `t_s` (N,), `state` (N,) index into `names`, `segment` (N,); and
    its changes in words."""

    t_s: FloatArray
    state: IntArray
    segment: IntArray
    names: tuple[str, ...]
    changes: tuple[HealthChange, ...] = ()


@dataclass(frozen=True)
class ReportData:
    """One run; times count from the start of the recording.

    `states` is None where nothing was estimated, `comparison` where no truth is known, `events` for a
    recording of tracks; so is `scene`, the tracks over their events. `settings` are name and value of those
    that differ from the defaults, `failure` says why the trajectory is not whole.
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
    """Rows of (N,3) that hold numbers a picture can show: what diverged beyond a million km has none."""
    return position[(np.isfinite(position) & (np.abs(position) < 1e9)).all(axis=1)]
