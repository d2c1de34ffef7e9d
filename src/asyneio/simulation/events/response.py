# SPDX-License-Identifier: Apache-2.0
"""Response of pixels between two renderings: photoreceptor, change detector, latency, refractory time, noise.

A pixel stores a reference level of log intensity and emits an event when the current level differs from it by
a threshold. The comparator responds after a latency. The pixel is then blind for the refractory time, and its
new reference is the level at the end of this time, as in the real circuit while the reset switch is closed.
Changes during the blind time are lost.

The intensity of a pixel is linear in time between two renderings, times the light of the lamp. Each step is
divided into parts in which its logarithm is nearly linear. The photoreceptor is a first-order low-pass filter
of the log intensity, `dv/dt = w (x - v)`. For `x = x0 + q t`, its response is

    v(t) = x0 - q / w + q t + (v0 - x0 + q / w) exp(-w t),

with `w` from the mean light of the part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from asyneio.jit import njit
from asyneio.simulation.events.sensor import Circuit, EventBuffer, Pixels
from asyneio.types import FloatArray

#: Maximum number of events of a pixel between two renderings; more would need a change of tens of log units.
MAX_EVENTS_PER_STEP = 128
#: Maximum change of log intensity within a part of a step, ...
_LOG_PART = 0.25
#: ... and minimum number of parts in a period of the lamp.
_PARTS_PER_PERIOD = 32.0
#: Accuracy of the times of threshold crossings [us].
_TOLERANCE_US = 0.05


class Light(NamedTuple):
    """Light on the whole scene, with the mean `illumination`.

    The fraction `depth` of it flickers as a rectified sine at `rate` [1/us], twice the mains frequency.
    """

    illumination: float
    rate: float
    depth: float


class Curve(NamedTuple):
    """Output of a photoreceptor from `begin` [us] on: `offset + slope t + swing exp(-rate t)`."""

    begin: float
    offset: float
    slope: float
    swing: float
    rate: float


class Span(NamedTuple):
    """A step from one rendering to the next [us]."""

    begin: float
    end: float


class Square(NamedTuple):
    """A square of pixels: its top row, left column and side."""

    top: int
    left: int
    side: int


@njit(cache=True, error_model="numpy")
def light_at(light: Light, t_us: float) -> float:
    """Intensity of the light at a time [us]; equal to its mean at time 0."""
    if light.depth == 0.0 or light.rate == 0.0:
        return light.illumination
    lamp = 0.5 * np.pi * abs(np.sin(np.pi * light.rate * t_us + np.arcsin(2.0 / np.pi)))
    return light.illumination * (1.0 - light.depth + light.depth * lamp)


@njit(cache=True, inline="always")
def _uniform(state: NDArray[np.uint64], k: int) -> float:
    """A uniform number in (0, 1] from the generator of pixel k (xorshift64*)."""
    x = state[k]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[k] = x
    return ((x * np.uint64(0x2545F4914F6CDD1D)) >> np.uint64(11)) / 9007199254740992.0 + 1.2e-16


@njit(cache=True, error_model="numpy")
def _normal(state: NDArray[np.uint64], k: int) -> float:
    """A standard normal number, clipped at four standard deviations (Box-Muller)."""
    radius = np.sqrt(-2.0 * np.log(_uniform(state, k)))
    return min(max(radius * np.cos(2.0 * np.pi * _uniform(state, k)), -4.0), 4.0)


@njit(cache=True, error_model="numpy", inline="always")
def curve_value(curve: Curve, t: float) -> float:
    """Output of the photoreceptor at a time [us]."""
    since = t - curve.begin
    level = curve.offset + curve.slope * since
    if curve.swing != 0.0:
        level += curve.swing * np.exp(-curve.rate * since)
    return level


@njit(cache=True, error_model="numpy")
def _solve(curve: Curve, low: float, high: float, value: float) -> float:
    """Time at which a curve that is monotonic from `low` to `high` takes a value (Illinois method)."""
    f_low, f_high = curve_value(curve, low) - value, curve_value(curve, high) - value
    last, middle = 0, high
    while high - low > _TOLERANCE_US:
        middle = low - f_low * (high - low) / (f_high - f_low)
        if not low < middle < high:
            # Rounded to an end: the curve is numerically straight there.
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
    """First time in `begin` .. `end` at which a curve leaves the range `lower` .. `upper`.

    Returns:
        The time [us], and 1 at the upper or -1 at the lower limit; infinity and 0 if it stays inside.
    """
    turn = end
    if curve.swing != 0.0:
        # Its only possible extremum is where slope and decay cancel.
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
def _emit(
    k: int,
    curve: Curve,
    end: float,
    brightness: float,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
    count: int,
    limit: int,
) -> int:
    """Emit the events of pixel `k` while its photoreceptor follows a curve until `end` [us].

    Returns:
        The new number of events in the buffer, at most `limit`.
    """
    t, reference = curve.begin, pixels.reference[k]
    if pixels.blind_until[k] > curve.begin:
        t = pixels.blind_until[k]
        reference = curve_value(curve, t)
    while count < limit:
        stored = reference + pixels.error[k]
        crossing, direction = first_crossing(curve, t, end, stored + pixels.on[k], stored - pixels.off[k])
        up = direction > 0
        if pixels.next_noise[k] < min(crossing, end):
            noise_us = max(pixels.next_noise[k], t)
            blind = pixels.next_noise[k] < t
            pixels.next_noise[k] = noise_us - np.log(_uniform(pixels.random, k)) / pixels.noise_rate[k]
            # Shot noise is strongest in the dark; a blind pixel emits none.
            if blind or (not pixels.hot[k] and _uniform(pixels.random, k) < 0.75 * min(1.0, brightness)):
                continue
            t = noise_us
            up = _uniform(pixels.random, k) < 0.5
            reference = curve_value(curve, t)
        elif direction != 0:
            t = crossing
            reference += pixels.on[k] if up else -pixels.off[k]
        else:
            break
        output_us = t
        if circuit.latency > 0.0 or circuit.jitter > 0.0:
            output_us += max(0.0, circuit.latency + circuit.jitter * _normal(pixels.random, k))
        if circuit.noise > 0.0:
            pixels.error[k] = circuit.noise * _normal(pixels.random, k)
        buffer.t_us[count] = int(output_us)
        buffer.pixel[count] = k
        buffer.on[count] = 1 if up else 0
        count += 1
        ready = output_us + circuit.refractory
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
    """`exp(-g)` for g >= 0 with an error of 1e-5: the eighth power of a Pade approximation, four times as
    fast."""
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
    span: Span,
    parts: int,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
    count: int,
) -> int:
    """Advance pixel `k` to the intensity `now` in equal parts of a step, and emit its events.

    Args:
        k: index of the pixel.
        now: intensity at the end of the step.
        lamp: light at equally spaced times of the step, both ends included.
        span: the step.
        parts: number of parts.
        circuit: parameters of all pixels.
        pixels: state of all pixels.
        buffer: output.
        count: number of events in the buffer.

    Returns:
        The new number of events in the buffer.
    """
    seen, x, level = pixels.seen[k], pixels.target[k], pixels.level[k]
    pixels.seen[k] = now
    dt, intervals = (span.end - span.begin) / parts, lamp.size - 1
    brightness = lamp[0] * seen + circuit.dark
    limit = count + MAX_EVENTS_PER_STEP
    for part in range(parts):
        begin, end = span.begin + part * dt, span.begin + (part + 1) * dt
        share = (part + 1.0) / parts
        position = share * intervals
        j = min(int(position), intervals - 1)
        lit = lamp[j] + (position - j) * (lamp[j + 1] - lamp[j])
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
        count = _emit(k, curve, end, brightness, circuit, pixels, buffer, count, limit)
    pixels.target[k], pixels.level[k] = x, level
    return count


@njit(cache=True, error_model="numpy")
def lamp_in_parts(light: Light, t0: float, dt: float) -> FloatArray:
    """Relative light at the ends of the parts (n+1,) into which a step from `t0` over `dt` [s] is divided."""
    parts = 1
    if light.depth > 0.0:
        parts = max(1, int(np.ceil(_PARTS_PER_PERIOD * light.rate * dt)))
    lamp = np.empty(parts + 1)
    for j in range(parts + 1):
        lamp[j] = light_at(light, t0 + dt * j / parts)
    return lamp


@njit(cache=True, error_model="numpy")
def respond(
    intensity: NDArray[np.float32],
    light: Light,
    square: Square,
    span: Span,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
    count: int,
) -> int:
    """Advance a square of pixels to the end of a step, and emit their events.

    Args:
        intensity: (H,W) rendered intensity at the end of the step.
        light: light on the scene.
        square: the pixels.
        span: the step.
        circuit: parameters of all pixels.
        pixels: state of all pixels.
        buffer: output, with capacity for `MAX_EVENTS_PER_STEP` more events of each pixel. Events may be up to
            a latency after the end of the step.
        count: number of events in the buffer.

    Returns:
        The new number of events in the buffer.
    """
    on, off, seen, target, levels, reference, error, blind_until, next_noise, _, _, _ = pixels
    bandwidth, least_bandwidth, dark = circuit.bandwidth, circuit.least_bandwidth, circuit.dark
    t0, t1 = span.begin, span.end
    dt = t1 - t0
    per_dt = 1.0 / dt
    leak = circuit.leak * dt
    height, width = intensity.shape
    lamp = lamp_in_parts(light, t0, dt)
    parts = lamp.size - 1
    lit_before, lit = lamp[0], lamp[parts]
    for v in range(square.top, min(square.top + square.side, height)):
        for u in range(square.left, min(square.left + square.side, width)):
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
            stored = reference[k] - leak * on[k]
            reference[k] = stored
            stored += error[k]
            # Fast path, taken by most pixels: no event is possible. The level has an extremum within the step
            # if it is on the other side of its target at the end.
            if (
                max(level0, level) < stored + on[k]
                and min(level0, level) > stored - off[k]
                and (x0 - level0) * (x - level) >= 0.0
                and next_noise[k] >= t1
                and blind_until[k] <= t0
            ):
                continue
            curve = Curve(t0, x0 - lag, change * per_dt, swing, rate)
            count = _emit(
                k, curve, t1, brightness, circuit, pixels, buffer, count, count + MAX_EVENTS_PER_STEP
            )
    return count
