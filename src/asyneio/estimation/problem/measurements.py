# SPDX-License-Identifier: Apache-2.0
"""Measurements of the window: raw records in, arrays sorted by interval out, without loops in Python.

Knots have absolute numbers that do not change while the window slides; an interval has the number of its
first knot. A measurement at `t` belongs to the interval with t_k < t <= t_{k+1}.
"""

from __future__ import annotations

import numpy as np

from asyneio.errors import EstimationError
from asyneio.estimation.problem.inertial_calibration import SMOOTH_NS, smoothed
from asyneio.estimation.problem.problem import (
    NOTHING_PREINTEGRATED,
    NOTHING_PROPAGATED,
    Inertial,
    Preintegrated,
    Propagated,
    Visual,
)
from asyneio.estimation.problem.propagated_queries import propagated_at, shifted
from asyneio.estimation.problem.schemes import DirectSamples, IntervalInertial
from asyneio.inertial.increments import Preintegration
from asyneio.trajectory.motion_prior import interpolation_weights_many
from asyneio.types import BoolArray, FloatArray, IntArray

#: Propagated poses are computed again when the time offset has changed by this much [s]: a first-order shift
#: neglects half its square times the angular acceleration, 1e-6 rad in violent motion (50 rad/s^2).
_ASK_AGAIN_S = 2e-4


def _weights(
    t_ns: IntArray, start_ns: IntArray, end_ns: IntArray, prior: int
) -> tuple[FloatArray, FloatArray]:
    """Interpolation weights (N,3,5) and the fraction of the interval (N,) at each time."""
    tau = (t_ns - start_ns) * 1e-9
    dt = (end_ns - start_ns) * 1e-9
    out = np.empty((len(tau), 3, 5))
    interpolation_weights_many(tau, dt, prior, out)
    return out, tau / dt


def _with_rows(matrix: FloatArray, rows: FloatArray) -> FloatArray:
    """`matrix` (N,Q) with rows (M,P) appended, the narrower of the two padded with zeros."""
    out = np.zeros((len(matrix) + len(rows), max(matrix.shape[1], rows.shape[1])))
    out[: len(matrix), : matrix.shape[1]] = matrix
    out[len(matrix) :, : rows.shape[1]] = rows
    return out


class InertialBuffer:
    """Samples of one inertial sensor inside the window, on a trajectory with the given motion prior."""

    def __init__(self, prior: int, smooths: bool = False) -> None:
        """`smooths`: whether smoothed values are needed as well."""
        self._prior = prior
        self._smooths = smooths
        self._interval: IntArray = np.empty(0, dtype=np.int64)
        self._value: FloatArray = np.empty((0, 3))
        self._weights: FloatArray = np.empty((0, 3, 5))
        self._alpha: FloatArray = np.empty(0)
        self._t_ns: IntArray = np.empty(0, dtype=np.int64)
        self._root: FloatArray = np.empty((0, 0))
        self._smooth: FloatArray = np.empty((0, 3))

    def append(self, samples: DirectSamples, interval: int, start_ns: int, end_ns: int) -> None:
        """Samples of one interval."""
        n = len(samples.t_ns)
        weights, alpha = _weights(samples.t_ns, np.full(n, start_ns), np.full(n, end_ns), self._prior)
        self._interval = np.concatenate([self._interval, np.full(n, interval)])
        self._value = np.concatenate([self._value, samples.value])
        self._weights = np.concatenate([self._weights, weights])
        self._alpha = np.concatenate([self._alpha, alpha])
        self._t_ns = np.concatenate([self._t_ns, samples.t_ns])
        self._root = _with_rows(self._root, samples.root)
        self._smooth = np.concatenate([self._smooth, samples.value])
        if self._smooths and n:
            self._smooth_near(start_ns)

    def _smooth_near(self, t_ns: int) -> None:
        """Smooth the intervals again that new values after `t_ns` concern."""
        near = int(np.searchsorted(self._t_ns, t_ns - SMOOTH_NS))
        first, last = self._interval[[near, -1]]
        start = np.searchsorted(self._interval, np.arange(first, last + 2))
        self._smooth[start[0] :] = smoothed(start, self._t_ns, self._value)[start[0] :]

    def drop_before(self, interval: int) -> None:
        """Drop the samples of intervals before `interval`, except those that smooth the ones after it."""
        n = int(np.searchsorted(self._interval, interval))
        if self._smooths and n < len(self._t_ns):
            n = int(np.searchsorted(self._t_ns, self._t_ns[n] - 2 * SMOOTH_NS))
        self._interval = self._interval[n:]
        self._value = self._value[n:]
        self._weights = self._weights[n:]
        self._alpha = self._alpha[n:]
        self._t_ns = self._t_ns[n:]
        self._root = self._root[n:]
        self._smooth = self._smooth[n:]

    def arrays(self, first: int, intervals: int) -> Inertial:
        """Arrays for the intervals `first .. first + intervals - 1`."""
        start = np.searchsorted(self._interval, first + np.arange(intervals + 1))
        used = slice(start[0], start[-1])
        columns = self._value, self._weights, self._alpha, self._root, self._smooth
        return Inertial(start - start[0], *(column[used] for column in columns))


