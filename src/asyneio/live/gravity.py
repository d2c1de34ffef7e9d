# SPDX-License-Identifier: Apache-2.0
"""Whether gravity agrees with the scale of the inertial samples, from the first seconds of a live run."""

from __future__ import annotations

import numpy as np

from asyneio.inertial.gravity_witness import ask_gravity
from asyneio.types import NS_PER_S, Packet, RecordArray

#: Sensor time of the samples that are checked.
_SPAN_NS = 10 * NS_PER_S


class GravityCheck:
    """Collects samples and checks them once."""

    def __init__(self) -> None:
        self._gyroscope: list[RecordArray] = []
        self._accelerometer: list[RecordArray] = []
        self._first_ns: int | None = None
        self._done = False
        #: The problem that was found; empty if none is known.
        self.complaint = ""

    def add(self, packet: Packet) -> bool:
        """Take a packet; whether it led to a complaint."""
        if self._done:
            return False
        self._first_ns = packet.t_end_ns if self._first_ns is None else self._first_ns
        self._gyroscope.append(packet.gyroscope)
        self._accelerometer.append(packet.accelerometer)
        if packet.t_end_ns - self._first_ns < _SPAN_NS:
            return False
        self._done = True
        found = ask_gravity(np.concatenate(self._gyroscope), np.concatenate(self._accelerometer))
        self._gyroscope, self._accelerometer = [], []
        if found is not None:
            self.complaint = found.force_complaint() or found.gyroscope_complaint()
        return bool(self.complaint)
