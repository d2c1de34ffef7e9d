# SPDX-License-Identifier: Apache-2.0
"""Scale of both inertial sensors from gravity: from its direction and its magnitude.

Rotated by the integrated gyroscope, the specific force `f` of a body sums to its change of velocity without
gravity: `V(t) = sum C(t) f(t) dt = v(t) - v(0) - g t`. The deviation of V from a straight line is the
unsteadiness of the body's velocity, a few tenths of a metre per second when hand-held. If the gyroscope reads
a multiple of the rotation, gravity is rotated too far or not far enough, and the deviation grows. Therefore V
is fitted, for each factor by which the readings could be multiplied, by a line per span, a gyroscope bias
and the lever arm `r` of a rotation about a fixed point (`v = omega x r`), all linear; the spread of the
remainder gives a log-likelihood.

A body whose acceleration and tilt cancel (drones, pendulums, vehicles) measures gravity along a fixed axis of
its own. There the factor 0 fits as well as any other, and the scale is not observable. The length of g, the
slope of the lines, gives the scale of the accelerometer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asyneio.inertial.gravity_kernel import sum_force
from asyneio.inertial.stationarity import possible
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray

#: Standard gravity [m/s^2].
GRAVITY = 9.80665
#: Steps [s] over which readings are averaged, length of a span in steps, most and least spans and steps.
_STEP_S, _SPAN_STEPS, _MOST_SPANS, _LEAST_STEPS = 0.02, 200, 20, 25
#: A span with a longer pause of a sensor [s] is not evaluated.
_LONGEST_GAP_S = 0.5
#: Steps between evaluated sums.
_EVERY = 5
#: Standard deviations of a gyroscope's bias [rad/s] and of a lever arm [m].
_BIAS_SIGMA, _LEVER_SIGMA = 0.05, 0.3
#: Independent values per second of a velocity; the smallest spread [m/s] that is assumed.
_VALUES_HZ, _LEAST_SPREAD = 2.0, 0.05
#: Powers of two that are tried, besides 0; then ranges around the best, in finer and finer steps.
_COARSE = np.arange(-7.0, 8.0)
_FINER = (0.5, 0.2, 0.08, 0.03)
_ROUNDS, _REWEIGHTED = 2, 5
#: Deficit of log-likelihood that excludes an alternative: by chance once in a million.
EXCLUDED = 15.0
#: Factors closer to one than this are not errors of a unit or a range.
SAME_SCALE = 1.3
#: A magnitude of gravity [m/s^2] within this factor is explained by the bias and scale errors of any sensor;
#: a change of velocity [m/s] over a span up to this limit, by motion.
FORCE_RATIO = 1.25
#: Smallest ratio of measured to true gravity. It is closer to 1 than 1 / FORCE_RATIO because missing force
#: is estimated as a fall of the body, at a scale that is wrong by a large factor, while excess force prevents
#: the initialization. Data sheets allow a bias of 0.8 m/s^2 and a scale error of 3 %, together 11 %.
_LEAST_FORCE = 0.89
_VELOCITY = 2.0
_DOUBTFUL_FORCE = 0.05
#: Factors of the gyroscope, and their causes, for factors up to this one away.
_CAUSES = {
    180.0 / np.pi: "degrees instead of radians: multiply by pi / 180",
    np.pi / 180.0: "converted to radians twice: multiply by 180 / pi",
    1000.0 * np.pi / 180.0: "milliradians per second read as degrees: multiply the readings by 0.001",
    1000.0: "thousandths of a unit (mdeg/s, mrad/s): multiply by 0.001",
    0.001: "a unit divided by 1000: multiply by 1000",
}
_RANGE = "a full-scale range other than the driver's (a power of 2): multiply its readings by {:g}"
_NAMED = 1.12


@dataclass(frozen=True)
class GravityWitness:
    """Scales of the two sensors according to gravity.

    Attributes:
        scale: rotation read by the gyroscope over the rotation of gravity: 1 where both agree.
        log_sigma: standard deviation of its logarithm; infinite where it is not observable.
        against_one: log-likelihood by which the scale 1 falls short of the best.
        against_rest: the same for no rotation at all; small where the scale is not observable.
        force: magnitude of gravity as the accelerometer reads it [m/s^2].
        seconds: evaluated part of the recording, in spans of `span_s`.
    """

    scale: float
    log_sigma: float
    against_one: float
    against_rest: float
    force: float
    seconds: float
    span_s: float

    @property
    def observable(self) -> bool:
        """Whether gravity rotates enough to determine the gyroscope's scale."""
        return self.against_rest > EXCLUDED and np.isfinite(self.log_sigma)

    def gyroscope_complaint(self) -> str:
        """A certain error of the gyroscope's scale, as a phrase; empty if there is none."""
        factor = max(self.scale, 1.0 / self.scale)
        if not self.observable or factor < SAME_SCALE or self.against_one < EXCLUDED:
            return ""
        return (
            f"the gyroscope reads {self.scale:.3g} times the rotation of gravity in the accelerometer"
            f"{gyroscope_cause(self.scale)}"
        )

    def force_doubt(self) -> bool:
        """Whether the accelerometer is off by more than a calibrated one, and motion does not explain it."""
        off = abs(self.force - GRAVITY)
        return off > _DOUBTFUL_FORCE * GRAVITY and off * self.span_s > _VELOCITY

    def force_complaint(self) -> str:
        """A certain error of the accelerometer's scale, as a phrase; empty if there is none."""
        ratio = self.force / GRAVITY
        if _LEAST_FORCE < ratio < FORCE_RATIO or abs(self.force - GRAVITY) * self.span_s < _VELOCITY:
            return ""
        return (
            f"the accelerometer reads gravity as {self.force:.3g} m/s^2 (mean over {self.seconds:.3g} s, "
            f"rotated by the gyroscope), {ratio:.3g} times its true value; expected {GRAVITY:.2f}: "
            "another unit, a full-scale range other than the driver's, or gravity removed; multiply by "
            f"{1.0 / ratio:.3g} if the scale is the cause"
        )


