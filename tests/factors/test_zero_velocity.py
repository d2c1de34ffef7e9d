"""Zero-velocity update: its Jacobian, and the motions for which it is zero."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.factors.zero_velocity import zero_velocity_jacobian, zero_velocity_residual

from .jacobian_checker import check_jacobian
from .knots import PAIR_BLOCKS, Knot, random_pair


def residual_of(a: Knot, b: Knot) -> np.ndarray:
    out = np.empty(18)
    varpi_0, varpi_1 = (np.ascontiguousarray(knot.varpi[0]) for knot in (a, b))
    zero_velocity_residual(a.C, a.r, varpi_0, b.C, b.r, varpi_1, out)
    return out


@pytest.mark.parametrize(("dt", "scale"), [(1e-3, 0.1), (0.1, 1.0), (0.4, 2.5)])
@pytest.mark.parametrize("seed", range(3))
def test_jacobian(seed: int, dt: float, scale: float) -> None:
    """Also in fast motion, so that no term vanishes; rows differ in unit and size."""
    a, b = random_pair(np.random.default_rng(seed), dt, scale)
    jacobian = np.empty((18, 48))
    zero_velocity_jacobian(a.C, a.r, b.C, b.r, jacobian)
    for rows in (slice(0, 3), slice(3, 6), slice(6, 12), slice(12, 18)):
        check_jacobian(
            f"rest rows {rows.start}",
            jacobian[rows],
            lambda d, r=rows: residual_of(a.perturbed(d[:24]), b.perturbed(d[24:]))[r],
            PAIR_BLOCKS,
        )


def test_vanishes_at_rest_and_nowhere_else() -> None:
    a, _ = random_pair(np.random.default_rng(0), 0.1, 1.0)
    still = Knot(a.T, np.zeros((2, 6)), a.bias)
    np.testing.assert_allclose(residual_of(still, still), 0.0, atol=1e-15)
    for k in range(12):
        delta = np.zeros(24)
        delta[k] = 1e-3
        moved = residual_of(still, still.perturbed(delta))
        assert np.linalg.norm(moved) == pytest.approx(1e-3, rel=1e-6), f"coordinate {k} has no effect"


def test_same_in_every_world() -> None:
    """It does not depend on position and attitude themselves."""
    a, b = random_pair(np.random.default_rng(1), 0.1, 1.0)
    W, _ = random_pair(np.random.default_rng(2), 0.1, 1.0)
    there = (Knot(W.T @ knot.T, knot.varpi, knot.bias) for knot in (a, b))
    np.testing.assert_allclose(residual_of(*there), residual_of(a, b), atol=1e-12)
