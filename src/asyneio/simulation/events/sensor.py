"""The pixels of an event camera: photoreceptor, change detector with thresholds, refractory time, noise.

A pixel remembers a level of log intensity and reports when the present level has moved from it by a
threshold. After an event it is blind for the refractory time and then remembers the level it finds, as the
real circuit does while its reset switch is closed; what happened meanwhile is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from asyneio.errors import SimulationError
from asyneio.types import CameraIntrinsics, FloatArray, IntArray

#: A pixel reports at most this often between two renderings; more would be a change of tens of log units.
MOST_PER_STEP = 128


@dataclass(frozen=True)
class SensorSpec:
    """An event sensor. Thresholds in natural-log intensity, rates in Hz per pixel, times in seconds.

    The defaults resemble a DAVIS240C: in published recordings 43 to 45 % of the events are "brighter", and a
    pixel hardly ever reports twice within 1.5 ms.

    `threshold_mismatch`: standard deviation over the pixels, as a fraction. `shot_noise_hz`: events of random
    polarity in the dark; a quarter of them in full light. `leak_hz`: how often the leaking reset switch alone
    makes a pixel report "brighter". `hot_pixels` report at `hot_pixel_hz`. `bandwidth_hz`: cut-off frequency
    of the photoreceptor at white in full light, proportional to intensity down to `least_bandwidth_hz`; 0 for
    an ideal one. `dark_intensity`: the intensity that dark current looks like.
    """

    threshold_on: float = 0.25
    threshold_off: float = 0.22
    threshold_mismatch: float = 0.035
    refractory_s: float = 0.0015
    shot_noise_hz: float = 0.2
    leak_hz: float = 0.05
    hot_pixels: int = 4
    hot_pixel_hz: float = 80.0
    bandwidth_hz: float = 4000.0
    least_bandwidth_hz: float = 30.0
    dark_intensity: float = 0.002

    def __post_init__(self) -> None:
        if min(self.threshold_on, self.threshold_off) <= 0.0 or not 0.0 <= self.threshold_mismatch <= 0.2:
            raise SimulationError(
                f"thresholds {self.threshold_on} and {self.threshold_off} with a mismatch of "
                f"{self.threshold_mismatch}; expected positive thresholds and a mismatch of 0 to 0.2"
            )
        others = (
            self.refractory_s,
            self.shot_noise_hz,
            self.leak_hz,
            self.hot_pixels,
            self.hot_pixel_hz,
            self.bandwidth_hz,
            self.dark_intensity,
        )
        if min(others) < 0.0 or self.least_bandwidth_hz <= 0.0:
            raise SimulationError(
                f"{self} cannot be simulated; expected no negative value and a positive least_bandwidth_hz"
            )


class Pixels(NamedTuple):
    """State of all pixels (K,), row by row, as kernels take it; times in microseconds since the start.

    `level` is the photoreceptor's output and `reference` what the pixel remembers, both in log intensity;
    `blind_until` ends the refractory time; `next_noise` is when noise strikes next, at `noise_rate` [1/us];
    `hot` tells which pixels' noise does not depend on light. `random` (1,) is a generator's state.
    """

    on: FloatArray
    off: FloatArray
    level: FloatArray
    reference: FloatArray
    blind_until: FloatArray
    next_noise: FloatArray
    noise_rate: FloatArray
    hot: NDArray[np.bool_]
    random: NDArray[np.uint64]


class EventBuffer(NamedTuple):
    """Events before they are sorted: `t_us` (N,) since the start of the run, `pixel` (N,), `on` (N,)."""

    t_us: IntArray
    pixel: NDArray[np.int32]
    on: NDArray[np.uint8]

    @classmethod
    def of_size(cls, size: int) -> EventBuffer:
        """Room for some events; more than `MOST_PER_STEP`."""
        return cls(np.zeros(size, np.int64), np.zeros(size, np.int32), np.zeros(size, np.uint8))

    def first(self, count: int) -> EventBuffer:
        """A copy of the first events."""
        return EventBuffer(self.t_us[:count].copy(), self.pixel[:count].copy(), self.on[:count].copy())


def make_pixels(
    spec: SensorSpec, camera: CameraIntrinsics, intensity: NDArray[np.float32], rng: np.random.Generator
) -> Pixels:
    """Pixels that have looked at a still picture (H,W) for long."""
    count = camera.width * camera.height
    spread = 1.0 + spec.threshold_mismatch * np.clip(rng.normal(size=(2, count)), -4.0, 4.0)
    hot = np.zeros(count, dtype=bool)
    hot[rng.choice(count, min(spec.hot_pixels, count), replace=False)] = True
    rate = np.where(hot, spec.hot_pixel_hz, spec.shot_noise_hz) * 1e-6
    with np.errstate(divide="ignore"):
        first = rng.exponential(size=count) / rate
    level = np.log(intensity.ravel() + np.float32(spec.dark_intensity)).astype(np.float64)
    seed = rng.integers(1, 2**63, size=1, dtype=np.uint64)
    return Pixels(
        spec.threshold_on * spread[0],
        spec.threshold_off * spread[1],
        level,
        level.copy(),
        np.full(count, -1.0),
        first,
        rate,
        hot,
        seed,
    )


@njit(cache=True)
def _uniform(state: NDArray[np.uint64]) -> float:
    """A number in (0, 1] from a generator of our own (xorshift64*): its state travels with the run."""
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    return ((x * np.uint64(0x2545F4914F6CDD1D)) >> np.uint64(11)) / 9007199254740992.0 + 1.2e-16


@njit(cache=True, error_model="numpy")
def respond(
    intensity: NDArray[np.float32],
    illumination: float,
    corner: tuple[int, int],
    side: int,
    span: tuple[float, float],
    lag: tuple[float, float, float],
    leak_per_us: float,
    refractory_us: float,
    pixels: Pixels,
    buffer: EventBuffer,
    count: int,
) -> int:
    """Let a square of pixels see what `intensity` (H,W) has become within `span` = (t0, t1) us.

    Log intensity is linear in between. `corner` is the top row and left column of the square. `lag` =
    (bandwidth [rad/us] at white, least bandwidth, dark intensity). Events go into `buffer` from `count` on;
    returns the new count.
    """
    on, off, levels, references, blind_until, next_noise, noise_rate, hot, random = pixels
    out_t, out_pixel, out_on = buffer
    bandwidth, least_bandwidth, dark = lag
    t0, t1 = span
    dt = t1 - t0
    height, width = intensity.shape
    for v in range(corner[0], min(corner[0] + side, height)):
        for u in range(corner[1], min(corner[1] + side, width)):
            k = v * width + u
            light = illumination * intensity[v, u] + dark
            a = levels[k]
            b = float(np.log(np.float32(light)))
            if bandwidth > 0.0:
                gain = dt * max(bandwidth * light, least_bandwidth)
                b = a + (b - a) * gain / (1.0 + gain)
            levels[k] = b
            if blind_until[k] > t1:
                continue
            slope = (b - a) / dt
            t = t0
            reference = references[k] - leak_per_us * dt * on[k]
            if blind_until[k] > t0:
                t = blind_until[k]
                reference = a + slope * (t - t0)
            for _ in range(MOST_PER_STEP):
                crossing, up = np.inf, False
                if b >= reference + on[k]:
                    up = True
                    crossing = t if slope <= 0.0 else max(t, t0 + (reference + on[k] - a) / slope)
                elif b <= reference - off[k]:
                    crossing = t if slope >= 0.0 else max(t, t0 + (reference - off[k] - a) / slope)
                if next_noise[k] < min(crossing, t1):
                    strikes = max(next_noise[k], t)
                    blind = next_noise[k] < t
                    next_noise[k] = strikes - np.log(_uniform(random)) / noise_rate[k]
                    # Shot noise is strongest in the dark; a blind pixel reports none.
                    if blind or (not hot[k] and _uniform(random) < 0.75 * min(1.0, light)):
                        continue
                    t = strikes
                    up = _uniform(random) < 0.5
                    reference = a + slope * (t - t0)
                elif crossing <= t1:
                    t = crossing
                    reference += on[k] if up else -off[k]
                else:
                    break
                out_t[count] = int(t)
                out_pixel[count] = k
                out_on[count] = 1 if up else 0
                count += 1
                if refractory_us > 0.0:
                    blind_until[k] = t + refractory_us
                    if blind_until[k] > t1:
                        break
                    t = blind_until[k]
                    reference = a + slope * (t - t0)
            references[k] = reference
    return count
