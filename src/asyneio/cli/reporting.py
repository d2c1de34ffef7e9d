"""From a run to what the report shows: errors with the estimator's bounds, tracks alive, time per step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.evaluation import AlignmentKind, Association, Evaluation, Similarity, align, associate
from asyneio.io import to_trajectory
from asyneio.io.estimates_file import stack_estimates
from asyneio.packets import usable_span
from asyneio.pipeline import RunResult
from asyneio.types import (
    NS_PER_S,
    STATE_BLOCKS,
    Estimate,
    EventRecording,
    FloatArray,
    Health,
    IntArray,
    RecordArray,
    Recording,
)
from asyneio.viz import Comparison, Features, HealthTimeline, ReportData, Series, Timing


class KnownState(Protocol):
    """True states at N times, as a simulation knows them: all (N,3), SI, velocity in the truth's world."""

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
    interval_s: float,
    scores: dict[int, Evaluation],
    known: KnownStates | None = None,
) -> ReportData:
    """Everything the report plots; there must be at least one estimate.

    Args:
        result: the run.
        recording: what was run.
        interval_s: time between knots, the budget of one step.
        scores: comparison of segments with the ground truth, by number; none where there is none.
        known: true velocity and biases at given times, None where they are not known.
    """
    start_ns = usable_span(recording)[0]
    segments = result.run.segments()
    parts = [_segment_data(result, recording, segment, scores, start_ns, known) for segment in segments]
    comparisons = [part.comparison for part in parts if part.comparison]
    reports = result.run.reports
    stamps = np.array([report.t_ns for report in reports], dtype=np.int64)
    t_s = (stamps - start_ns) / NS_PER_S
    names = tuple(map(str, Health))
    return ReportData(
        paths=tuple(part.position for part in parts),
        health=HealthTimeline(
            t_s,
            np.array([names.index(report.health) for report in reports], dtype=np.int64),
            np.array([report.segment for report in reports], dtype=np.int64),
            names,
        ),
        velocity=_joined([part.velocity for part in parts]),
        bias_gyroscope=_joined([part.bias_gyroscope for part in parts]),
        bias_accelerometer=_joined([part.bias_accelerometer for part in parts]),
        features=count_features(result.observations, stamps, start_ns),
        timing=Timing(t_s, np.array([report.seconds for report in reports]), interval_s),
        notes=recording.notes,
        comparison=_joined_comparisons(comparisons) if comparisons else None,
    )


@dataclass(frozen=True)
class _SegmentData:
    """What the report shows of one segment."""

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
    comparison, R = _compare(estimates, origin, recording, score, start_ns)
    truth = known(t_ns) if known else None
    velocity = Series(
        t_s, states["velocity_w"] @ R.T, _velocity_sigma(states, R), truth.velocity_w if truth else None
    )
    return _SegmentData(
        states["T_w_b"][:, :3, 3],
        velocity,
        _bias(states, "bias_gyroscope", t_s, truth.bias_gyroscope if truth else None),
        _bias(states, "bias_accelerometer", t_s, truth.bias_accelerometer if truth else None),
        comparison,
    )


def _joined(parts: Sequence[Series]) -> Series:
    """One series, with a row that is not finite between two segments: no line joins them."""
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


def count_features(observations: RecordArray, t_ns: IntArray, start_ns: int) -> Features:
    """Tracks alive at each time (first observation passed, last not yet), and the quartiles of their ages."""
    order = np.lexsort((observations["t_ns"], observations["id"]))
    ids, stamps = observations["id"][order], observations["t_ns"][order]
    heads = np.flatnonzero(np.r_[True, ids[1:] != ids[:-1]])
    first, last = stamps[heads], stamps[np.r_[heads[1:], ids.size] - 1]
    alive = np.zeros(t_ns.size, dtype=np.int64)
    age_s = np.full((t_ns.size, 3), np.nan)
    for index, now in enumerate(t_ns.tolist()):
        ages = now - first[(first <= now) & (now <= last)]
        alive[index] = ages.size
        if ages.size:
            age_s[index] = np.percentile(ages, [25.0, 50.0, 75.0]) / NS_PER_S
    return Features((t_ns - start_ns) / NS_PER_S, alive, age_s)


