# SPDX-License-Identifier: Apache-2.0
"""Observations, which come in order of emission, handed on in order of time, packet by packet."""

from __future__ import annotations

import numpy as np

from asyneio.types import OBSERVATION_DTYPE, RecordArray


class DelayedObservations:
    """Holds observations back until their packet is due.

    An observation is emitted some time after its stamp. One whose packet has been handed on is dropped and
    counted in `late`.

    Args:
        start_ns: start of the first packet, IMU clock.
    """

    def __init__(self, start_ns: int) -> None:
        self._waiting = np.empty(0, dtype=OBSERVATION_DTYPE)
        self._from_ns = start_ns
        self.late = 0

    def due(self, emitted: RecordArray, end_ns: int) -> RecordArray:
        """Add newly emitted observations (OBSERVATION_DTYPE, IMU clock); those of the packet that ends at
        `end_ns`, ascending."""
        waiting = np.concatenate([self._waiting, emitted])
        waiting = waiting[np.argsort(waiting["t_ns"], kind="stable")]
        late, due = np.searchsorted(waiting["t_ns"], [self._from_ns, end_ns], side="right")
        self.late += int(late)
        self._waiting = waiting[due:]
        self._from_ns = end_ns
        return waiting[late:due]
