# SPDX-License-Identifier: Apache-2.0
"""From a run to the data of its report: errors with estimated bounds, live tracks, time of each step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from asyneio.config import Config, differences
from asyneio.evaluation import Evaluation
from asyneio.io.results.estimates import stack_estimates
from asyneio.pipeline.packets import usable_span
from asyneio.pipeline.report_errors import bias_series, compare, velocity_sigma
from asyneio.pipeline.report_streams import count_features, event_rate, health_changes, track_scene
from asyneio.pipeline.run import RunResult
from asyneio.types import (
    NS_PER_S,
    Estimate,
    EventRecording,
    FloatArray,
    Health,
    IntArray,
    Recording,
)
from asyneio.viz import Comparison, HealthTimeline, ReportData, Series, States, Timing


class KnownState(Protocol):
    """True states at N times, from a simulation: all (N,3), velocity in the world of the ground truth."""

    @property
    def velocity_w(self) -> FloatArray:
        """Velocity [m/s]."""

    @property
    def bias_gyroscope(self) -> FloatArray:
        """Gyroscope bias [rad/s]."""

    @property
    def bias_accelerometer(self) -> FloatArray:
        """Accelerometer bias [m/s^2]."""


KnownStates = Callable[[IntArray], KnownState]


def report_data(
    result: RunResult,
    recording: Recording | EventRecording,
    scores: dict[int, Evaluation],
    known: KnownStates | None = None,
) -> ReportData:
    """The data of all plots of the report.

    Args:
        result: the run.
        recording: the recording of the run.
        scores: evaluation of each segment by its number; empty without ground truth.
        known: true velocity and biases at given times; None if unknown.
    """
    start_ns, interval_s = usable_span(recording)[0], result.config.window.knot_interval_s
    reports = result.run.reports
    stamps = np.array([report.t_ns for report in reports], dtype=np.int64)
    t_s = (stamps - start_ns) / NS_PER_S
    names = tuple(map(str, Health))
    with_events = recording if isinstance(recording, EventRecording) else None
    states, comparison = _estimated(result, recording, scores, start_ns, known)
    return ReportData(
        health=HealthTimeline(
            t_s,
            np.array([names.index(report.health) for report in reports], dtype=np.int64),
            np.array([report.segment for report in reports], dtype=np.int64),
            names,
            health_changes(result.summary.transitions),
        ),
        features=count_features(result.observations, stamps, start_ns),
        timing=Timing(t_s, np.array([report.seconds for report in reports]), interval_s),
        states=states,
        comparison=comparison,
        events=event_rate(with_events, stamps, start_ns, interval_s) if with_events else None,
        scene=track_scene(with_events, result.observations) if with_events else None,
        settings=_changed(result.config),
        notes=result.summary.notes,
        failure=result.summary.failure,
    )


def _estimated(
    result: RunResult,
    recording: Recording | EventRecording,
    scores: dict[int, Evaluation],
    start_ns: int,
    known: KnownStates | None,
) -> tuple[States | None, Comparison | None]:
    """Estimated states of all segments, joined; None without estimates."""
    segments = result.run.segments()
    parts = [_segment_data(result, recording, segment, scores, start_ns, known) for segment in segments]
    if not parts:
        return None, None
    comparisons = [part.comparison for part in parts if part.comparison]
    states = States(
        tuple(part.position for part in parts),
        _joined([part.velocity for part in parts]),
        _joined([part.bias_gyroscope for part in parts]),
        _joined([part.bias_accelerometer for part in parts]),
    )
    return states, _joined_comparisons(comparisons) if comparisons else None


@dataclass(frozen=True)
class _SegmentData:
    """Data of one segment."""

    position: FloatArray
    velocity: Series
    bias_gyroscope: Series
    bias_accelerometer: Series
    comparison: Comparison | None


def _segment_data(
    result: RunResult,
    recording: Recording | EventRecording,
    estimates: list[Estimate],
    scores: dict[int, Evaluation],
    start_ns: int,
    known: KnownStates | None,
) -> _SegmentData:
    number = estimates[0].segment
    t_ns = np.array([estimate.t_ns for estimate in estimates], dtype=np.int64)
    t_s = (t_ns - start_ns) / NS_PER_S
    states = stack_estimates(estimates)
    origin, score = result.origin_of(number), scores.get(number)
    comparison, R = compare(estimates, origin, recording, score, start_ns)
    truth = known(t_ns) if known else None
    velocity = Series(
        t_s, states["velocity_w"] @ R.T, velocity_sigma(states, R), truth.velocity_w if truth else None
    )
    return _SegmentData(
        states["T_w_b"][:, :3, 3],
        velocity,
        bias_series(states, "bias_gyroscope", t_s, truth.bias_gyroscope if truth else None),
        bias_series(states, "bias_accelerometer", t_s, truth.bias_accelerometer if truth else None),
        comparison,
    )


def _joined(parts: Sequence[Series]) -> Series:
    """One series with a NaN row between segments, so that no line joins them."""
    truths = [part.truth for part in parts if part.truth is not None]
    return Series(
        _stacked([part.t_s for part in parts]),
        _stacked([part.value for part in parts]),
        _stacked([part.sigma for part in parts]),
        _stacked(truths) if truths else None,
    )


def _joined_comparisons(parts: Sequence[Comparison]) -> Comparison:
    return Comparison(
        _stacked([part.position_estimate for part in parts]),
        _stacked([part.position_truth for part in parts]),
        _joined([part.position_error for part in parts]),
        _joined([part.orientation_error for part in parts]),
    )


def _stacked(parts: Sequence[FloatArray]) -> FloatArray:
    gap = np.full((1, *parts[0].shape[1:]), np.nan)
    return np.concatenate([piece for part in parts for piece in (gap, part)][1:])


def _changed(config: Config) -> tuple[tuple[str, str], ...]:
    """Settings that differ from the defaults, with their values."""
    found = differences(config, Config())
    return tuple((name, f"{value} (default: {usual})") for name, (value, usual) in found.items())
