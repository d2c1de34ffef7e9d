"""What pixels do between two renderings: photoreceptor, change detector, latency, refractory time, noise.

A pixel remembers a level of log intensity and reports when the present level has moved from it by a
threshold. The comparator answers after a latency; then the pixel is blind for the refractory time and
remembers the level it finds at the end, as the real circuit does while its reset switch is closed; what
happened meanwhile is lost.

The intensity of a pixel is linear in time between two renderings, times the light of the lamp. It is taken
in parts within which its logarithm may be taken for linear. The photoreceptor is a first-order low-pass
filter of the log intensity, `dv/dt = w (x - v)`; for `x = x0 + q t` its response to the ramp is exact,

    v(t) = x0 - q / w + q t + (v0 - x0 + q / w) exp(-w t),

with `w` that of the mean light of the part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from asyneio.simulation.events.sensor import Circuit, EventBuffer, Pixels
from asyneio.types import FloatArray

#: A pixel reports at most this often between two renderings; more would be a change of tens of log units.
MOST_PER_STEP = 128
#: Within a part of a step log intensity changes by no more than this ...
_LOG_PART = 0.25
#: ... and the lamp by no more than this share of a period.
_PARTS_PER_PERIOD = 32.0
#: Crossings of thresholds are found to this accuracy [us].
_TOLERANCE_US = 0.05


class Light(NamedTuple):
    """Light on everything: `illumination`; of it the share `depth` flickers as a rectified sine at `rate`
    [1/us], which is twice the mains frequency. Its mean is `illumination`."""

    illumination: float
    rate: float
    depth: float


class Curve(NamedTuple):
    """A photoreceptor's output from `begin` [us] on: `offset + slope t + swing exp(-rate t)`."""

    begin: float
    offset: float
    slope: float
    swing: float
    rate: float


@njit(cache=True, error_model="numpy")
def light_at(light: Light, t_us: float) -> float:
    """Intensity of the light at a time; that of the mean at the start of a run."""
    if light.depth == 0.0 or light.rate == 0.0:
        return light.illumination
    lamp = 0.5 * np.pi * abs(np.sin(np.pi * light.rate * t_us + np.arcsin(2.0 / np.pi)))
    return light.illumination * (1.0 - light.depth + light.depth * lamp)


@njit(cache=True, inline="always")
def _uniform(state: NDArray[np.uint64], k: int) -> float:
    """A number in (0, 1] from a generator of our own (xorshift64*): its state travels with the pixel."""
    x = state[k]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[k] = x
    return ((x * np.uint64(0x2545F4914F6CDD1D)) >> np.uint64(11)) / 9007199254740992.0 + 1.2e-16


@njit(cache=True, error_model="numpy")
def _normal(state: NDArray[np.uint64], k: int) -> float:
    """A number of the normal distribution, no more than four standard deviations from zero (Box-Muller)."""
    radius = np.sqrt(-2.0 * np.log(_uniform(state, k)))
    return min(max(radius * np.cos(2.0 * np.pi * _uniform(state, k)), -4.0), 4.0)


@njit(cache=True, error_model="numpy", inline="always")
def curve_value(curve: Curve, t: float) -> float:
    """The photoreceptor's output at a time [us]."""
    since = t - curve.begin
    level = curve.offset + curve.slope * since
    if curve.swing != 0.0:
        level += curve.swing * np.exp(-curve.rate * since)
    return level


@njit(cache=True, error_model="numpy")
def _solve(curve: Curve, low: float, high: float, value: float) -> float:
    """When a curve that is monotonic between two times takes a value that lies between theirs (Illinois)."""
    f_low, f_high = curve_value(curve, low) - value, curve_value(curve, high) - value
    last, middle = 0, high
    while high - low > _TOLERANCE_US:
        middle = low - f_low * (high - low) / (f_high - f_low)
        if not low < middle < high:
            # Rounded to an end: the curve is as good as straight from there.
            return min(max(middle, low), high)
        f = curve_value(curve, middle) - value
        if (f > 0.0) == (f_high > 0.0):
            shorter, high, f_high = high - middle, middle, f
            f_low *= 0.5 if last == 1 else 1.0
            last = 1
        else:
            shorter, low, f_low = middle - low, middle, f
            f_high *= 0.5 if last == -1 else 1.0
            last = -1
        if shorter < _TOLERANCE_US:
            break
    return middle