class PreintegrationBuffer:
    """Increments of the intervals inside the window; empty under a scheme that has none."""

    def __init__(self) -> None:
        self._entries: dict[int, Preintegrated] = {}
        self._rules: dict[int, Preintegration] = {}

    def append(self, measured: IntervalInertial, interval: int) -> None:
        """Increments of one interval, if it has any.

        Raises:
            EstimationError: their covariance is not positive definite.
        """
        if measured.preintegration is None or measured.covariance is None:
            return
        end = measured.preintegration.end()
        # L^{-1} with covariance L L^T.
        try:
            root = np.linalg.inv(np.linalg.cholesky(measured.covariance))
        except np.linalg.LinAlgError as error:
            raise EstimationError(
                "the covariance of the preintegrated samples is not positive definite; expected samples of "
                "ordinary size: check the recording for corrupt values"
            ) from error
        present = np.ones(1, dtype=np.bool_)
        bias = measured.preintegration.bias[None]
        entry = Preintegrated(present, end.C, end.nu, end.r, end.d_bias, bias, root[None])
        self._entries = {**self._entries, interval: entry}
        self._rules = {**self._rules, interval: measured.preintegration}

    def drop_before(self, interval: int) -> None:
        """Drop the increments of intervals before `interval`."""
        self._entries = {k: entry for k, entry in self._entries.items() if k >= interval}
        self._rules = {k: rule for k, rule in self._rules.items() if k >= interval}

    def rules(self) -> list[Preintegration]:
        """The preintegrations of the intervals, in order."""
        return [self._rules[k] for k in sorted(self._rules)]

    def arrays(self, first: int, intervals: int) -> Preintegrated:
        """Arrays for the intervals `first .. first + intervals - 1`."""
        if not self._entries:
            return NOTHING_PREINTEGRATED
        some = next(iter(self._entries.values()))
        missing = some._replace(present=np.zeros(1, dtype=np.bool_))
        chosen = [self._entries.get(first + i, missing) for i in range(intervals)]
        present, *others = (np.concatenate(parts) for parts in zip(*chosen, strict=True))
        return Preintegrated(present, *others)


