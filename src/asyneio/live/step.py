# SPDX-License-Identifier: Apache-2.0
"""The result of one packet, and the interface of the outputs that receive it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from asyneio.live.chunks import Sensor
from asyneio.live.tracking import Shed, Tracked
from asyneio.types import Estimate, FloatArray, Health, StepReport


@dataclass(frozen=True)
class LiveStep:
    """Estimates of one packet, with segments counted over the whole run.

    `latency_s`: from the arrival of the first datum as new as the packet's end to the estimate; it contains
    `frontend.max_delay_s`. `processing_s`: from the arrival of the last datum that the packet needed.
    `tracked` is None for a state without a packet (a silent source, the end of a stretch). `landmarks`
    (N,3): in the world, if an output requires them.
    """

    report: StepReport
    estimates: tuple[Estimate, ...] = ()
    latency_s: float = 0.0
    processing_s: float = 0.0
    backlog_s: float = 0.0
    shed: Shed = field(default_factory=Shed)
    tracked: Tracked | None = None
    landmarks: FloatArray | None = None


@dataclass(frozen=True)
class Transition:
    """A change of health or segment; `t_ns` on the sensors' clock."""

    t_ns: int
    health: Health
    segment: int
    reason: str


class Output(Protocol):
    """Receives every step."""

    def begin(self, sensor: Sensor) -> None:
        """The source is open. An output that cannot begin raises an AsyneioError."""
        ...

    def step(self, step: LiveStep) -> None:
        """Take a step. It must return at once."""
        ...

    def end(self) -> None:
        """Write waiting data, and close. It raises nothing; failures are in `notes`."""
        ...

    def notes(self) -> tuple[str, ...]:
        """Notes on output that is missing or incomplete; after `end`."""
        ...
