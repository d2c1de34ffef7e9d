# SPDX-License-Identifier: Apache-2.0
"""Vibration of the IMU housing: a rotor's frequency and its harmonics, as true motion of the sensor.

The amplitudes are a few micrometres and tenths of a milliradian (3 m/s^2 and 0.15 rad/s at 87 Hz: 10 um, 0.3
mrad), far below the resolution of a camera. Events and true poses are therefore those of the mean motion. For
the IMU, vibration is motion: it passes the low-pass filter and is aliased by the sampling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import SimulationError
from asyneio.types import FloatArray


@dataclass(frozen=True)
class Vibration:
    """A fundamental frequency, and the amplitudes of it and its harmonics on every axis.

    Attributes:
        fundamental_hz: fundamental frequency, such as that of a rotor [Hz].
        acceleration: amplitudes of the first, second, ... harmonic [m/s^2].
        rate: amplitudes of the angular velocity [rad/s], of the same number.

    Raises:
        SimulationError: the frequency is not positive, or amplitudes are negative or differ in number.
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
                f"{self.rate} rad/s; expected a positive frequency and equal numbers of amplitudes, "
                "none of them negative"
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
    """Angular velocity [rad/s] and acceleration [m/s^2] of a vibration with random phases; None for None."""
    if vibration is None:
        nothing = Tones(np.zeros(0), np.zeros(0), np.zeros((0, 3)))
        return nothing, nothing
    frequency_hz = vibration.fundamental_hz * np.arange(1.0, len(vibration.rate) + 1.0, dtype=np.float64)
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, frequency_hz.size, 3))
    return (
        Tones(frequency_hz, np.array(vibration.rate), phase[0]),
        Tones(frequency_hz, np.array(vibration.acceleration), phase[1]),
    )
