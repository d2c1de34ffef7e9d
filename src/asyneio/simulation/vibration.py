"""Vibration of the housing of an IMU: a rotor's frequency and its harmonics, as true motion of the sensor.

What vibrates is a few micrometres and tenths of a milliradian (3 m/s^2 and 0.15 rad/s at 87 Hz: 10 um, 0.3
mrad), far below what a camera resolves; so the events, and the poses of the truth, are those of the mean
motion. To an IMU it is motion like any other: it goes through its low-pass filter and is aliased by its
sampling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import SimulationError
from asyneio.types import FloatArray


@dataclass(frozen=True)
class Vibration:
    """A fundamental frequency [Hz] and, for it and each of its harmonics, the amplitude on every axis.

    Attributes:
        fundamental_hz: such as the rotation of a rotor.
        acceleration: amplitudes of the first, second, ... harmonic [m/s^2].
        rate: likewise of the angular velocity [rad/s]; as many.

    Raises:
        SimulationError: a frequency that is not positive, or amplitudes that do not match or are negative.
    """

    fundamental_hz: float
    acceleration: tuple[float, ...]
    rate: tuple[float, ...]

    def __post_init__(self) -> None:
        amplitudes = (*self.acceleration, *self.rate)
        matching = len(self.acceleration) == len(self.rate) > 0
        if not (self.fundamental_hz > 0.0 and matching and min(amplitudes) >= 0.0):
            raise SimulationError(
                f"vibration at {self.fundamental_hz} Hz with amplitudes {self.acceleration} m/s^2 and "
                f"{self.rate} rad/s; expected a positive frequency and as many amplitudes, none negative, "
                "of the one as of the other"
            )


@dataclass(frozen=True)
class Tones:
    """Sums of sines, one per axis: frequencies (K,) [Hz], amplitudes (K,), phases (K,3) [rad]."""

    frequency_hz: FloatArray
    amplitude: FloatArray
    phase: FloatArray

    def at(self, t_s: FloatArray) -> FloatArray:
        """Values (N,3) at times (N,) [s]."""
        value = np.zeros((t_s.size, 3))
        for frequency, amplitude, phase in zip(self.frequency_hz, self.amplitude, self.phase, strict=True):
            if amplitude > 0.0:
                value += amplitude * np.sin((2.0 * np.pi * frequency * t_s)[:, None] + phase)
        return value


def draw_tones(vibration: Vibration | None, rng: np.random.Generator) -> tuple[Tones, Tones]:
    """Angular velocity [rad/s] and acceleration [m/s^2] of a vibration, phases at random; none of None."""
    if vibration is None:
        nothing = Tones(np.zeros(0), np.zeros(0), np.zeros((0, 3)))
        return nothing, nothing
    frequency_hz = vibration.fundamental_hz * np.arange(1.0, len(vibration.rate) + 1.0, dtype=np.float64)
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, frequency_hz.size, 3))
    return (
        Tones(frequency_hz, np.array(vibration.rate), phase[0]),
        Tones(frequency_hz, np.array(vibration.acceleration), phase[1]),
    )
