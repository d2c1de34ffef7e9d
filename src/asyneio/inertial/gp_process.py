# SPDX-License-Identifier: Apache-2.0
"""Gaussian process of one sensor: its nodes, and the gains that turn samples into states."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.inertial.smoother import gains
from asyneio.inertial.smoothness import prior_variances
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray


class Process(NamedTuple):
    """n nodes and the smoother's gains."""

    t: FloatArray  # (n,) node times [s], ascending
    row: IntArray  # (n,) sample at the node, or -1
    zero: int  # node at 0 s
    K: FloatArray  # (n,3) gains of the filter
    G: FloatArray  # (n-1,3,3) gains backwards


def make_process(t: FloatArray, y: FloatArray, others: FloatArray, density: float, sigma: float) -> Process:
    """Process of samples `y` (N,3) at `t` (N,) with nodes at `others` (M,) too, one of which is 0 s."""
    count = len(t) + len(others)
    nodes, row = np.empty(count), np.empty(count, dtype=np.int64)
    used = _merge(t, np.sort(others), nodes, row)
    nodes, row = nodes[:used], row[:used]
    K, G = np.empty((used, 3)), np.empty((used - 1, 3, 3))
    prior = np.empty(3)
    gains(nodes, row, density, prior_variances(t, y, sigma, prior), prior, K, G)
    return Process(nodes, row, int(np.searchsorted(nodes, 0.0)), K, G)


@njit(cache=True, nogil=True)
def _merge(t: FloatArray, others: FloatArray, nodes: FloatArray, row: IntArray) -> int:
    """Sorted union of the two ascending lists without repetition; returns its length."""
    used, i, j = 0, 0, 0
    while i < t.shape[0] or j < others.shape[0]:
        if i < t.shape[0] and (j == others.shape[0] or t[i] <= others[j]):
            nodes[used], row[used] = t[i], i
            i += 1
        else:
            nodes[used], row[used] = others[j], -1
            j += 1
        while j < others.shape[0] and others[j] == nodes[used]:
            j += 1
        used += 1
    return used
