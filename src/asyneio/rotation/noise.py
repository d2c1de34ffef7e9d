# SPDX-License-Identifier: Apache-2.0
"""Noise model of rates by window: autoregressive of order 1 for each axis, robust to outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.types import FloatArray

#: Minimum standard deviation of a rate [rad/s].
_LEAST_NOISE = 0.01
#: Limits of the correlation of neighbouring windows.
_CORRELATION = (0.0, 0.95)
#: Squared scale of the Cauchy cost, in squared standard deviations.
CAUCHY = 9.0


@dataclass(frozen=True)
class Noise:
    """Standard deviation of innovations (D,), and correlation with the window before, `alike` (N-1,D)."""

    sigma: FloatArray
    alike: FloatArray


def noise_of(residual: FloatArray, gaps: FloatArray) -> Noise:
    """Noise of residuals (N,D), for each axis separately."""
    limit = 3.0 * spread(residual)
    limited = np.clip(residual, -limit, limit)
    correlation = (limited[1:] * limited[:-1]).sum(axis=0) / np.maximum((limited**2).sum(axis=0), 1e-12)
    alike = np.clip(correlation, *_CORRELATION) ** gaps[:, None]
    return Noise(spread(differences(residual, alike)), alike)


def differences(values: FloatArray, alike: FloatArray) -> FloatArray:
    """Innovations (N-1,D) of `values` (N,D) relative to the window before."""
    return np.asarray(values[1:] - alike * values[:-1])


def spread(residual: FloatArray) -> FloatArray:
    """Robust standard deviation (D,) of residuals (N,D) about zero."""
    size = np.abs(residual)
    # A smooth function of the residuals, unlike the median, which jumps from one residual to the next.
    limited = np.minimum(size, 3.0 * 1.4826 * np.median(size, axis=0))
    return np.maximum(np.sqrt((limited**2).mean(axis=0)), _LEAST_NOISE)


def weights(residual: FloatArray, sigma: FloatArray) -> FloatArray:
    """Cauchy weights (N,) of residuals (N,D)."""
    return np.asarray(1.0 / (1.0 + ((residual / sigma) ** 2).sum(axis=1) / CAUCHY))