@njit(cache=True, error_model="numpy")
def first_crossing(curve: Curve, begin: float, end: float, upper: float, lower: float) -> tuple[float, int]:
    """When a curve first leaves the range between two values within `begin` .. `end`, and whether upwards (1)
    or downwards (-1); inf and 0 where it does not."""
    turn = end
    if curve.swing != 0.0:
        # The one extreme that it may have is where slope and decay cancel.
        ratio = curve.slope / (curve.swing * curve.rate)
        if 0.0 < ratio < 1.0:
            extreme = curve.begin - np.log(ratio) / curve.rate
            if begin < extreme < end:
                turn = extreme
    while True:
        level = curve_value(curve, begin)
        if level >= upper:
            return begin, 1
        if level <= lower:
            return begin, -1
        level = curve_value(curve, turn)
        if level >= upper:
            return _solve(curve, begin, turn, upper), 1
        if level <= lower:
            return _solve(curve, begin, turn, lower), -1
        if turn == end:
            return np.inf, 0
        begin, turn = turn, end


@njit(cache=True, error_model="numpy")
def _report(
    k: int,
    begin: float,
    end: float,
    curve: Curve,
    light: float,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
    count: int,
    most: int,
) -> int:
    """Events of pixel `k` while its photoreceptor follows a curve from `begin` to `end`; returns the new
    count, at most `most`."""
    t, reference = begin, pixels.reference[k]
    if pixels.blind_until[k] > begin:
        t = pixels.blind_until[k]
        reference = curve_value(curve, t)
    while count < most:
        remembered = reference + pixels.error[k]
        crossing, way = first_crossing(curve, t, end, remembered + pixels.on[k], remembered - pixels.off[k])
        up = way > 0
        if pixels.next_noise[k] < min(crossing, end):
            strikes = max(pixels.next_noise[k], t)
            blind = pixels.next_noise[k] < t
            pixels.next_noise[k] = strikes - np.log(_uniform(pixels.random, k)) / pixels.noise_rate[k]
            # Shot noise is strongest in the dark; a blind pixel reports none.
            if blind or (not pixels.hot[k] and _uniform(pixels.random, k) < 0.75 * min(1.0, light)):
                continue
            t = strikes
            up = _uniform(pixels.random, k) < 0.5
            reference = curve_value(curve, t)
        elif way != 0:
            t = crossing
            reference += pixels.on[k] if up else -pixels.off[k]
        else:
            break
        answer = t
        if circuit.latency > 0.0 or circuit.jitter > 0.0:
            answer += max(0.0, circuit.latency + circuit.jitter * _normal(pixels.random, k))
        if circuit.noise > 0.0:
            pixels.error[k] = circuit.noise * _normal(pixels.random, k)
        buffer.t_us[count] = int(answer)
        buffer.pixel[count] = k
        buffer.on[count] = 1 if up else 0
        count += 1
        ready = answer + circuit.refractory
        if ready > t:
            pixels.blind_until[k] = ready
            if ready > end:
                break
            t = ready
            reference = curve_value(curve, t)
    pixels.reference[k] = reference
    return count


@njit(cache=True, error_model="numpy", inline="always")
def _decay(g: float) -> float:
    """`exp(-g)` for g >= 0 to 1e-5, at a quarter of the cost: the eighth power of a Pade approximation."""
    if g > 16.0:
        return 0.0
    y = 0.125 * g
    square = y * y * (1.0 / 12.0)
    once = (1.0 - 0.5 * y + square) / (1.0 + 0.5 * y + square)
    twice = once * once
    fourth = twice * twice
    return fourth * fourth


