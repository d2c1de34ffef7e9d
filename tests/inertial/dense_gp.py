"""Dense Gaussian-process regression as it is defined, K^{-1} and integrated kernels: oracles.

Two kernels on samples at `t` (N,) of variance `variance`: that of a doubly integrated Wiener process begun at
`origin` with independent [p, p', p''], and the squared exponential of the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import erf

Array = NDArray[np.float64]


def wiener_kernel(s: Array, u: Array, origin: float, density: float, prior: Array) -> Array:
    """Covariance (N,M) of p at `s` (N,) and `u` (M,), all after `origin`; Gauss-Legendre is exact."""
    a, b = np.meshgrid(s - origin, u - origin, indexing="ij")
    nodes, weights = np.polynomial.legendre.leggauss(4)
    shorter = np.minimum(a, b)[..., None]
    w = 0.5 * shorter * (nodes + 1.0)
    walk = ((a[..., None] - w) ** 2 * (b[..., None] - w) ** 2 / 4.0 * weights).sum(-1) * shorter[..., 0] / 2.0
    return np.asarray(prior[0] + prior[1] * a * b + prior[2] * (a * b) ** 2 / 4.0 + density * walk)


@dataclass(frozen=True)
class SquaredExponential:
    """`k(s, u) = size^2 exp(-(s - u)^2 / 2 length^2)` and its integrals over `s` from 0."""

    size: float
    length: float

    def __call__(self, s: Array, u: Array) -> Array:
        return np.asarray(self.size**2 * np.exp(-0.5 * ((s[:, None] - u) / self.length) ** 2))

    def once(self, tau: Array, u: Array) -> Array:
        """Integral of k(s, u) over s from 0 to `tau` (M,): (M,N)."""
        z, z_0 = (tau[:, None] - u) / self.length, -u / self.length
        scale = self.size**2 * self.length * np.sqrt(np.pi / 2.0)
        return np.asarray(scale * (erf(z / np.sqrt(2.0)) - erf(z_0 / np.sqrt(2.0))))

    def twice(self, tau: Array, u: Array) -> Array:
        """Integral of `once` from 0 to `tau`."""
        z, z_0 = (tau[:, None] - u) / self.length, -u / self.length

        def primitive(x: Array) -> Array:
            return np.asarray(np.sqrt(np.pi / 2.0) * x * erf(x / np.sqrt(2.0)) + np.exp(-0.5 * x**2))

        falls = self.size**2 * self.length * np.sqrt(np.pi / 2.0) * erf(z_0 / np.sqrt(2.0)) * tau[:, None]
        return np.asarray(self.size**2 * self.length**2 * (primitive(z) - primitive(z_0)) - falls)


class DenseRegression:
    """Posterior mean of samples `y` (N,c) at `t` (N,), at any functional of the process."""

    def __init__(self, K: Array, variance: float, y: Array) -> None:
        self._y = y
        self._factor = cho_factor(K + variance * np.eye(len(K)), lower=True)
        self.weights = cho_solve(self._factor, y)

    def mean(self, cross: Array) -> Array:
        """Mean (M,c) of functionals whose covariance with the samples is `cross` (M,N)."""
        return np.asarray(cross @ self.weights)

    def minus_twice_log_likelihood(self) -> float:
        """Without the constant."""
        columns = self._y.shape[1]
        return float(2.0 * columns * np.log(np.diag(self._factor[0])).sum() + np.sum(self._y * self.weights))


def wiener_regression(
    t: Array, y: Array, origin: float, density: float, variance: float, prior: Array
) -> tuple[DenseRegression, Callable[[Array], Array]]:
    """The regression, and the covariance of p at given times with the samples."""
    regression = DenseRegression(wiener_kernel(t, t, origin, density, prior), variance, y)
    return regression, lambda s: wiener_kernel(s, t, origin, density, prior)