def gyroscope_cause(scale: float) -> str:
    """The usual cause of a scale, as the end of a sentence; another calibration if it is close to none."""
    powers = {2.0**k: _RANGE.format(2.0**-k) for k in range(-5, 6) if k}
    factor, cause = min((powers | _CAUSES).items(), key=lambda item: abs(np.log(scale / item[0])))
    if abs(np.log(scale / factor)) < np.log(_NAMED):
        return f"; this fits {cause}"
    return (
        f"; this is no usual factor of units or ranges: divide its readings by {scale:.3g}, or calibrate it"
    )


def ask_gravity(gyroscope: RecordArray, accelerometer: RecordArray) -> GravityWitness | None:
    """Scale of the gyroscope and of the accelerometer; None below half a second of samples.

    Args:
        gyroscope, accelerometer: INERTIAL_DTYPE, ascending [rad/s, m/s^2].
    """
    streams = [rows[possible(rows["xyz"])] for rows in (gyroscope, accelerometer)]
    if min(rows.size for rows in streams) < 2:
        return None
    edges = span_edges(
        max(int(rows["t_ns"][0]) for rows in streams), min(int(rows["t_ns"][-1]) for rows in streams)
    )
    if edges is None or not (edges := without_gaps(edges, streams)).size:
        return None
    rate, force = (span_means(rows, edges) for rows in streams)
    fit = GravityFit(rate, force)
    powers = _COARSE
    costs, lengths = fit.costs(np.append(0.0, 2.0**powers))
    rest, costs, lengths = costs[0], costs[1:], lengths[1:]
    one = costs[powers == 0.0][0]
    best = int(np.argmin(costs))
    power, least, length = powers[best], costs[best], lengths[best]
    curvature = 0.0
    for step in _FINER:
        near, lengths = fit.costs(2.0 ** (power + step * np.array([-1.0, 0.0, 1.0])))
        curvature = float((near[0] - 2.0 * near[1] + near[2]) / (step * np.log(2.0)) ** 2)
        k = int(np.argmin(near))
        power, least, length = power + step * (k - 1), near[k], lengths[k]
    return GravityWitness(
        scale=float(2.0**-power),
        log_sigma=float(1.0 / np.sqrt(curvature)) if curvature > 0.0 else float("inf"),
        against_one=float(one - least),
        against_rest=float(rest - least),
        force=float(length),
        seconds=edges.shape[0] * (edges.shape[1] - 1) * _STEP_S,
        span_s=(edges.shape[1] - 1) * _STEP_S,
    )


def span_edges(first_ns: int, last_ns: int, most: int = _MOST_SPANS) -> IntArray | None:
    """Edges (K,N+1) [ns] of the steps of at most `most` spans, spread over the recording; None if it is
    short."""
    steps = min(int((last_ns - first_ns) / NS_PER_S / _STEP_S), _SPAN_STEPS)
    if steps < _LEAST_STEPS:
        return None
    step_ns = round(_STEP_S * NS_PER_S)
    spans = (last_ns - first_ns) // (steps * step_ns)
    chosen = np.unique(np.linspace(0, spans - 1, min(spans, most)).astype(np.int64))
    return np.asarray(first_ns + (chosen[:, None] * steps + np.arange(steps + 1)) * step_ns)


