# SPDX-License-Identifier: Apache-2.0
"""Held samples: a sensor that updates its value less often than it is read repeats each reading.

A repeated reading is the same measurement and contains no information. The accelerometer of the DAVIS240, for
instance, is updated at 1 kHz and read at 2.3 kHz, so that each of its values appears two or three times.

A single repeated reading proves nothing: readings are quantised, and a sensor that hardly moves can measure
the same value twice, or hundreds of times when stationary. The two cases differ in the length of runs of
equal readings. A held value lasts `k` readings or, if the rates are not multiples of each other, `k` or
`k + 1`, never fewer and never more; chance produces runs of all lengths, mostly short ones. Therefore no
reading is dropped until holding is proven. A value that lasts longer than the sensor holds one has been
measured again: one reading per hold period is kept, so that a long stationary phase is not a gap.

A row with stamp and values of the row before is a duplicate, not a reading, and is dropped and counted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from asyneio.types import INERTIAL_DTYPE, NS_PER_S, BoolArray, IntArray, Packet, RecordArray

#: Number of runs and of time steps that are kept.
_MEMORY = 200
#: Fraction of the runs that may be shorter or longer than a held value lasts: samples get lost.
_EXCEPTIONS = 0.05
#: Number of complete runs that prove holding if every value repeats: by chance, eight runs of two or three
#: readings and no others have a probability of at most 4e-4.
_ENOUGH = 8
#: If some values do not repeat, nearly all runs must have one or two readings, and this fraction of them two:
#: by chance an eighth of the runs would then have three or more readings.
_LEAST_REPEATS = 0.35
#: Fraction of shorter runs that disproves holding.
_DISPROOF = 0.1


@dataclass(frozen=True)
class _Hold:
    """A value lasts `shortest` or `longest` readings, `mean` of them on average."""

    shortest: int
    longest: int
    mean: float


_NOT_HELD = _Hold(1, 1, 1.0)


class Renewals:
    """Passes each updated reading of one sensor once, at the time when it was first read.

    `rate_hz` is the rate of the updates, 1 Hz before the second sample. `duplicates`: number of the newest
    rows that were dropped because they are equal to the row before.
    """

    def __init__(self) -> None:
        self.duplicates = 0
        self._hold = _NOT_HELD
        self._lengths: IntArray = np.empty(0, dtype=np.int64)
        self._steps_ns: IntArray = np.empty(0, dtype=np.int64)
        self._last: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        #: Length of the current run; 0 in the first one, -1 before it.
        self._running = -1
        self._kept_ns = 0

    @property
    def rate_hz(self) -> float:
        """Rate of the updated readings [Hz]."""
        if self._steps_ns.size == 0:
            return 1.0
        return NS_PER_S / (max(float(np.median(self._steps_ns)), 1.0) * self._hold.mean)

    @property
    def held(self) -> bool:
        """Whether readings are known to be held."""
        return self._hold.longest > 1

    def passed(self, samples: RecordArray) -> RecordArray:
        """The samples (INERTIAL_DTYPE) without those that repeat a held value."""
        samples = self._without_duplicates(samples)
        if len(samples) == 0:
            return samples
        rows = np.concatenate([self._last, samples])
        same = (rows["xyz"][1:] == rows["xyz"][:-1]).all(axis=1)
        if len(self._last) == 0:
            same = np.append(False, same)
        self._last = samples[-1:]
        steps_ns = np.diff(rows["t_ns"])
        self._steps_ns = np.concatenate([self._steps_ns, steps_ns[steps_ns > 0]])[-_MEMORY:]
        self._count(same)
        self._hold = _judged(self._lengths, self._hold)
        if not self.held:
            self._kept_ns = int(samples["t_ns"][-1])
            return samples
        return samples[self._renewed(samples["t_ns"], same)]

    def _without_duplicates(self, samples: RecordArray) -> RecordArray:
        rows = np.concatenate([self._last, samples])
        new = rows[1:] != rows[:-1]
        if len(self._last) == 0 and len(samples):
            new = np.append(True, new)
        self.duplicates = int(len(new) - new.sum())
        return samples if new.all() else samples[new]

    def _count(self, same: BoolArray) -> None:
        """Add the runs that ended, except the first one, which may have started before the recording."""
        begins = np.flatnonzero(~same)
        if self._running < 0:
            begins, self._running = begins[1:], 0
        if begins.size == 0:
            self._running += len(same) if self._running else 0
            return
        ended = np.diff(begins)
        if self._running:
            ended = np.append(self._running + begins[0], ended)
        self._running = len(same) - int(begins[-1])
        self._lengths = np.concatenate([self._lengths, ended])[-_MEMORY:]

    def _renewed(self, t_ns: IntArray, same: BoolArray) -> BoolArray:
        """Which samples to keep of a sensor that holds its values: new values, and values that have lasted
        longer than they are held."""
        keep = ~same
        hold_ns = (self._hold.longest - 0.5) * float(np.median(self._steps_ns))
        kept_ns = self._kept_ns
        for i, t in enumerate(t_ns.tolist()):
            # The clock may have jumped back.
            keep[i] |= not 0 <= t - kept_ns < hold_ns
            if keep[i]:
                kept_ns = t
        self._kept_ns = kept_ns
        return keep


class RenewedPackets:
    """Removes repeated readings of both sensors, packet by packet."""

    def __init__(self) -> None:
        self._gyroscope, self._accelerometer = Renewals(), Renewals()

    @property
    def duplicates(self) -> int:
        """Number of rows of the newest packet that were dropped because they are equal to the row before."""
        return self._gyroscope.duplicates + self._accelerometer.duplicates

    @property
    def rates_hz(self) -> tuple[float, float]:
        """Rates of the updated readings [Hz]: gyroscope, accelerometer."""
        return self._gyroscope.rate_hz, self._accelerometer.rate_hz

    def passed(self, packet: Packet) -> Packet:
        """The packet without samples that repeat a held value."""
        gyroscope = self._gyroscope.passed(packet.gyroscope)
        accelerometer = self._accelerometer.passed(packet.accelerometer)
        if gyroscope is packet.gyroscope and accelerometer is packet.accelerometer:
            return packet
        return replace(packet, gyroscope=gyroscope, accelerometer=accelerometer)


def _judged(lengths: IntArray, before: _Hold) -> _Hold:
    """How long values are held, from the lengths (N,) of the last runs of equal readings."""
    if lengths.size < _ENOUGH or (before == _NOT_HELD and lengths.max() == 1):
        return before
    # The shortest length that is not an exception.
    shortest = int(np.sort(lengths)[int(_EXCEPTIONS * lengths.size)])
    usual = lengths[(lengths == shortest) | (lengths == shortest + 1)]
    if usual.size >= (1.0 - _EXCEPTIONS) * lengths.size:
        longer = float(np.mean(usual > shortest))
        proven = shortest > 1 or (lengths.size == _MEMORY and longer >= _LEAST_REPEATS)
        if proven:
            return _Hold(shortest, shortest + (longer > _EXCEPTIONS), float(usual.mean()))
    if float(np.mean(lengths < before.shortest)) > _DISPROOF:
        return _NOT_HELD
    # Two thirds of runs of one reading do not indicate values held for one or two readings.
    if before.shortest == 1 and float(np.mean(lengths > before.longest)) > _DISPROOF:
        return _NOT_HELD
    return before
