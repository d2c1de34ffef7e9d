# SPDX-License-Identifier: Apache-2.0
"""Parameters of an event sensor, with the sources of their defaults, and the state of its pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from asyneio.errors import SimulationError
from asyneio.types import CameraIntrinsics, FloatArray, IntArray


@dataclass(frozen=True)
class SensorSpec:
    """An event sensor. Thresholds in natural-log intensity, rates in Hz, times in seconds.

    The defaults resemble a DAVIS240C: in published recordings 43 to 45 % of the events are positive, and a
    pixel rarely emits two events within 1.5 ms. The value 0 disables an effect.

    Thresholds: `threshold_mismatch` is the standard deviation over the pixels, as a fraction (3.5 %: Brandli
    et al. 2014). `threshold_noise` is the standard deviation of the reference level that a pixel stores after
    each event (0.02: Joubert et al. 2021; ESIM, Rebecq et al. 2018, draws each threshold in a similar way).

    Time: `bandwidth_hz` is the cut-off frequency of the photoreceptor at white in full light. It is
    proportional to intensity down to `least_bandwidth_hz` (3 kHz at 1 klux: Lichtsteiner et al. 2008;
    proportional: Hu, Liu, Delbruck 2021; 0 for an ideal photoreceptor). `dark_intensity` is the intensity
    equivalent of the dark current. `latency_s` and `latency_jitter_s` are mean and standard deviation of the
    comparator's additional delay (100 and 30 us: Joubert et al. 2021). `refractory_s` is the time for which a
    pixel is blind after it.

    Noise of each pixel: `shot_noise_hz` is the rate of events of random polarity in the dark; it falls to a
    quarter in full light. `leak_hz` is the rate of positive events due to the leaking reset switch.
    `hot_pixels` pixels emit events at `hot_pixel_hz`.

    Readout (`readout.py`): `readout_hz` is the event rate of the array (12 million: Brandli et al. 2014), and
    `bus_hz` that of the bus (5 million over USB 2: Berner et al. 2007), which has a buffer for `bus_buffer`
    events (64 KiB, the default of the driver libcaer, at four bytes per event).
    """

    threshold_on: float = 0.25
    threshold_off: float = 0.22
    threshold_mismatch: float = 0.035
    threshold_noise: float = 0.02
    refractory_s: float = 0.0015
    latency_s: float = 100e-6
    latency_jitter_s: float = 30e-6
    shot_noise_hz: float = 0.2
    leak_hz: float = 0.05
    hot_pixels: int = 4
    hot_pixel_hz: float = 80.0
    bandwidth_hz: float = 4000.0
    least_bandwidth_hz: float = 30.0
    dark_intensity: float = 0.002
    readout_hz: float = 12e6
    bus_hz: float = 5e6
    bus_buffer: int = 16384

    def __post_init__(self) -> None:
        smallest = min(self.threshold_on, self.threshold_off)
        if smallest <= 0.0 or not 0.0 <= self.threshold_mismatch <= 0.2:
            raise SimulationError(
                f"thresholds {self.threshold_on} and {self.threshold_off} with a mismatch of "
                f"{self.threshold_mismatch}; expected positive thresholds and a mismatch of 0 to 0.2"
            )
        if not 0.0 <= self.threshold_noise <= 0.2 * smallest:
            raise SimulationError(
                f"threshold_noise = {self.threshold_noise} with thresholds of {self.threshold_on} and "
                f"{self.threshold_off}; expected 0 to a fifth of the smaller threshold"
            )
        others = (
            self.refractory_s,
            self.latency_s,
            self.latency_jitter_s,
            self.shot_noise_hz,
            self.leak_hz,
            self.hot_pixels,
            self.hot_pixel_hz,
            self.bandwidth_hz,
            self.dark_intensity,
            self.readout_hz,
            self.bus_hz,
        )
        if min(others) < 0.0 or self.least_bandwidth_hz <= 0.0 or self.bus_buffer < 1:
            raise SimulationError(
                f"{self} cannot be simulated; expected no negative value, a positive least_bandwidth_hz and "
                "a bus_buffer of at least one event"
            )


class Circuit(NamedTuple):
    """Parameters common to all pixels, as kernels take them.

    Rates are in 1/us (`bandwidth`, `least_bandwidth` in rad/us at an intensity of 1) and times in us; `noise`
    is the standard deviation of the stored reference level in log intensity.
    """

    bandwidth: float
    least_bandwidth: float
    dark: float
    leak: float
    refractory: float
    latency: float
    jitter: float
    noise: float

    @classmethod
    def of(cls, spec: SensorSpec) -> Circuit:
        """The circuit of a sensor."""
        return cls(
            2.0 * np.pi * 1e-6 * spec.bandwidth_hz,
            2.0 * np.pi * 1e-6 * spec.least_bandwidth_hz,
            spec.dark_intensity,
            1e-6 * spec.leak_hz,
            1e6 * spec.refractory_s,
            1e6 * spec.latency_s,
            1e6 * spec.latency_jitter_s,
            spec.threshold_noise,
        )


class Pixels(NamedTuple):
    """State of all pixels (K,), row by row, as kernels take it; times in microseconds since the start.

    Attributes:
        on, off: thresholds for positive and negative events.
        seen: last rendered intensity, without the lamp.
        target: log intensity at the input of the photoreceptor.
        level: output of the photoreceptor [log intensity].
        reference: reference level of the change detector [log intensity].
        error: error of the stored reference level [log intensity].
        blind_until: end of latency and refractory time.
        next_noise: time of the next noise event.
        noise_rate: rate of noise events [1/us].
        hot: whether the noise of a pixel does not depend on light.
        random: state of the pixel's own random generator. The events of a pixel therefore depend neither on
            other pixels nor on the order in which tiles are processed.
    """

    on: FloatArray
    off: FloatArray
    seen: NDArray[np.float32]
    target: FloatArray
    level: FloatArray
    reference: FloatArray
    error: FloatArray
    blind_until: FloatArray
    next_noise: FloatArray
    noise_rate: FloatArray
    hot: NDArray[np.bool_]
    random: NDArray[np.uint64]


class EventBuffer(NamedTuple):
    """Unsorted events: `t_us` (N,) since the start of the run, `pixel` (N,), `on` (N,) polarity."""

    t_us: IntArray
    pixel: NDArray[np.int32]
    on: NDArray[np.uint8]

    @classmethod
    def of_size(cls, size: int) -> EventBuffer:
        """An empty buffer for `size` events."""
        return cls(np.zeros(size, np.int64), np.zeros(size, np.int32), np.zeros(size, np.uint8))

    def between(self, first: int, end: int) -> EventBuffer:
        """A copy of the events from index `first` to `end`."""
        chosen = slice(first, end)
        return EventBuffer(self.t_us[chosen].copy(), self.pixel[chosen].copy(), self.on[chosen].copy())


def make_pixels(
    spec: SensorSpec,
    camera: CameraIntrinsics,
    intensity: NDArray[np.float32],
    illumination: float,
    rng: np.random.Generator,
) -> Pixels:
    """Pixels in the steady state for a constant image (H,W) under a constant illumination."""
    count = camera.width * camera.height
    spread = 1.0 + spec.threshold_mismatch * np.clip(rng.normal(size=(2, count)), -4.0, 4.0)
    hot = np.zeros(count, dtype=bool)
    hot[rng.choice(count, min(spec.hot_pixels, count), replace=False)] = True
    rate = np.where(hot, spec.hot_pixel_hz, spec.shot_noise_hz) * 1e-6
    with np.errstate(divide="ignore"):
        first = rng.exponential(size=count) / rate
    seen = intensity.astype(np.float32).ravel()
    target = np.log(illumination * seen.astype(np.float64) + spec.dark_intensity)
    return Pixels(
        spec.threshold_on * spread[0],
        spec.threshold_off * spread[1],
        seen,
        target,
        target.copy(),
        target.copy(),
        spec.threshold_noise * np.clip(rng.normal(size=count), -4.0, 4.0),
        np.full(count, -1.0),
        first,
        rate,
        hot,
        rng.integers(1, 2**63, size=count, dtype=np.uint64),
    )
