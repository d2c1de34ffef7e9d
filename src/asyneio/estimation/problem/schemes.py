# SPDX-License-Identifier: Apache-2.0
"""Four ways for inertial samples to enter the window, behind one interface (`measure`).

| scheme    | factors of an interval                                  | pose between two knots      | state |
|-----------|---------------------------------------------------------|-----------------------------|-------|
| GPIF      | every sample on the trajectory (21)                     | interpolated (20)           | 24    |
| Preint    | increments by the midpoint rule (30)                    | interpolated (20)           | 24    |
| ExtPreint | as Preint, and rates fitted at both ends, as (21)       | interpolated (20)           | 24    |
| GPP       | increments by Gaussian processes over the samples (30)  | increments at its time (29) | 15    |

GPP has no kinematic prior; the others have the motion prior (16).

*ExtPreint uses samples twice.* The paper gives no equation for it. The rates at a knot are fitted to the
samples within `_END_S` of it, which the increments also use; therefore the fit's variance is doubled, and the
possible curvature of the signal within the fit is added (`_BEND`).

*Gaps.* Preintegration needs samples up to both ends. If they are missing, the nearest sample is held, and
every gap adds the possible motion in it to the covariance of the increments (`_GAP_SLOPE`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from asyneio.errors import EstimationError
from asyneio.inertial.end_fit import line_weights
from asyneio.inertial.gp_preintegration import gp_preintegration
from asyneio.inertial.increments import ImuWindow, Preintegration, SampleNoise
from asyneio.inertial.noise import InertialNoise, SensorNoise
from asyneio.inertial.preintegration import midpoint
from asyneio.inertial.projection import project
from asyneio.types import FloatArray, IntArray, RecordArray

#: The rates at an end of the interval are fitted to the samples within this time [s], at least to this many.
_END_S = 0.015
_END_SAMPLES = 3
#: Assumed second derivatives of angular velocity [rad/s^3] and of specific force [m/s^4] within a fit.
_BEND = (200.0, 1000.0)
#: Assumed first derivatives [rad/s^2, m/s^3] within a gap.
_GAP_SLOPE = (20.0, 100.0)
#: More than this many sample periods without a sample are a gap.
_GAP_PERIODS = 2.5


@dataclass(frozen=True)
class Scheme:
    """How a scheme uses the samples of an interval."""

    name: str
    direct: bool = False  # every sample is a factor
    rule: Callable[[ImuWindow, FloatArray, SampleNoise], Preintegration] | None = None
    ends: bool = False  # rates fitted at both ends are factors too
    propagates: bool = False  # poses between knots come from increments, and there is no kinematic prior


SCHEMES = {
    scheme.name: scheme
    for scheme in (
        Scheme("gpif", direct=True),
        Scheme("gpp", rule=gp_preintegration, propagates=True),
        Scheme("preint", rule=midpoint),
        Scheme("extpreint", rule=midpoint, ends=True),
    )
}


@dataclass(frozen=True)
class DirectSamples:
    """Values that are factors on the trajectory: `t_ns` (N,), `value` (N,3), and `root` (N,N), lower
    triangular, which whitens each axis of them."""

    t_ns: IntArray
    value: FloatArray
    root: FloatArray


@dataclass(frozen=True)
class IntervalInertial:
    """Measurements from an interval's samples; `covariance` (9,9) is that of the increments."""

    gyroscope: DirectSamples
    accelerometer: DirectSamples
    preintegration: Preintegration | None
    covariance: FloatArray | None


def measure(
    scheme: Scheme,
    gyroscope: RecordArray,
    accelerometer: RecordArray,
    bounds_ns: tuple[int, int],
    bias: FloatArray,
    noise: InertialNoise,
    inflation: float,
) -> IntervalInertial:
    """The measurements of the interval `bounds_ns` under a scheme.

    Args:
        scheme: one of `SCHEMES`.
        gyroscope, accelerometer: INERTIAL_DTYPE, those of the interval and a few before it.
        bounds_ns: start and end of the interval; a sample at its start belongs to the interval before.
        bias: (6,) [b_g, b_a], where increments are linearised.
        noise: of the samples, by which all factors are weighted.
        inflation: ratio of `noise` to the declared noise of the sensor, with which the smoothness of Gaussian
            processes is found.

    Raises:
        EstimationError: the scheme has increments only, and there are no samples.
        InertialError: samples are not finite, not in order, or turn too far in one interval.
    """
    streams = gyroscope, accelerometer
    preintegration = covariance = None
    if scheme.rule is not None:
        window, gap_s = _window(streams, bounds_ns)
        if window is not None:
            means = noise.of_means(window.duration)
            own = SampleNoise(means.gyroscope / inflation, means.accelerometer / inflation)
            preintegration = scheme.rule(window, bias, own)
            covariance = inflation**2 * preintegration.covariance(window.duration)
            covariance += _gap_covariance(gap_s, preintegration)
        elif scheme.propagates:
            raise EstimationError(
                f"no inertial samples between {bounds_ns[0]} and {bounds_ns[1]} ns or shortly before; the "
                f"scheme {scheme.name} has nothing else to tie two knots: use gpif over such gaps"
            )
    first, second = (
        _direct(scheme, s, bounds_ns, sensor, bend)
        for s, sensor, bend in zip(streams, (noise.gyroscope, noise.accelerometer), _BEND, strict=True)
    )
    return IntervalInertial(first, second, preintegration, covariance)


