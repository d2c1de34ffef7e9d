# SPDX-License-Identifier: Apache-2.0
"""Online estimate of an inertial sensor's noise, from frequencies above the bandwidth of the trajectory.

The motion of a hand or a vehicle lies below the highest frequency that a trajectory with knots every `T`
seconds can follow, `BAND / T`. Whatever the samples contain above it is noise: electronics, quantisation,
rotors, an engine. Its power spectrum is averaged over overlapping blocks of half a second (Welch's method,
IEEE Trans. Audio Electroacoust. 1967) with exponentially decaying weights.

Below that frequency noise cannot be separated from motion. White noise extends below it, so the quietest part
of the two octaves above raises the density that is assumed below; peaks of vibration do not. The density is
never lower than the declared one times `inertial.noise_inflation`: scale, alignment and bias errors of a real
sensor change with the motion and do not appear above the band.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from asyneio.inertial.noise import SensorNoise
from asyneio.inertial.stationarity import possible
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, FloatArray, RecordArray

#: A trajectory with knots `T` apart follows frequencies up to `BAND / T`: three unknowns per axis and
#: interval describe one and a half periods, and the motion prior reduces that.
BAND = 2.0
#: Length of a block [s], and the time between the starts of blocks.
_BLOCK_S, _HOP_S = 0.5, 0.25
#: Time constant of the average of the spectrum [s].
_MEMORY_S = 2.0
#: A gap of more than this many sample periods discards a block.
_PAUSE_PERIODS = 8.0
#: Number of values over which the spectrum is smoothed before its minimum is found; range of the search, in
#: multiples of the band's upper end.
_SMOOTH, _QUIET_UP_TO = 5, 4.0
#: Minimum number of values of the spectrum above the band.
_LEAST_VALUES = 5
#: Minimum number of samples of a block.
_LEAST_SAMPLES = 16
#: A density below that of any sensor.
_NOT_KNOWN = 1e-30
#: Slow motion is removed from a block as a polynomial of this degree.
_DEGREE = 3


class NoiseLearner:
    """Estimates the noise of one sensor from its samples.

    Args:
        interval_s: time between knots.
    """

    def __init__(self, interval_s: float) -> None:
        self._band_hz = BAND / interval_s
        self._held: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self._rate_hz = 1.0
        self._blocks = 0
        self._frequency_hz: FloatArray = np.empty(0)
        self._power: FloatArray = np.empty(0)
        #: Results since the last samples, by the smallest density requested.
        self._known: dict[float, SensorNoise] = {}

    def append(self, samples: RecordArray) -> None:
        """Add samples (INERTIAL_DTYPE), ascending in time; if time jumps back, start again."""
        self._known.clear()
        held, samples = self._held, samples[possible(samples["xyz"])]
        if len(held) and len(samples) and samples["t_ns"][0] <= held["t_ns"][-1]:
            held = held[:0]
        self._held = np.concatenate([held, samples])
        if len(self._held) > 1:
            self._rate_hz = NS_PER_S / float(max(np.median(np.diff(self._held["t_ns"])), 1.0))
        block_ns, hop_ns = round(_BLOCK_S * NS_PER_S), round(_HOP_S * NS_PER_S)
        while len(self._held) and self._held["t_ns"][-1] - self._held["t_ns"][0] >= block_ns:
            stamps = self._held["t_ns"]
            self._learn(self._held[: np.searchsorted(stamps, stamps[0] + block_ns, side="right")])
            self._held = self._held[np.searchsorted(stamps, stamps[0] + hop_ns) :]

    def noise(self, least_density: float) -> SensorNoise:
        """The noise of the samples; its white noise has at least this density [unit/sqrt(Hz)], which is
        assumed until the spectrum is known."""
        if least_density not in self._known:
            self._known[least_density] = self._noise(least_density)
        return self._known[least_density]

    def measured_density(self) -> float:
        """White noise density of the samples [unit/sqrt(Hz)] without a least value; 0: not known yet."""
        found = self.noise(_NOT_KNOWN).density
        return found if found > _NOT_KNOWN else 0.0

    def _noise(self, least_density: float) -> SensorNoise:
        rate_hz = self._rate_hz
        above = self._frequency_hz > self._band_hz
        if self._blocks == 0 or np.count_nonzero(above) < _LEAST_VALUES:
            return SensorNoise(least_density, rate_hz)
        frequency_hz, power = self._frequency_hz[above], self._power[above]
        # Density of the white noise with the same power in one bin of the spectrum.
        density_square = power / (2.0 * (frequency_hz[1] - frequency_hz[0]))
        smooth = np.convolve(density_square, np.ones(_SMOOTH) / _SMOOTH, mode="valid")
        near = frequency_hz[_SMOOTH // 2 : len(smooth) + _SMOOTH // 2] <= _QUIET_UP_TO * self._band_hz
        white_square = max(least_density**2, float(smooth[near].min()))
        excess = power * np.maximum(1.0 - white_square / np.maximum(density_square, 1e-300), 0.0)
        loud = excess > 0.0
        return SensorNoise(float(np.sqrt(white_square)), rate_hz, frequency_hz[loud], excess[loud])

    def _learn(self, block: RecordArray) -> None:
        """Include the spectrum of a block in the average."""
        t = (block["t_ns"] - block["t_ns"][0]) / NS_PER_S
        steps = np.diff(t)
        period = float(np.median(steps))
        if steps.max() > _PAUSE_PERIODS * period:
            return
        n = round(_BLOCK_S / period)
        if n < _LEAST_SAMPLES:
            return
        even = np.arange(n) * _BLOCK_S / n
        value = np.column_stack([np.interp(even, t, block["xyz"][:, axis]) for axis in range(3)])
        frequency_hz, power = _spectrum(value, _BLOCK_S)
        if len(power) != len(self._power):
            # The rate has changed: restart the average.
            self._blocks, self._frequency_hz, self._power = 0, frequency_hz, np.zeros(len(power))
        self._blocks += 1
        self._power += max(1.0 / self._blocks, _HOP_S / _MEMORY_S) * (power - self._power)


def _spectrum(value: FloatArray, seconds: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies (F,) [Hz] and the variance around each (F,), mean of the axes of `value` (N,3)."""
    n = len(value)
    slow, window = _slow_and_window(n)
    value = value - slow @ (slow.T @ value)
    square = np.abs(np.fft.rfft(window[:, None] * value, axis=0)) ** 2
    power = 2.0 * square.mean(axis=1) / (n * np.sum(window**2))
    return np.arange(len(power)) / seconds, power


@lru_cache(maxsize=4)
def _slow_and_window(n: int) -> tuple[FloatArray, FloatArray]:
    """Orthonormal polynomials (n,_DEGREE+1) of slow motion in a block of n samples, and its window (n,)."""
    slow = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), _DEGREE)
    return np.linalg.qr(slow)[0], np.hanning(n + 1)[:-1]
