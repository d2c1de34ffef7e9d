# SPDX-License-Identifier: Apache-2.0
"""Smoothness of the signals: the densities of their processes, by maximum likelihood of the samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import InertialError
from asyneio.inertial.increments import ImuWindow, SampleNoise
from asyneio.inertial.smoother import evidence
from asyneio.jit import njit
from asyneio.types import FloatArray

#: Candidate densities, in units of a sample's variance over the fifth power of the sample period: from one
#: parabola for all samples to a spline through every sample.
_DECADES = np.arange(-14.0, 5.0)
_COARSE = 3
#: Weight of the declared noise, as a number of values, against the noise that the samples show.
_BELIEF = 6.0
#: Standard deviations of the prior at the first node, in units of the largest value and differences seen.
_PRIOR = 3.0
#: Smallest standard deviation of a sample, in units of the largest sample: below, interpolation is unchanged.
_LEAST_SIGMA = 1e-6


@dataclass(frozen=True)
class Smoothness:
    """Densities of the white noise on the third derivatives: of phi_dot [rad^2/s^7] and of a_k [m^2/s^9].

    Raises:
        InertialError: one is not a positive number.
    """

    gyroscope: float
    accelerometer: float

    def __post_init__(self) -> None:
        for name, density in (("gyroscope", self.gyroscope), ("accelerometer", self.accelerometer)):
            if not (np.isfinite(density) and density > 0.0):
                raise InertialError(
                    f"the density of the {name}'s process is {density}; expected a positive number, "
                    "such as find_smoothness gives"
                )


def find_smoothness(window: ImuWindow, noise: SampleNoise) -> Smoothness:
    """Densities with the largest marginal likelihood of the samples, to a decade.

    The likelihood is that of the raw samples, not of the latent states: it depends on neither rotation nor
    bias, so that increments stay differentiable with respect to the bias.
    """
    return Smoothness(
        _likeliest(window.gyroscope_t, window.gyroscope, noise.gyroscope, _DECADES),
        _likeliest(window.accelerometer_t, window.accelerometer, noise.accelerometer, _DECADES),
    )


@njit(cache=True, nogil=True)
def _likeliest(t: FloatArray, y: FloatArray, sigma: float, decades: FloatArray) -> float:
    """The best density: every third decade first, then the two decades on either side of the best."""
    prior = np.empty(3)
    variance = prior_variances(t, y, sigma, prior)
    unit = variance / ((t[-1] - t[0]) / (t.shape[0] - 1)) ** 5
    best = 0
    least = np.inf
    for n in range(0, decades.shape[0], _COARSE):
        value = _surprise(t, y, unit * 10.0 ** decades[n], variance, prior)
        if value < least:
            best, least = n, value
    middle = best
    for n in range(max(middle - _COARSE + 1, 0), min(middle + _COARSE, decades.shape[0])):
        if n != middle:
            value = _surprise(t, y, unit * 10.0 ** decades[n], variance, prior)
            if value < least:
                best, least = n, value
    return unit * 10.0 ** decades[best]


@njit(cache=True, nogil=True)
def _surprise(t: FloatArray, y: FloatArray, density: float, variance: float, prior: FloatArray) -> float:
    """Minus twice the log marginal likelihood, with all variances scaled down to fit the samples best.

    Declared noise is often inflated and would then smooth motion away. It is never scaled up, because fast
    motion would then count as noise.
    """
    volume, misfit = evidence(t, y, density, variance, prior)
    # Three values per axis determine the parabola that the prior leaves free.
    free = max(t.shape[0] - 3, 0) * y.shape[1]
    scale = min((_BELIEF + misfit) / (_BELIEF + free), 1.0)
    return volume + (_BELIEF + free) * np.log(scale) + (_BELIEF + misfit) / scale


@njit(cache=True, nogil=True)
def prior_variances(t: FloatArray, y: FloatArray, sigma: float, prior: FloatArray) -> float:
    """Write the variances (3,) of [p, p', p''] at the first node, return that of a sample.

    The prior is wide enough for the samples `y` (N,3) at `t` (N,) to dominate, and not wider, because the
    filter's rounding errors grow with the ratio of the two. It is derived from raw samples, so it does not
    depend on the bias.
    """
    size = np.zeros(3)
    period = (t[-1] - t[0]) / (t.shape[0] - 1)
    for n in range(t.shape[0]):
        for i in range(3):
            size[0] = max(size[0], abs(y[n, i]))
            if n > 0:
                # Between stamps closer than a period there is noise, not motion.
                slope = (y[n, i] - y[n - 1, i]) / max(t[n] - t[n - 1], period)
                size[1] = max(size[1], abs(slope))
                if n > 1:
                    before = (y[n - 1, i] - y[n - 2, i]) / max(t[n - 1] - t[n - 2], period)
                    size[2] = max(size[2], abs(slope - before) / max(0.5 * (t[n] - t[n - 2]), period))
    sigma = max(sigma, _LEAST_SIGMA * size[0])
    for i in range(3):
        prior[i] = (_PRIOR * (size[i] + sigma / period**i)) ** 2
    return sigma * sigma