def without_gaps(edges: IntArray, streams: Sequence[RecordArray]) -> IntArray:
    """The spans, rows of edges (K,N+1), in which no stream pauses for long."""
    whole = np.ones(len(edges), dtype=np.bool_)
    for rows in streams:
        t_ns = rows["t_ns"]
        after = np.flatnonzero(np.diff(t_ns) > _LONGEST_GAP_S * NS_PER_S)
        for start, end in zip(t_ns[after].tolist(), t_ns[after + 1].tolist(), strict=True):
            whole &= (edges[:, -1] <= start) | (edges[:, 0] >= end)
    return edges[whole]


def span_means(rows: RecordArray, edges: IntArray) -> FloatArray:
    """Means (K,N,3) of samples between edges (K,N+1), by the trapezoidal rule."""
    t_s = (rows["t_ns"] - edges[0, 0]) / NS_PER_S
    areas = 0.5 * (rows["xyz"][1:] + rows["xyz"][:-1]) * np.diff(t_s)[:, None]
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(areas, axis=0)])
    at = (edges - edges[0, 0]) / NS_PER_S
    sums = np.stack([np.interp(at, t_s, axis) for axis in total.T], axis=2)
    return np.asarray(np.diff(sums, axis=1) / _STEP_S)


class GravityFit:
    """Costs of factors by which the rates (K,N,3) could be multiplied, given specific forces (K,N,3)."""

    def __init__(self, rate: FloatArray, force: FloatArray) -> None:
        self._rate, self._force = rate, force
        steps = rate.shape[1] // _EVERY
        self._line = np.linalg.qr(np.column_stack([np.ones(steps), np.linspace(-1.0, 1.0, steps)]))[0]
        self._values = max(3.0 * _VALUES_HZ * _STEP_S * rate.shape[1] - 6.0, 3.0)

    def costs(self, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Negative log-likelihoods (F,) of factors (F,), and the lengths (F,) of gravity with them."""
        found = [self._cost(factor) for factor in factors.tolist()]
        costs, lengths = zip(*found, strict=True)
        return np.array(costs), np.array(lengths)

    def _cost(self, factor: float) -> tuple[float, float]:
        bias = np.zeros(3)
        inverse = 1.0 / np.repeat([_BIAS_SIGMA, _LEVER_SIGMA], 3) ** 2
        for _ in range(_ROUNDS):
            sums = sum_force(factor * self._rate - bias, self._force, _STEP_S, _EVERY)
            rows = self._bent(sums)
            before = np.append(bias, np.zeros(3))
            x, spread = self._solve(rows[..., 1:], rows[..., 0], before, inverse)
            bias = (before + x)[:3]
        cost = self._values * np.log(spread).sum() + 0.5 * float((before + x) ** 2 @ inverse)
        steps = sums.shape[1]
        slope = np.einsum("n,kni->ki", self._line[:, 1], sums[..., 0]) * abs(self._line[-1, 1])
        length = np.linalg.norm(slope, axis=1) * 2.0 / (_EVERY * _STEP_S * (steps - 1))
        return float(cost), float(np.median(length))

    def _bent(self, sums: FloatArray) -> FloatArray:
        """Sums (K,N,3,7) minus the best straight line of each span, as (K,3N,7)."""
        K, N = sums.shape[:2]
        flat = sums.reshape(K, N, -1)
        return np.asarray(flat - self._line @ (self._line.T @ flat)).reshape(K, 3 * N, -1)

    def _solve(
        self, rows: FloatArray, left: FloatArray, before: FloatArray, inverse: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Steps (6,) of bias and lever arm from `before`, and the spread of each span [m/s]."""
        x = np.zeros(6)
        for _ in range(_REWEIGHTED):
            spread = np.sqrt(np.square(left + rows @ x).mean(axis=1) + _LEAST_SPREAD**2)
            weight = self._values / left.shape[1] / spread**2
            weighted = rows * weight[:, None, None]
            normal = np.einsum("kri,krj->ij", weighted, rows) + np.diag(inverse)
            x = -np.linalg.solve(normal, np.einsum("kri,kr->i", weighted, left) + inverse * before)
        return x, np.sqrt(np.square(left + rows @ x).mean(axis=1) + _LEAST_SPREAD**2)