def _direct(
    scheme: Scheme, samples: RecordArray, bounds_ns: tuple[int, int], noise: SensorNoise, bend: float
) -> DirectSamples:
    """The factors on the trajectory from one sensor's samples."""
    a, b = np.searchsorted(samples["t_ns"], bounds_ns, side="right")
    # Samples with start < t <= end.
    t = (samples["t_ns"][a:b] - bounds_ns[0]) * 1e-9
    value = np.asarray(samples["xyz"][a:b], dtype=np.float64)
    if scheme.direct:
        projected = project(t, value, noise)
        t_ns = bounds_ns[0] + np.rint(projected.t * 1e9).astype(np.int64)
        return DirectSamples(t_ns, projected.value, projected.root)
    if scheme.ends:
        return _at_ends(t, value, bounds_ns, noise, bend)
    return DirectSamples(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 0)))


def _at_ends(
    t: FloatArray, value: FloatArray, bounds_ns: tuple[int, int], noise: SensorNoise, bend: float
) -> DirectSamples:
    """Rates at both ends of the interval, each from the samples `value` (N,3) at `t` (N,) [s] next to it."""
    times, values, sigmas = [], [], []
    for end_ns, order in ((bounds_ns[0], slice(None)), (bounds_ns[1], slice(None, None, -1))):
        # From the end inwards.
        distance = np.abs(t[order] - (end_ns - bounds_ns[0]) * 1e-9)
        count = max(int(np.searchsorted(distance, _END_S, side="right")), min(_END_SAMPLES, len(t)))
        # A single sample cannot be extrapolated to the end.
        if count < 2 or distance[0] > _END_S:
            continue
        near = distance[:count]
        weights = line_weights(near, 0.0)
        bent = bend * near[-1] ** 2 / 6.0
        times.append(end_ns)
        values.append(weights @ value[order][:count])
        sigmas.append(np.sqrt(2.0 * weights @ noise.covariance(near) @ weights + bent**2))
    root = np.diag(1.0 / np.array(sigmas, dtype=np.float64))
    return DirectSamples(np.array(times, dtype=np.int64), np.array(values).reshape(-1, 3), root)


def _window(
    streams: tuple[RecordArray, RecordArray], bounds_ns: tuple[int, int]
) -> tuple[ImuWindow | None, tuple[float, float]]:
    """Samples over the interval, held up to an end without samples, and the seconds of each sensor's gaps.

    None instead of a window if a sensor has no samples.
    """
    duration = (bounds_ns[1] - bounds_ns[0]) * 1e-9
    parts: list[FloatArray] = []
    gaps = []
    for samples in streams:
        if len(samples) == 0:
            return None, (0.0, 0.0)
        t = (samples["t_ns"] - bounds_ns[0]) * 1e-9
        value = samples["xyz"]
        # A single sample has no period: the whole interval is a gap.
        period = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
        if len(t) == 1 or t[-1] < duration - period * _GAP_PERIODS:
            until = duration if t[-1] < duration else t[-1] + duration
            t, value = np.append(t, until), np.vstack([value, value[-1:]])
        if t[0] > period * _GAP_PERIODS:
            t, value = np.append(0.0, t), np.vstack([value[:1], value])
        parts += [t, value]
        steps = np.diff(np.clip(t, 0.0, duration))
        gaps.append(float((steps[steps > _GAP_PERIODS * period] - period).sum()))
    return ImuWindow(parts[0], parts[1], parts[2], parts[3], duration), (gaps[0], gaps[1])


def _gap_covariance(gap_s: tuple[float, float], preintegration: Preintegration) -> FloatArray:
    """Variance (9,9) of [phi, nu, r] due to unmeasured motion in gaps of the two sensors.

    An unmeasured rotation tilts all increments after it; it is assumed to come first. The correlation of the
    errors is unknown, so they are treated as independent.
    """
    angle = _GAP_SLOPE[0] * gap_s[0] ** 2
    speed = _GAP_SLOPE[1] * gap_s[1] ** 2
    end = preintegration.end()
    dv, dp = np.linalg.norm(end.nu), np.linalg.norm(end.r)
    sigmas = [angle, np.hypot(speed, angle * dv), np.hypot(speed * preintegration.duration, angle * dp)]
    return np.diag(np.repeat(sigmas, 3) ** 2)
