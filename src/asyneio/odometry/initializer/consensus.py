# SPDX-License-Identifier: Apache-2.0
"""IMU-aided MSAC pre-filter of the tracks before a segment is initialized."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.initialization.alignment import AlignmentData
from asyneio.initialization.consensus import BiasEffect, find_consensus
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.propagation import propagate
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Tracks are compared over spans of this duration [s] that overlap by half: long enough for an object at
#: walking pace to move relative to the scene, short enough for the drift of a consumer IMU to be negligible.
_SPAN_S = 1.0
_SHORTEST_SPAN_S = 0.5
#: Iterations; each corrects the gyroscope's bias, which makes the next test sharper.
_ITERATIONS = 3
#: Step of the numerical derivative with respect to that bias [rad/s].
_BIAS_STEP = 1e-4


class _Span(NamedTuple):
    """A tested span: its start and end [ns], the ids of its outliers, and the gyroscope bias (3,) [rad/s]."""

    first_ns: int
    last_ns: int
    outliers: IntArray
    gyroscope_bias: FloatArray


class TrackConsensus:
    """What the IMU and most tracks of a segment agree on, in each of its spans.

    Every span is tested once: the attempts to initialize of a segment share an object, and each tests what is
    new.
    """

    def __init__(self) -> None:
        self._spans: list[_Span] = []
        self._tested_ns = np.iinfo(np.int64).min

    @property
    def gyroscope_bias(self) -> FloatArray:
        """Median (3,) over the spans [rad/s]; zero where no span has a consensus."""
        if not self._spans:
            return np.zeros(3)
        return np.asarray(np.median([span.gyroscope_bias for span in self._spans], axis=0))

    def update(
        self,
        buffer: MeasurementBuffer,
        T_b_c: FloatArray,
        gravity: float,
        bearing_sigma: float,
        gyroscope_sigma: float,
    ) -> IntArray:
        """Test the spans that end after those tested before.

        Args:
            buffer: measurements of the segment.
            T_b_c: (4,4) maps camera to body coordinates.
            gravity: its magnitude [m/s^2].
            bearing_sigma: standard deviation of a bearing [rad].
            gyroscope_sigma: standard deviation of the gyroscope's uncorrected bias [rad/s].

        Returns:
            Ids of the tracks that contradict the motion on which the IMU and most tracks of a new span agree,
            ascending.
        """
        none = np.empty(0, dtype=np.int64)
        seen = buffer.observations
        if min(len(buffer.gyroscope), len(buffer.accelerometer)) < 2 or len(seen.t_ns) == 0:
            return none
        starts = (buffer.gyroscope["t_ns"][0], buffer.accelerometer["t_ns"][0], seen.t_ns[0])
        ends = (buffer.gyroscope["t_ns"][-1], buffer.accelerometer["t_ns"][-1], seen.t_ns[-1])
        start_ns, end_ns = int(max(starts)), int(min(ends))
        self._spans = [span for span in self._spans if span.first_ns >= start_ns]
        found = [none]
        for span_ns in _spans(start_ns, end_ns, self._tested_ns):
            part = seen.between(span_ns[0] - 1, span_ns[1])
            if len(part.t_ns) == 0:
                continue
            span = _tested(buffer, part, span_ns, T_b_c, gravity, bearing_sigma, gyroscope_sigma)
            if span is not None:
                self._spans.append(span)
                found.append(span.outliers)
        self._tested_ns = end_ns
        return np.unique(np.concatenate(found))


def _spans(start_ns: int, end_ns: int, tested_ns: int) -> list[tuple[int, int]]:
    """Spans between two times, from the newest back, that end after `tested_ns`.

    They overlap by half, the earliest two by more. A shorter one is used only where there is no more: an
    object with a third of the tracks was the majority in 0.6 s.
    """
    length_ns = round(_SPAN_S * NS_PER_S)
    spans: list[tuple[int, int]] = []
    first_ns = end_ns - length_ns
    while True:
        first_ns = max(first_ns, start_ns)
        last_ns = min(first_ns + length_ns, end_ns)
        if last_ns <= tested_ns or last_ns - first_ns < _SHORTEST_SPAN_S * NS_PER_S:
            return spans
        spans.append((first_ns, last_ns))
        if first_ns == start_ns:
            return spans
        first_ns -= length_ns // 2


def _tested(
    buffer: MeasurementBuffer,
    seen: TrackObservations,
    span_ns: tuple[int, int],
    T_b_c: FloatArray,
    gravity: float,
    bearing_sigma: float,
    gyroscope_sigma: float,
) -> _Span | None:
    """The consensus within one span; None without one."""
    first_ns, last_ns = span_ns
    bias = np.zeros(3)
    agreeing = None
    sigma = gyroscope_sigma
    for _ in range(_ITERATIONS):
        data, ids = alignment_data(buffer, seen, first_ns, T_b_c, bias)
        moved = [
            alignment_data(buffer, seen, first_ns, T_b_c, bias + _BIAS_STEP * axis)[0] for axis in np.eye(3)
        ]
        effect = BiasEffect(
            np.stack([(m.direction - data.direction) / _BIAS_STEP for m in moved], axis=2),
            np.stack([(m.offset - data.offset) / _BIAS_STEP for m in moved], axis=2),
        )
        consensus = find_consensus(data, effect, gravity, bearing_sigma, sigma)
        if consensus.gyroscope_bias is None:
            break
        agreeing = consensus.agreeing
        # The bias from the rays depends on distances that are still inaccurate.
        sigma = max(consensus.gyroscope_sigma, 0.5 * sigma)
        bias = bias + consensus.gyroscope_bias
    return None if agreeing is None else _Span(first_ns, last_ns, ids[~agreeing], bias)


def alignment_data(
    buffer: MeasurementBuffer,
    seen: TrackObservations,
    first_ns: int,
    T_b_c: FloatArray,
    bias_gyroscope: FloatArray,
) -> tuple[AlignmentData, IntArray]:
    """Rays of the observations from `first_ns` on, as input of the alignment, and ids (L,) of their
    tracks."""
    zero = np.zeros(3)
    times = np.union1d([first_ns], seen.t_ns)
    bias = np.concatenate([bias_gyroscope, zero])
    start = (np.eye(3), zero, zero)
    free = propagate(buffer.gyroscope, buffer.accelerometer, bias, start, times, zero)
    at = free.at(seen.t_ns)
    rays = np.column_stack([seen.xy, np.ones(len(seen.xy))])
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ T_b_c[:3, :3].T
    ids, track = np.unique(seen.track, return_inverse=True)
    data = AlignmentData(
        t=np.asarray((seen.t_ns - first_ns) * 1e-9),
        direction=np.einsum("nij,nj->ni", free.C[at], rays),
        offset=free.r[at] + free.C[at] @ T_b_c[:3, 3],
        track=track,
        tracks=len(ids),
    )
    return data, ids
