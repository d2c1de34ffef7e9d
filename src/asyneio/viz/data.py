"""What a report shows, as plain arrays: no estimator, no files, no ground-truth logic."""

from __future__ import annotations

from dataclasses import dataclass

from asyneio.types import FloatArray, IntArray


@dataclass(frozen=True)
class Series:
    """A vector over time: `t_s` (N,), `value` (N,3), `sigma` (N,3) standard deviations in the same unit.

    `truth` (N,3) where it is known. A row that is not finite parts two segments.
    """

    t_s: FloatArray
    value: FloatArray
    sigma: FloatArray
    truth: FloatArray | None = None


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
class Features:
    """Feature tracks over time: `t_s` (N,), `alive` (N,) how many, `age_s` (N,3) quartiles of their ages."""

    t_s: FloatArray
    alive: IntArray
    age_s: FloatArray


@dataclass(frozen=True)
class Timing:
    """Processing time of each step: `t_s` (N,), `step_s` (N,), against the `interval_s` one may take."""

    t_s: FloatArray
    step_s: FloatArray
    interval_s: float


@dataclass(frozen=True)
class HealthTimeline:
    """State of the estimator at each step: `t_s` (N,), `state` (N,) index into `names`, `segment` (N,)."""

    t_s: FloatArray
    state: IntArray
    segment: IntArray
    names: tuple[str, ...]


@dataclass(frozen=True)
class ReportData:
    """One run. Times count from the start of the recording; biases in rad/s and m/s^2.

    `paths`, (N,3) [m] each, are those of the segments in worlds of their own, shown where there is no
    comparison.
    """

    paths: tuple[FloatArray, ...]
    health: HealthTimeline
    velocity: Series
    bias_gyroscope: Series
    bias_accelerometer: Series
    features: Features
    timing: Timing
    notes: tuple[str, ...] = ()
    comparison: Comparison | None = None
