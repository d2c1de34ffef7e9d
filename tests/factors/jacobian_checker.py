"""One Jacobian checker for every factor: analytic against central differences, block by block."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def numeric_jacobian(f: Callable[[Array], Array], dof: int, step: float = 1e-4) -> Array:
    """Fourth-order central differences of `f` at zero perturbation, (m, dof)."""
    columns = []
    for j in range(dof):
        e = np.zeros(dof)
        e[j] = step
        columns.append((8.0 * (f(e) - f(-e)) - (f(2 * e) - f(-2 * e))) / (12.0 * step))
    return np.stack(columns, axis=-1)


def check_jacobian(
    name: str,
    analytic: Array,
    f: Callable[[Array], Array],
    blocks: Sequence[tuple[str, int]],
    tolerance: float = 1e-6,
) -> None:
    """Fail with the block's name and both matrices where the relative difference exceeds `tolerance`.

    The difference is relative to the largest entry of the block, or of the whole Jacobian times 1e-3 where
    the block is (nearly) zero, so that rounding in an empty block does not count as an error.
    """
    numeric = numeric_jacobian(f, sum(size for _, size in blocks))
    assert analytic.shape == numeric.shape, f"{name}: {analytic.shape} against {numeric.shape}"
    floor = 1e-3 * np.abs(numeric).max()
    start = 0
    for block, size in blocks:
        a, n = analytic[:, start : start + size], numeric[:, start : start + size]
        error = np.abs(a - n).max() / max(np.abs(n).max(), floor)
        assert error < tolerance, (
            f"{name}, block {block}: relative error {error:.3g}\nanalytic\n{a}\nnumeric\n{n}"
        )
        start += size
