# SPDX-License-Identifier: Apache-2.0
"""Couplings of the landmarks with the knots in their observations, stored compactly.

A landmark is coupled with the knots from its anchor to the one after its last observation, a third of the
window. Landmarks with the same anchor are contiguous, with rows as long as the longest of them, so that their
rank update of the knots is one product of a contiguous matrix (`elimination.py`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.estimation.problem.problem import LANDMARK_COLUMNS
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray


class Couplings(NamedTuple):
    """Rows of L landmarks, `dof` each, in the order of their anchors.

    Row d of landmark j begins at `begin[j] + d width[anchor[j]]` and has 18 columns for each knot from the
    anchor on.
    """

    values: FloatArray  # (total,)
    begin: IntArray  # (L,) start of the first row of a landmark
    order: IntArray  # (L,) landmarks in the order of storage
    end: IntArray  # (L,) one past the last knot of a landmark
    first: IntArray  # (K+1,) start in `order` of the landmarks anchored in each knot
    width: IntArray  # (K,) length of their rows

    def group(self, anchor: int, dof: int) -> FloatArray:
        """Rows (n dof, width) of the landmarks anchored in a knot, a view."""
        n = int(self.first[anchor + 1] - self.first[anchor])
        width = int(self.width[anchor])
        at = int(self.begin[self.order[self.first[anchor]]]) if n else 0
        return self.values[at : at + n * dof * width].reshape(n * dof, width)

    def dense(self, anchor: IntArray, dof: int) -> FloatArray:
        """All couplings (L,dof,K,18), for tests and for code that is not time-critical."""
        knots = len(self.width)
        out = np.zeros((len(anchor), dof, knots, LANDMARK_COLUMNS))
        for k in range(knots):
            mine = self.order[self.first[k] : self.first[k + 1]]
            span = int(self.width[k]) // LANDMARK_COLUMNS
            rows = self.group(k, dof).reshape(len(mine), dof, span, LANDMARK_COLUMNS)
            out[mine, :, k : k + span] = rows
        return out


_NONE = np.zeros(0, dtype=np.int64)
#: Without landmarks and knots.
NO_COUPLINGS = Couplings(np.zeros(0), _NONE, _NONE, _NONE, np.zeros(1, dtype=np.int64), _NONE)


@njit(cache=True, nogil=True)
def empty_couplings(
    anchor: IntArray, start: IntArray, landmark: IntArray, knots: int, reach: int, dof: int
) -> Couplings:
    """Zeroed, for the observations of `landmark` (M,) sorted by interval, `start` (I+1,).

    `anchor` (L,); `reach`: number of knots, from the first of its interval on, in an observation.
    """
    count = anchor.shape[0]
    end = np.zeros(count, dtype=np.int64)
    for i in range(start.shape[0] - 1):
        for n in range(start[i], start[i + 1]):
            end[landmark[n]] = i + reach
    first, width = np.zeros(knots + 1, dtype=np.int64), np.zeros(knots, dtype=np.int64)
    for j in range(count):
        a = anchor[j]
        first[a + 1] += 1
        width[a] = max(width[a], LANDMARK_COLUMNS * (end[j] - a))
    offset = np.zeros(knots, dtype=np.int64)
    total = 0
    for a in range(knots):
        offset[a] = total
        total += first[a + 1] * dof * width[a]
        first[a + 1] += first[a]
    begin, order = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    filled = np.zeros(knots, dtype=np.int64)
    for j in range(count):
        a = anchor[j]
        begin[j] = offset[a] + filled[a] * dof * width[a]
        order[first[a] + filled[a]] = j
        filled[a] += 1
    return Couplings(np.zeros(total), begin, order, end, first, width)