class VisualBuffer:
    """Observations inside the window, of tracks with and without a landmark yet; motion prior as above."""

    def __init__(self, prior: int) -> None:
        self._prior = prior
        self.t_ns: IntArray = np.empty(0, dtype=np.int64)
        self.track: IntArray = np.empty(0, dtype=np.int64)
        self.interval: IntArray = np.empty(0, dtype=np.int64)
        self.xy: FloatArray = np.empty((0, 2))
        self.root_information: FloatArray = np.empty((0, 2, 2))
        self.tau: FloatArray = np.empty(0)
        self.dt: FloatArray = np.empty(0)
        self.weights: FloatArray = np.empty((0, 2, 5))
        self.propagated: Propagated = NOTHING_PROPAGATED
        self._asked_offset = 0.0

    def __len__(self) -> int:
        return len(self.t_ns)

    def append(
        self,
        t_ns: IntArray,
        track: IntArray,
        xy: FloatArray,
        root_information: FloatArray,
        interval: int,
        bounds_ns: tuple[int, int],
        propagated: Propagated = NOTHING_PROPAGATED,
        offset: float = 0.0,
    ) -> None:
        """Undistorted observations `xy` (N,2) of one interval that spans `bounds_ns`, and increments at their
        times plus `offset` [s] if the scheme has increments."""
        tau = np.asarray((t_ns - bounds_ns[0]) * 1e-9, dtype=np.float64)
        dt = np.full(len(t_ns), (bounds_ns[1] - bounds_ns[0]) * 1e-9)
        self.t_ns = np.concatenate([self.t_ns, t_ns])
        self.track = np.concatenate([self.track, track])
        self.interval = np.concatenate([self.interval, np.full(len(t_ns), interval)])
        self.xy = np.concatenate([self.xy, xy])
        self.root_information = np.concatenate([self.root_information, root_information])
        self.tau = np.concatenate([self.tau, tau])
        self.dt = np.concatenate([self.dt, dt])
        self.weights = np.concatenate([self.weights, self._weights(tau + offset, dt)])
        both = zip(self.propagated, propagated, strict=True)
        self.propagated = Propagated(*(np.concatenate(pair) for pair in both))

    def keep(self, mask: BoolArray) -> None:
        """Drop the observations outside `mask`."""
        self.t_ns = self.t_ns[mask]
        self.track = self.track[mask]
        self.interval = self.interval[mask]
        self.xy = self.xy[mask]
        self.root_information = self.root_information[mask]
        self.tau = self.tau[mask]
        self.dt = self.dt[mask]
        self.weights = self.weights[mask]
        self.propagated = self.propagated.chosen(mask)

    def move_to(self, offset: float, rules: list[Preintegration], first: int) -> None:
        """Compute poses at the stamps plus another time offset [s].

        `rules` are the preintegrations of the intervals from `first` on if poses are propagated.
        """
        if len(self.propagated.tau) == 0:
            self.weights = self._weights(self.tau + offset, self.dt)
        elif abs(offset - self._asked_offset) < _ASK_AGAIN_S:
            self.propagated = shifted(self.propagated, self.tau + offset)
        else:
            self._asked_offset = offset
            parts = [
                propagated_at(rules[k - first], self.tau[self.interval == k] + offset, with_rates=True)
                for k in np.unique(self.interval)
            ]
            # Observations are stored in the order of their intervals.
            self.propagated = Propagated(*(np.concatenate(some) for some in zip(*parts, strict=True)))

    def _weights(self, tau: FloatArray, dt: FloatArray) -> FloatArray:
        """Interpolation weights (N,2,5) of xi and xi_dot."""
        out = np.empty((len(tau), 3, 5))
        interpolation_weights_many(tau, dt, self._prior, out)
        return np.ascontiguousarray(out[:, :2])

    def arrays(
        self, landmark: IntArray, anchor: IntArray, first: int, intervals: int
    ) -> tuple[Visual, Propagated]:
        """Arrays for the observations with `landmark >= 0`, sorted by interval, anchor and landmark.

        `landmark` (N,) is the index of each observation's landmark, `anchor` (L,) the landmarks' anchors.
        """
        chosen = np.flatnonzero(landmark >= 0)
        mine = landmark[chosen]
        # One key instead of three takes a third of the time.
        key = ((self.interval[chosen] - first) * intervals + (anchor[mine] - first)) * len(anchor) + mine
        chosen = chosen[np.argsort(key, kind="stable")]
        start = np.searchsorted(self.interval[chosen], first + np.arange(intervals + 1))
        visual = Visual(
            start,
            self.tau[chosen],
            self.weights[chosen],
            landmark[chosen],
            self.xy[chosen],
            self.root_information[chosen],
        )
        return visual, self.propagated.chosen(chosen)
