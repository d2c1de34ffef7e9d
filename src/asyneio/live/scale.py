# SPDX-License-Identifier: Apache-2.0
"""Whether scale and clocks are contradicted: the scale in a live run, both at its end."""

from __future__ import annotations

from collections import deque

import numpy as np

from asyneio.config import Config
from asyneio.pipeline.clock_check import contradicted_clock
from asyneio.pipeline.scale_check import contradicted_scale, contradictions_of_prior, scale_notes
from asyneio.types import (
    INERTIAL_DTYPE,
    NS_PER_S,
    OBSERVATION_DTYPE,
    Calibration,
    CalibrationEstimate,
    Packet,
)

#: Sensor time of the newest tracks and samples that are kept, for the comparison at the end.
_SPAN_NS = 30 * NS_PER_S
#: Sensor time between two checks, and number of checks in a row that must show a contradiction.
_EVERY_NS, _IN_A_ROW = NS_PER_S, 3


class ScaleCheck:
    """Collects the newest packets and tests the calibration that was estimated from them.

    Args:
        config: of the run; its prior of the scale factors is tested.
        calibration: as given to the run.
    """

    def __init__(self, config: Config, calibration: Calibration) -> None:
        self._config, self._calibration = config, calibration
        self._packets: deque[Packet] = deque()
        self._due_ns: int | None = None
        self._in_a_row = 0
        #: The contradiction that was found during the run; empty if there was none.
        self.complaint = ""

    def add(self, packet: Packet) -> bool:
        """Take a packet; whether a check of the estimate is due."""
        self._packets.append(packet)
        while self._packets[0].t_end_ns <= packet.t_end_ns - _SPAN_NS:
            self._packets.popleft()
        if self._due_ns is not None and packet.t_end_ns < self._due_ns:
            return False
        self._due_ns = packet.t_end_ns + _EVERY_NS
        return True

    def check(self, found: CalibrationEstimate | None) -> bool:
        """Test the present estimate; whether this led to a new complaint."""
        contradictions = contradictions_of_prior(found, self._config)
        self._in_a_row = self._in_a_row + 1 if contradictions else 0
        if self._in_a_row < _IN_A_ROW or self.complaint:
            return False
        self.complaint = "; ".join(contradictions)
        return True

    def restart(self) -> None:
        """Forget the packets: a new stretch begins, whose time may differ."""
        self._packets.clear()
        self._due_ns, self._in_a_row = None, 0

    def result(self, found: CalibrationEstimate | None) -> tuple[str, tuple[str, ...]]:
        """What is wrong with the scale or the clocks at the end (empty if nothing is), and notes.

        Both are those of `run_recording`, from the tracks of the last 30 s.
        """
        gyroscope = np.concatenate(
            [np.zeros(0, INERTIAL_DTYPE), *(packet.gyroscope for packet in self._packets)]
        )
        observations = np.concatenate(
            [np.zeros(0, OBSERVATION_DTYPE), *(packet.observations for packet in self._packets)]
        )
        observations = observations[np.argsort(observations["t_ns"], kind="stable")]
        contradiction = contradicted_clock(
            found, self._calibration, gyroscope, observations
        ) or contradicted_scale(found, self._config, self._calibration, gyroscope, observations)
        if contradiction:
            return contradiction, ()
        notes = scale_notes(found, self._calibration, gyroscope, observations)
        earlier = (f"earlier in the run: {self.complaint}",) if self.complaint else ()
        return "", (*earlier, *notes)
