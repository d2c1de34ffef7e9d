# SPDX-License-Identifier: Apache-2.0
"""Normal equations of a spline with a few additional unknowns: a banded matrix with a border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from asyneio.simulation.path_basis import ACTIVE
from asyneio.types import FloatArray, IntArray

#: Unknowns of one control point: position, then the quaternion xyzw.
EACH = 7
_WIDTH = ACTIVE * EACH


@dataclass(frozen=True)
class Terms:
    """Residuals r (N,k), ascending in time, with their derivatives.

    J (N,k,42): with respect to six control points from `first` (N,) on; K (N,k,c): other unknowns `columns`
    (N,c).
    """

    r: FloatArray
    first: IntArray
    J: FloatArray
    columns: IntArray
    K: FloatArray

    def weighted(self, root: FloatArray | float) -> Terms:
        """Residuals and derivatives times square roots of weights, (N,k) or a scalar."""
        w = np.broadcast_to(root, self.r.shape)
        return Terms(w * self.r, self.first, w[..., None] * self.J, self.columns, w[..., None] * self.K)


class NormalEquations:
    """J^T J x = -J^T r of `count` control points (a band) and `others` unknowns (its border)."""

    def __init__(self, count: int, others: int) -> None:
        self.band = np.zeros((_WIDTH, count * EACH))
        self.border = np.zeros((count * EACH, others))
        self.corner = np.zeros((others, others))
        self.right = np.zeros(count * EACH)
        self.right_others = np.zeros(others)

    def add(self, terms: Terms) -> None:
        """Add weighted residuals."""
        spans, H = _sum_by(terms.first, terms.J)
        for a in range(_WIDTH):
            for b in range(a + 1):
                self.band[a - b, spans * EACH + b] += H[a, b]
        rows = terms.first[:, None] * EACH + np.arange(_WIDTH)
        columns, transposed = terms.columns, np.swapaxes(terms.K, 1, 2)
        _scatter(self.right, (rows,), (np.swapaxes(terms.J, 1, 2) @ terms.r[..., None])[..., 0])
        _scatter(self.border, (rows[:, None, :], columns[:, :, None]), transposed @ terms.J)
        self.add_others(columns, terms.K, terms.r)

    def add_others(self, columns: IntArray, K: FloatArray, r: FloatArray) -> None:
        """Add weighted residuals (N,k) of the other unknowns only."""
        transposed = np.swapaxes(K, 1, 2)
        _scatter(self.corner, (columns[:, :, None], columns[:, None, :]), transposed @ K)
        _scatter(self.right_others, (columns,), (transposed @ r[..., None])[..., 0])

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Steps of the control points (count,7), and of the others.

        Raises:
            numpy.linalg.LinAlgError: the system is singular.
        """
        # Weak regularization for control points at the ends.
        self.band[0] += 1e-6
        factor = cholesky_banded(self.band, lower=True)
        both = cho_solve_banded((factor, True), np.column_stack([self.border, self.right]))
        reduced = self.corner - self.border.T @ both[:, :-1]
        left = self.right_others - self.border.T @ both[:, -1]
        others: FloatArray = np.asarray(np.linalg.solve(reduced, -left), dtype=np.float64)
        return (-both[:, -1] - both[:, :-1] @ others).reshape(-1, EACH), others


def _sum_by(first: IntArray, J: FloatArray) -> tuple[IntArray, FloatArray]:
    """Distinct `first` (S,), and sums (42,42,S) of J^T J over the rows of J (N,k,42) of each."""
    begins = np.flatnonzero(np.diff(first, prepend=-1))
    counts = np.diff(begins, append=first.size)
    # Padded to the same number of rows, so that one matrix product computes all sums.
    rows = np.zeros((begins.size, int(counts.max(initial=0)), *J.shape[1:]))
    rows[np.repeat(np.arange(begins.size), counts), np.arange(first.size) - np.repeat(begins, counts)] = J
    rows = rows.reshape(begins.size, rows.shape[1] * rows.shape[2], J.shape[2])
    return first[begins], np.ascontiguousarray(np.moveaxis(np.swapaxes(rows, 1, 2) @ rows, 0, 2))


def _scatter(target: FloatArray, index: tuple[IntArray, ...], values: FloatArray) -> None:
    """Add values to elements of an array, whose indices may repeat."""
    flat = np.ravel_multi_index(np.broadcast_arrays(*index), target.shape)
    target += np.bincount(flat.ravel(), values.ravel(), target.size).reshape(target.shape)
