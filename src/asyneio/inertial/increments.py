# SPDX-License-Identifier: Apache-2.0
"""Input and output of preintegration: samples around an interval, and increments since its start.

Increments are the motion of the body since `t_k` with the velocity at `t_k` and gravity removed (29), in the
body frame at `t_k`. With C, r of the body at `t_k` and its velocity `nu` in the body,

    C(tau) = C dC,    r(tau) = r + C (nu tau + dr) + g tau^2 / 2,    v(tau) = C (nu + dnu) + g tau.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from asyneio.errors import InertialError
from asyneio.types import FloatArray

#: Largest distance of an end of the interval from the samples, in sample periods.
COVER_PERIODS = 3.0


class Increments(NamedTuple):
    """Motion since `t_k`, initial velocity and gravity removed, at N times (29).

    `d_bias` is the derivative of [phi, nu, r] with respect to [b_g, b_a]; phi perturbs C on the right,
    `C(b + db) = C(b) Exp(d_bias[:3] db)`.
    """

    C: FloatArray  # (N,3,3) body at tau to body at t_k
    nu: FloatArray  # (N,3) in the body at t_k [m/s]
    r: FloatArray  # (N,3) in the body at t_k [m]
    d_bias: FloatArray  # (N,9,6)


def empty_increments(count: int) -> Increments:
    """Memory for increments at `count` times."""
    return Increments(
        np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 9, 6))
    )


class Preintegration(Protocol):
    """Increments of one interval, independent of the rule."""

    @property
    def bias(self) -> FloatArray:
        """Biases [b_g, b_a] (6,) that were subtracted from the samples [rad/s, m/s^2]."""

    @property
    def duration(self) -> float:
        """Length of the interval [s]."""

    def at(self, tau: FloatArray) -> Increments:
        """Increments at `tau` (N,) seconds after `t_k`, each in [0, duration], in any order."""

    def end(self) -> Increments:
        """Increments (N = 1) at the end of the interval."""

    def covariance(self, tau: float) -> FloatArray:
        """Covariance (9,9) of the errors [phi, nu, r] at `tau` due to the samples' noise."""


@dataclass(frozen=True)
class SampleNoise:
    """Standard deviation of one sample of the gyroscope [rad/s] and of the accelerometer [m/s^2].

    Raises:
        InertialError: one is not a positive number.
    """

    gyroscope: float
    accelerometer: float

    def __post_init__(self) -> None:
        for name, sigma in (("gyroscope", self.gyroscope), ("accelerometer", self.accelerometer)):
            if not (np.isfinite(sigma) and sigma > 0.0):
                raise InertialError(
                    f"the standard deviation of a {name} sample is {sigma}; expected a positive number: "
                    "the noise density times the root of the sample rate"
                )


@dataclass(frozen=True)
class ImuWindow:
    """Samples, biases included, over an interval of `duration` seconds that begins at `t_k`.

    Times (Ng,), (Na,) are seconds since `t_k`, ascending; samples (Ng,3) [rad/s] and (Na,3) [m/s^2] in the
    body. The two sensors have their own times and rates. A few samples before 0 and after `duration` improve
    the increments at the ends.

    Raises:
        InertialError: wrong shapes, fewer than two samples, times that do not ascend, numbers that are not
            finite, a duration that is not positive, or an end further than three sample periods from the
            samples.
    """

    gyroscope_t: FloatArray
    gyroscope: FloatArray
    accelerometer_t: FloatArray
    accelerometer: FloatArray
    duration: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0.0):
            raise InertialError(f"the interval lasts {self.duration} s; expected a positive number")
        for name in ("gyroscope", "accelerometer"):
            t = np.ascontiguousarray(getattr(self, f"{name}_t"), dtype=np.float64)
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            _check_samples(name, t, value)
            _check_cover(name, t, self.duration)
            object.__setattr__(self, f"{name}_t", t)
            object.__setattr__(self, name, value)


def checked_bias(bias: FloatArray) -> FloatArray:
    """A copy of `bias` (6,) [b_g, b_a].

    Raises:
        InertialError: another shape, or numbers that are not finite.
    """
    array = np.array(bias, dtype=np.float64)
    if array.shape != (6,) or not np.isfinite(array).all():
        raise InertialError(
            f"the bias has shape {array.shape} and value {array.tolist()}; expected six finite numbers"
        )
    return array


def checked_times(tau: FloatArray, duration: float) -> FloatArray:
    """Query times as contiguous (N,).

    Raises:
        InertialError: a time is outside [0, duration] or not a number.
    """
    times = np.ascontiguousarray(np.atleast_1d(tau), dtype=np.float64)
    if times.ndim != 1 or not ((times >= 0.0) & (times <= duration)).all():
        raise InertialError(
            f"found query times {times.min()} .. {times.max()} s (shape {times.shape}); "
            f"expected (N,) times between 0 and {duration} s after the start of the interval"
        )
    return times


def _check_samples(name: str, t: FloatArray, value: FloatArray) -> None:
    if t.ndim != 1 or value.shape != (len(t), 3):
        raise InertialError(
            f"{name}: times of shape {t.shape} and samples of shape {value.shape}; expected (N,) and (N,3)"
        )
    if len(t) < 2:
        raise InertialError(
            f"{name}: {len(t)} samples in or near the interval; expected two or more: "
            "lengthen the interval or look for a gap in the recording"
        )
    bad = ~(np.isfinite(t) & np.isfinite(value).all(axis=1))
    if bad.any():
        n = int(np.argmax(bad))
        raise InertialError(
            f"{name}: sample {n} at {t[n]} s is {value[n].tolist()}; expected finite numbers: "
            "drop such samples first"
        )
    steps = np.diff(t)
    if steps.min() <= 0.0:
        n = int(np.argmin(steps))
        raise InertialError(
            f"{name}: sample {n + 1} at {t[n + 1]} s does not come after sample {n} at {t[n]} s; "
            "expected ascending times: sort and drop repeated stamps first"
        )


def _check_cover(name: str, t: FloatArray, duration: float) -> None:
    margin = COVER_PERIODS * float(np.median(np.diff(t)))
    if t[0] > margin or t[-1] < duration - margin:
        raise InertialError(
            f"{name}: samples from {t[0]:.6f} to {t[-1]:.6f} s do not cover the interval 0 .. "
            f"{duration:.6f} s; expected samples to within {margin:.6f} s of both ends: "
            "shorten the interval or look for a gap in the recording"
        )
