# SPDX-License-Identifier: Apache-2.0
"""Test whether an inertial sensor is stationary, from samples over half a second and their expected noise.

Means over short bins are compared with the mean over the whole span, or with readings from a time when the
sensor was certainly stationary. With white noise of density `d`, a mean over `T` seconds has the standard
deviation `d / sqrt(T)`: slow motion of a hand is visible in means long before it is visible in single
samples. Single samples show vibration of an engine or a rotor, which averages out. These are the parts of the
generalised likelihood ratio test for zero velocity (Skog et al., IEEE TBME 2010).

A sensor in smooth, straight, uniform motion reads the same as a stationary one, so that this test alone is
not sufficient.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.types import BoolArray, FloatArray, IntArray

#: Length of a bin [ns]: an acceleration at the limit over one bin moves the sensor by 0.1 mm.
BIN_NS = 50_000_000
#: Smallest assumed densities [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)]. In two stationary sensors, means over 50 ms
#: scattered by up to 7e-4 rad/s and 9e-3 m/s^2, two to four times what their single samples suggest: the
#: noise has more power at low frequencies than white noise.
LEAST_DENSITY = (2e-4, 2e-3)
#: Scatter [rad/s, m/s^2] of single samples that any stationary consumer sensor may have; two had up to 2.4e-3
#: and 3.2e-2. A running engine causes metres per square second.
LEAST_SCATTER = (6e-3, 0.1)
#: Single samples may scatter by this multiple of the declared noise, which is often too low.
_SCATTER_FACTOR = 2.0


#: Larger readings are corrupt, in any unit.
_IMPOSSIBLE = 1e6


@dataclass(frozen=True)
class Stationarity:
    """One sensor over a span: `mean` (3,), `bins` (J,3) means over short bins, `scatter` (3,) of samples
    within their bins; `span_s` covered, `period_s` between samples. Units of the sensor."""

    mean: FloatArray
    bins: FloatArray
    scatter: FloatArray
    span_s: float
    period_s: float


def measure_stationarity(
    t_ns: IntArray, value: FloatArray, start_ns: int, end_ns: int
) -> Stationarity | None:
    """Figures of one sensor between two times; `t_ns` (N,) ascending, `value` (N,3).

    None if a bin has fewer than two samples, or if samples are corrupt.
    """
    inside = slice(*np.searchsorted(t_ns, [start_ns, end_ns], side="right"))
    t, x = t_ns[inside], value[inside]
    bins = (end_ns - start_ns) // BIN_NS
    # One wrong stamp can make a span of years, with more bins than fit into memory.
    if len(t) < 2 * bins:
        return None
    # The bins end with the span; samples are taken with start < t <= end.
    index = bins - 1 - (end_ns - t) // BIN_NS
    t, x, index = t[index >= 0], x[index >= 0], index[index >= 0]
    counts = np.bincount(index, minlength=bins)
    if bins == 0 or counts.min() < 2 or not possible(x).all():
        return None
    means = np.stack([np.bincount(index, x[:, i], bins) / counts for i in range(3)], axis=1)
    within = x - means[index]
    scatter = np.sqrt((within**2).sum(axis=0) / (len(x) - bins))
    return Stationarity(
        means.mean(axis=0), means, scatter, bins * BIN_NS * 1e-9, float(bins * BIN_NS * 1e-9 / len(x))
    )


def possible(value: FloatArray) -> BoolArray:
    """Which samples (N,3) are possible readings: (N,)."""
    return np.asarray((np.abs(value) < _IMPOSSIBLE).all(axis=1))


def deviation(found: Stationarity, reference: FloatArray, density: float, walk: float = 0.0) -> float:
    """Distance of the means from `reference` (3,), in standard deviations of white noise of `density`.

    The largest over axes, of the bins and of the whole span; `walk` is the standard deviation of the random
    walk since the reference was taken.
    """
    sigma_bin = np.hypot(density / np.sqrt(BIN_NS * 1e-9), walk)
    sigma_span = np.hypot(density / np.sqrt(found.span_s), walk)
    strays = np.abs(found.bins - reference).max() / sigma_bin
    return float(max(strays, np.abs(found.mean - reference).max() / sigma_span))


def shakes(found: Stationarity, density: float, least_scatter: float) -> bool:
    """Whether single samples scatter by more than the noise of a stationary sensor."""
    declared = density / np.sqrt(found.period_s)
    return bool(found.scatter.max() > _SCATTER_FACTOR * max(declared, least_scatter))
