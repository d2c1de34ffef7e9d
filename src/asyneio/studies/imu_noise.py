# SPDX-License-Identifier: Apache-2.0
"""Levels of inertial noise used by several studies."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NoiseLevel:
    """Densities of white noise [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)]."""

    gyroscope: float
    accelerometer: float

    @property
    def assumed_gyroscope(self) -> float:
        """Density given to a method: at least a hundredth of that of a good MEMS unit."""
        return max(self.gyroscope, 1.7e-6)

    @property
    def assumed_accelerometer(self) -> float:
        """Density given to a method, as `assumed_gyroscope`."""
        return max(self.accelerometer, 2e-5)


#: No noise, a good, an inexpensive and a bad MEMS unit.
NOISE = {
    "none": NoiseLevel(0.0, 0.0),
    "low": NoiseLevel(1.7e-4, 2e-3),
    "medium": NoiseLevel(5e-4, 5e-3),
    "high": NoiseLevel(2e-3, 2e-2),
}
