# SPDX-License-Identifier: Apache-2.0
"""Reference work that measures the current speed of a machine.

It has two parts that resemble the package's own work: a compiled scalar loop, like the front end, and small
dense factorisations and products, like the estimator.
"""

from __future__ import annotations

import time

import numpy as np

from asyneio.jit import njit
from asyneio.types import IntArray

#: Length and table size of the loop, size and number of the factorisations: about 20 ms each.
_STEPS, _TABLE = 4_000_000, 1 << 15
_SIZE, _FACTORISATIONS = 240, 12
_SEED = 14


@njit(cache=True, nogil=True)
def _walk(table: IntArray, steps: int) -> int:
    """Follow indices through a table and sum up: loads, branches, integer arithmetic."""
    at, total = 0, 0
    size = table.shape[0]
    for step in range(steps):
        at = (table[at] + step) & (size - 1)
        if at & 1:
            total += at
        else:
            total ^= at
    return total


def reference_seconds() -> tuple[float, float]:
    """Wall-clock and CPU seconds: geometric means of the two parts, on one thread."""
    rng = np.random.default_rng(_SEED)
    table = rng.integers(0, _TABLE, _TABLE)
    root = rng.normal(size=(_SIZE, _SIZE))
    _walk(table, 1)
    marks = [_now()]
    _walk(table, _STEPS)
    marks.append(_now())
    for _ in range(_FACTORISATIONS):
        np.linalg.cholesky(root @ root.T + _SIZE * np.eye(_SIZE))
    marks.append(_now())
    wall_s, cpu_s = np.sqrt(np.prod(np.diff(marks, axis=0), axis=0))
    return float(wall_s), float(cpu_s)


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()