def _compare(
    estimates: list[Estimate],
    origin: Estimate | None,
    recording: Recording | EventRecording,
    score: Evaluation | None,
    start_ns: int,
) -> tuple[Comparison | None, FloatArray]:
    """The comparison of one segment, and the rotation (3,3) from its world to the truth's.

    The covariance speaks of errors relative to the knot that defines the segment's world. So they are taken
    from there, or from the first estimate that the truth covers.
    """
    if score is None or recording.ground_truth is None:
        return None, np.eye(3)
    with_origin = [origin, *estimates] if origin and origin.t_ns < estimates[0].t_ns else estimates
    matched = associate(to_trajectory(with_origin), recording.ground_truth)
    alignment = align(AlignmentKind.ORIGIN, matched.estimate, matched.truth)
    position_error, orientation_error = _errors(estimates, matched, alignment, start_ns)
    comparison = Comparison(
        position_estimate=score.position_estimate_w,
        position_truth=score.position_truth_w,
        position_error=position_error,
        orientation_error=orientation_error,
    )
    return comparison, alignment.R


def _errors(
    estimates: list[Estimate], matched: Association, alignment: Similarity, start_ns: int
) -> tuple[Series, Series]:
    """Errors of position [m, world axes] and orientation [deg, body axes] at the estimates, with sigmas."""
    t_ns = np.array([estimate.t_ns for estimate in estimates])
    index = np.minimum(np.searchsorted(t_ns, matched.t_ns), t_ns.size - 1)
    # The origin took part in the alignment only.
    kept = t_ns[index] == matched.t_ns
    covariance = stack_estimates(estimates)["covariance"][index[kept]]
    aligned = alignment.apply(matched.estimate)
    C = aligned.C[kept]
    offset = (aligned.position - matched.truth.position)[kept]
    turn = Rotation.from_matrix(np.swapaxes(matched.truth.C[kept], 1, 2) @ C).as_rotvec()
    t_s = (matched.t_ns[kept] - start_ns) / NS_PER_S
    return (
        Series(t_s, offset, _sigma(C @ _block(covariance, "rho", "rho") @ np.swapaxes(C, 1, 2))),
        Series(t_s, np.rad2deg(turn), np.rad2deg(_sigma(_block(covariance, "phi", "phi")))),
    )


def _velocity_sigma(states: dict[str, FloatArray], R: FloatArray) -> FloatArray:
    """Of the world velocity `C nu`: the error is `C (d nu + phi^ nu)`, with `phi^ nu = -nu^ phi`."""
    C = states["T_w_b"][:, :3, :3]
    nu = np.einsum("nji,nj->ni", C, states["velocity_w"])
    # Row i is nu x e_i, column i of nu^; the transpose of a skew matrix is its negative.
    minus_nu_hat = np.cross(nu[:, None, :], np.eye(3))
    jacobian = R @ C @ np.concatenate([minus_nu_hat, np.broadcast_to(np.eye(3), C.shape)], axis=2)
    phi, rate = _slice("phi"), _slice("nu")
    wanted = np.r_[phi, rate]
    covariance = states["covariance"][:, wanted[:, None], wanted]
    return _sigma(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2))


def _bias(states: dict[str, FloatArray], name: str, t_s: FloatArray, truth: FloatArray | None) -> Series:
    return Series(t_s, states[name], _sigma(_block(states["covariance"], name, name)), truth)


def _slice(name: str) -> IntArray:
    start = 3 * STATE_BLOCKS.index(name)
    return np.arange(start, start + 3)


def _block(covariance: FloatArray, rows: str, columns: str) -> FloatArray:
    return covariance[:, _slice(rows)[:, None], _slice(columns)]


def _sigma(covariance: FloatArray) -> FloatArray:
    """Standard deviations (N,3) of covariances (N,3,3); rounding may leave a variance of -1e-20."""
    return np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0))
