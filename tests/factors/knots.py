"""Random pairs of knots and their perturbation, written without the package's Lie kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]


def hat6(xi: Array) -> Array:
    x, y, z, *rho = xi
    return np.array([[0, -z, y, rho[0]], [z, 0, -x, rho[1]], [-y, x, 0, rho[2]], [0, 0, 0, 0]])


@dataclass
class Knot:
    T: Array
    varpi: Array
    bias: Array

    def perturbed(self, delta: Array) -> Knot:
        """Right perturbation by [eps, varpi, varpi_dot, b_g, b_a]."""
        return Knot(
            self.T @ expm(hat6(delta[:6])), self.varpi + delta[6:18].reshape(2, 6), self.bias + delta[18:24]
        )

    @property
    def C(self) -> Array:
        return np.ascontiguousarray(self.T[:3, :3])

    @property
    def r(self) -> Array:
        return np.ascontiguousarray(self.T[:3, 3])


def random_pair(rng: np.random.Generator, dt: float, scale: float) -> tuple[Knot, Knot]:
    """Two knots `dt` apart; `scale` 1 is a hand-held motion, 5 and more violent. No trajectory on purpose:
    the second knot does not follow from the first, so no term of a Jacobian vanishes by accident."""
    T = expm(hat6(rng.normal(size=6)))
    varpi = scale * rng.normal(size=(2, 6)) * np.array([[1.0], [3.0]])
    step = expm(hat6(dt * (varpi[0] + 0.3 * scale * rng.normal(size=6))))
    other = varpi + scale * rng.normal(size=(2, 6)) * np.array([[0.3], [2.0]])
    bias = 0.1 * rng.normal(size=(2, 6))
    return Knot(T, varpi, bias[0]), Knot(T @ step, other, bias[1])


KNOT_BLOCKS = [("eps", 6), ("varpi", 6), ("varpi_dot", 6), ("b_g", 3), ("b_a", 3)]
PAIR_BLOCKS = [(f"knot0 {n}", s) for n, s in KNOT_BLOCKS] + [(f"knot1 {n}", s) for n, s in KNOT_BLOCKS]
