# SPDX-License-Identifier: Apache-2.0
"""Where the runner gets observations from, batch by batch: a protocol, and known observations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Protocol

from asyneio.pipeline.packets import batches
from asyneio.types import IntArray, RecordArray


@dataclass(frozen=True)
class SourceState:
    """A source of tracks between two batches, to continue a run.

    `batches`: number of batches so far; `tracking`: `TrackingState` as a pickle, empty for known
    observations; `shares`: outlier shares reported on the newest batches, which have not taken effect.
    """

    batches: int
    tracking: bytes = b""
    shares: tuple[float, ...] = ()


class TrackSource(Protocol):
    """Observations in batches, one for each packet of a run."""

    @property
    def busy_s(self) -> float:
        """Processing time of the front end so far [s]."""

    def __iter__(self) -> Iterator[RecordArray]:
        """Yield one batch of observations (OBSERVATION_DTYPE, IMU clock, ascending) for each packet."""

    def set_outlier_share(self, share: float) -> None:
        """Report the share (0 to 1) of outlier tracks in the newest batch, before requesting the next."""

    def observations(self) -> RecordArray:
        """All observations of the run so far (OBSERVATION_DTYPE)."""

    def notes(self) -> tuple[str, ...]:
        """Notes for the user on observations and events that were dropped."""

    def request_state(self) -> None:
        """Have the state captured that follows one of the next batches."""

    def state(self) -> SourceState | None:
        """The captured state after the newest batch, before requesting the next; None if there is none."""

    def restore(self, state: SourceState, released: list[RecordArray]) -> None:
        """Continue after a captured state; `released`: all batches until then. Before iterating."""


class ReplayedStream:
    """Known observations, cut at given times: those of a tracks recording, or of an earlier run.

    Args:
        observations: OBSERVATION_DTYPE, IMU clock, ascending.
        ends_ns: as in `ObservationStream`; with the same times the batches of that run are repeated.
    """

    #: Nothing is tracked.
    busy_s = 0.0

    def __init__(self, observations: RecordArray, ends_ns: IntArray) -> None:
        self._observations = observations
        self._ends_ns = ends_ns
        self._batches = 0

    def __iter__(self) -> Iterator[RecordArray]:
        """Yield one batch for each interval: after the end of the previous interval, up to its own end."""
        for batch in islice(batches(self._observations, self._ends_ns), self._batches, None):
            self._batches += 1
            yield batch

    def request_state(self) -> None:
        """Ignored: the state is always available."""

    def state(self) -> SourceState | None:
        """The number of batches so far."""
        return SourceState(self._batches)

    def restore(self, state: SourceState, released: list[RecordArray]) -> None:
        """Continue after a number of batches."""
        self._batches = state.batches

    def set_outlier_share(self, share: float) -> None:
        """Ignored: these tracks exist already."""

    def observations(self) -> RecordArray:
        """All observations."""
        return self._observations

    def notes(self) -> tuple[str, ...]:
        """No notes: the run that tracked reported them."""
        return ()