@njit(cache=True, error_model="numpy")
def _in_parts(
    k: int,
    now: float,
    lamp: FloatArray,
    span: tuple[float, float],
    parts: int,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
    count: int,
) -> int:
    """Let pixel `k` go from the intensity that it has seen to `now` in equal parts of a step, `lamp` being
    the light at equal distances within it; returns the new count of events."""
    seen, x, level = pixels.seen[k], pixels.target[k], pixels.level[k]
    pixels.seen[k] = now
    dt, intervals = (span[1] - span[0]) / parts, lamp.size - 1
    brightness = lamp[0] * seen + circuit.dark
    most = count + MOST_PER_STEP
    for part in range(parts):
        begin, end = span[0] + part * dt, span[0] + (part + 1) * dt
        share = (part + 1.0) / parts
        place = share * intervals
        j = min(int(place), intervals - 1)
        lit = lamp[j] + (place - j) * (lamp[j + 1] - lamp[j])
        before, brightness = brightness, lit * (seen + share * (now - seen)) + circuit.dark
        x_begin, x = x, np.log(brightness)
        slope = (x - x_begin) / dt
        swing, rate, lag = 0.0, 0.0, 0.0
        if circuit.bandwidth > 0.0:
            rate = max(circuit.bandwidth * 0.5 * (before + brightness), circuit.least_bandwidth)
            lag = slope / rate
            swing = level - x_begin + lag
            level = x - lag + swing * np.exp(-rate * dt)
        else:
            level = x
        if pixels.blind_until[k] > end:
            continue
        pixels.reference[k] -= circuit.leak * dt * pixels.on[k]
        curve = Curve(begin, x_begin - lag, slope, swing, rate)
        count = _report(k, begin, end, curve, brightness, circuit, pixels, buffer, count, most)
    pixels.target[k], pixels.level[k] = x, level
    return count


@njit(cache=True, error_model="numpy")
def respond(
    intensity: NDArray[np.float32],
    light: Light,
    corner: tuple[int, int],
    side: int,
    span: tuple[float, float],
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
    count: int,
) -> int:
    """Let a square of pixels see what `intensity` (H,W) has become within `span` = (t0, t1) us.

    `corner` is the top row and left column of the square. Events go into `buffer` from `count` on, which has
    room for `MOST_PER_STEP` from each pixel; returns the new count. Events lie up to a latency after t1.
    """
    on, off, seen, target, levels, reference, error, blind_until, next_noise, _, _, _ = pixels
    bandwidth, least_bandwidth, dark = circuit.bandwidth, circuit.least_bandwidth, circuit.dark
    t0, t1 = span
    dt = t1 - t0
    per_dt = 1.0 / dt
    leak = circuit.leak * dt
    height, width = intensity.shape
    parts = 1
    if light.depth > 0.0:
        parts = max(1, int(np.ceil(_PARTS_PER_PERIOD * light.rate * dt)))
    lamp = np.empty(parts + 1)
    for j in range(parts + 1):
        lamp[j] = light_at(light, t0 + dt * j / parts)
    lit_before, lit = lamp[0], lamp[parts]
    for v in range(corner[0], min(corner[0] + side, height)):
        for u in range(corner[1], min(corner[1] + side, width)):
            k = v * width + u
            now = intensity[v, u]
            brightness = lit * now + dark
            x0, level0 = target[k], levels[k]
            x = float(np.log(np.float32(brightness)))
            change = x - x0
            if parts > 1 or abs(change) > _LOG_PART:
                finer = 1 + int(abs(change) / (_LOG_PART * parts))
                count = _in_parts(k, now, lamp, span, parts * finer, circuit, pixels, buffer, count)
                continue
            rate, lag, swing, level = 0.0, 0.0, 0.0, x
            if bandwidth > 0.0:
                mean = 0.5 * (lit_before * seen[k] + dark + brightness)
                rate = max(bandwidth * mean, least_bandwidth)
                gain = rate * dt
                lag = change / gain
                swing = level0 - x0 + lag
                level = x - lag + swing * _decay(gain)
            seen[k], target[k], levels[k] = now, x, level
            if blind_until[k] > t1:
                continue
            remembered = reference[k] - leak * on[k]
            reference[k] = remembered
            remembered += error[k]
            # Most of the time nothing happens, and then this is all. The level turns within the step where it
            # is on the other side of its target at the end.
            if (
                max(level0, level) < remembered + on[k]
                and min(level0, level) > remembered - off[k]
                and (x0 - level0) * (x - level) >= 0.0
                and next_noise[k] >= t1
                and blind_until[k] <= t0
            ):
                continue
            curve = Curve(t0, x0 - lag, change * per_dt, swing, rate)
            count = _report(
                k, t0, t1, curve, brightness, circuit, pixels, buffer, count, count + MOST_PER_STEP
            )
    return count
