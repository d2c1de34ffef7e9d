# SPDX-License-Identifier: Apache-2.0
"""Projection of an interval's samples onto the polynomials that a trajectory between two knots can represent.

Between two knots the trajectory's rates are smooth: to far below the noise of any sensor they are polynomials
of degree `NODES - 1`. The values of the best fit at `NODES` times, with their covariance, contain all the
information that a hundred samples have about such a curve: as factors they are equivalent to all samples
(exactly so for a polynomial), at a fraction of the cost.

The fit weights the samples by their covariance (generalised least squares), so that vibration at known
frequencies has little influence.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from asyneio.inertial.noise import SensorNoise
from asyneio.types import FloatArray

#: Number of values that represent the samples of an interval.
NODES = 6
#: Coefficients that the samples determine worse than the best one by this factor are omitted: a gap.
_CONDITION = 1e-3
#: The remainder over its expectation that is not chance any more: with sixty degrees of freedom once in a
#: thousand.
_SUDDEN = 1.6
#: Fewer degrees of freedom say nothing about an interval.
_LEAST_FREEDOM = 12


@dataclass(frozen=True)
class Projected:
    """Values (n,3) at `t` (n,) [s] that represent the samples; `root` (n,n), lower triangular, whitens each
    axis."""

    t: FloatArray
    value: FloatArray
    root: FloatArray


@cache
def _nodes(n: int) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre nodes (n,), and the first n Legendre polynomials at them (n,n)."""
    nodes: FloatArray = np.polynomial.legendre.leggauss(n)[0]
    return nodes, np.asarray(np.polynomial.legendre.legvander(nodes, n - 1), dtype=np.float64)


def project(t: FloatArray, value: FloatArray, noise: SensorNoise) -> Projected:
    """Project samples.

    Args:
        t: (N,) times [s], ascending.
        value: (N,3) samples.
        noise: of the samples.

    Returns:
        At most `NODES` values; the samples themselves if there are no more of them.
    """
    if len(t) == 0:
        return Projected(t, value, np.empty((0, 0)))
    if len(t) <= NODES:
        return Projected(t, value, noise.whitened(t, np.eye(len(t))))
    middle, half = 0.5 * (t[0] + t[-1]), 0.5 * (t[-1] - t[0])
    basis = np.polynomial.legendre.legvander((t - middle) / half, NODES - 1)
    whitened = noise.whitened(t, np.hstack([basis, value]))
    white = whitened[:, NODES:]
    Q, R = np.linalg.qr(whitened[:, :NODES])
    size = np.abs(np.diag(R))
    weak = np.flatnonzero(size < _CONDITION * size[0])
    n = int(weak[0]) if len(weak) else NODES
    coefficients = Q[:, :n].T @ white
    freedom = 3 * (len(t) - n)
    excess = float(np.sum((white - Q[:, :n] @ coefficients) ** 2)) / max(freedom, 1)
    sudden = freedom >= _LEAST_FREEDOM and excess > _SUDDEN
    # A knock disturbs consecutive samples in the same way, so that averaging does not reduce its error.
    scale = np.sqrt(1.0 + (excess - 1.0) * len(t) / n) if sudden else 1.0
    nodes, at_nodes = _nodes(n)
    fitted = at_nodes @ np.linalg.solve(R[:n, :n], coefficients)
    # The coefficients are white with unit variance, and R at_nodes^{-1} computes them from the values. The
    # triangular factor of this matrix with reversed columns, reversed again, is lower triangular and whitens.
    whiten = R[:n, :n] @ np.linalg.inv(at_nodes)
    upper = np.linalg.qr(whiten[:, ::-1])[1]
    root = upper[::-1, ::-1] / scale
    return Projected(middle + half * nodes, fitted, root)
