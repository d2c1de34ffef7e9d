"""Noise of rates window by window: each axis by itself, neighbours alike, outliers bounded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.types import FloatArray

#: Noise of a rate below which none is believed [rad/s].
_LEAST_NOISE = 0.01
#: Correlation of neighbours is never taken to be less or more.
_CORRELATION = (0.0, 0.95)
#: Squared scale of the robust cost, in standard deviations.
CAUCHY = 9.0


@dataclass(frozen=True)
class Noise:
    """Of residuals of windows: `sigma` (D,) of innovations, `alike` (N-1,D) share of the window before."""

    sigma: FloatArray
    alike: FloatArray


def noise_of(residual: FloatArray, gaps: FloatArray) -> Noise:
    """Noise of residuals (N,D), axis by axis."""
    limit = 3.0 * spread(residual)
    limited = np.clip(residual, -limit, limit)
    correlation = (limited[1:] * limited[:-1]).sum(axis=0) / np.maximum((limited**2).sum(axis=0), 1e-12)
    alike = np.clip(correlation, *_CORRELATION) ** gaps[:, None]
    return Noise(spread(differences(residual, alike)), alike)


def differences(values: FloatArray, alike: FloatArray) -> FloatArray:
    """What is new in each of `values` (N,D) against the one before: (N-1,D)."""
    return np.asarray(values[1:] - alike * values[:-1])


def spread(residual: FloatArray) -> FloatArray:
    """Robust standard deviation (D,) about zero of residuals (N,D)."""
    size = np.abs(residual)
    # Smoother in its residuals than the median alone, which jumps from one of them to the next.
    limited = np.minimum(size, 3.0 * 1.4826 * np.median(size, axis=0))
    return np.maximum(np.sqrt((limited**2).mean(axis=0)), _LEAST_NOISE)


def weights(residual: FloatArray, sigma: FloatArray) -> FloatArray:
    """Cauchy weights (N,) of residuals (N,D)."""
    return np.asarray(1.0 / (1.0 + ((residual / sigma) ** 2).sum(axis=1) / CAUCHY))
