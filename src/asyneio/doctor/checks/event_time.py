# SPDX-License-Identifier: Apache-2.0
"""Checks of event timestamps: rate, pauses, order, unit, flicker."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.signal import welch

from asyneio.doctor.event_scan import PAUSE_NS
from asyneio.doctor.inspection import Inspection, fail, note, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.io.parsing.stamp_checks import MAX_DISORDER_NS
from asyneio.io.recording.clock_jumps import ClockPart
from asyneio.types import NS_PER_S

#: Event rate that the front end processes in real time on one core [events/s].
FRONTEND_HZ = 2.5e6
#: What a run does about jumps of the clock.
_JOINED = "a run begins a new segment at each jump, with later time stamps than in the file"
_PEAK_WINDOW_NS = 10_000_000
#: Plausible events per second and pixel. A stationary sensor gives at least 0.05 from leak and noise events
#: (two real ones: 0.44 and 0.62), a textured scene in fast motion 60; the readout limit is 300 (12 Mev/s of a
#: DAVIS240) to 1200 (1.07 Gev/s of a Gen4). Values far outside indicate a wrong unit of time.
_PLAUSIBLE_HZ_PER_PIXEL = (2e-4, 2000.0)
#: Clock tick [ns] that is too coarse for any event sensor.
_COARSE_TICK_NS = 10_000_000
#: With fewer events no statistics and no tracking are possible.
_FEW = 1000

#: Lamps flicker at twice the mains frequency; some lamps, and screens, at the mains frequency.
_LAMPS_HZ = (50.0, 60.0, 100.0, 120.0)
#: A spectral line has at least this ratio to the power around it, and this modulation depth of the rate.
_LINE_CONTRAST, _LINE_DEPTH = 20.0, 0.1
_SEGMENT = 2048
_LEAST_FLICKER_S = 1.0


def check_event_rate(inspection: Inspection) -> CheckResult | None:
    """Mean and peak rate, against the minimum for a recording and the real-time limit of the front end."""
    events = inspection.events
    if events is None:
        return None
    if events.count < _FEW:
        fix = "record again, or select another stream; check that this is an event recording"
        return fail("event rate", f"{events.count} event(s)", f"at least {_FEW}", fix)
    peak = events.peak_hz(_PEAK_WINDOW_NS)
    share = events.share_above(FRONTEND_HZ, _PEAK_WINDOW_NS)
    measured = f"{_rate(events.rate_hz)} on average, {_rate(peak)} at most over 10 ms"
    values = {"mean_hz": _finite(events.rate_hz), "peak_hz": peak, "share_above_front_end": share}
    if share == 0.0:
        return ok("event rate", measured, **values)
    measured += f"; {share:.0%} of the time above {_rate(FRONTEND_HZ)}"
    expected = f"at most {_rate(FRONTEND_HZ)}, the real-time limit of the front end"
    fix = "processing is slower than real time but complete; for live use raise the sensor's thresholds"
    return note("event rate", measured, expected, fix, **values)


def check_event_pauses(inspection: Inspection) -> CheckResult | None:
    """Pauses of the stream: a moving camera produces events continuously, a stationary one noise events."""
    events = inspection.events
    if events is None or events.count < 2:
        return None
    values = {
        "pauses": events.pauses,
        "silent_s": events.silent_ns / NS_PER_S,
        "longest_s": events.longest_pause_ns / NS_PER_S,
    }
    if events.pauses == 0:
        return ok("event pauses", f"none longer than {PAUSE_NS / 1e6:.0f} ms", **values)
    at_s = (events.longest_pause_at_ns - events.first_ns) / NS_PER_S
    return warning(
        "event pauses",
        f"{events.pauses} pause(s), {events.silent_ns / NS_PER_S:.4g} s in all, the longest "
        f"{events.longest_pause_ns / NS_PER_S:.4g} s at {at_s:.4g} s",
        f"no pause longer than {PAUSE_NS / 1e6:.0f} ms",
        "lost packets, or a static or dark scene: a run continues with the IMU alone and reports DEGRADED",
        **values,
    )


def check_event_order(inspection: Inspection) -> CheckResult | None:
    """Ascending timestamps: drivers may swap neighbours; a jump is a clock reset, where a segment ends."""
    events = inspection.events
    if events is None or events.count < 2:
        return None
    values = {
        "backward": events.backward,
        "worst_s": events.worst_backward_ns / NS_PER_S,
        "impossible_stamps": events.impossible_stamps,
        "jumps": max(len(inspection.clock_parts) - 1, 0),
    }
    if events.impossible_stamps:
        return fail(
            "event order",
            f"{events.impossible_stamps} timestamp(s) beyond 146 years",
            "timestamps of one clock in the unit of the format",
            "the file is damaged, or the timestamps are in another unit",
            **values,
        )
    if len(inspection.clock_parts) > 1:
        return warning(
            "event order", _jumps(inspection.clock_parts), "one ascending clock", _JOINED, **values
        )
    if events.backward == 0:
        return ok("event order", "ascending", **values)
    worst = f"{events.backward} event(s) older than their predecessor, "
    worst += f"by up to {events.worst_backward_ns / 1e6:.4g} ms"
    limit = f"{MAX_DISORDER_NS / 1e6:.0f} ms"
    if events.worst_backward_ns <= MAX_DISORDER_NS:
        return note(
            "event order", worst, "ascending timestamps", f"none needed: up to {limit} is sorted", **values
        )
    return warning(
        "event order",
        worst,
        "ascending timestamps",
        f"events more than {limit} late are dropped; if the clock was set back, split the file there",
        **values,
    )


def _jumps(parts: tuple[ClockPart, ...]) -> str:
    """Size and place of each jump of the clock."""
    sizes_s = ((before.end_ns - after.start_ns) / NS_PER_S for before, after in pairwise(parts))
    return ", ".join(
        f"time jumps back by {size_s:.4g} s before event {part.first_event}"
        for size_s, part in zip(sizes_s, parts[1:], strict=True)
    )


def check_event_clock(inspection: Inspection) -> CheckResult | None:
    """Unit of time, from the clock tick and the plausible event rate per pixel."""
    events = inspection.events
    if events is None or events.count < 2:
        return None
    rate = events.rate_hz / max(events.counts.size, 1)
    low, high = _PLAUSIBLE_HZ_PER_PIXEL
    values = {"tick_ns": events.tick_ns, "hz_per_pixel": _finite(rate), "span_s": events.span_s}
    found = f"{events.span_s:.6g} s long, {rate:.3g} events per second and pixel, timestamps in steps of "
    found += f"{events.tick_ns / 1e3:g} us"
    if events.count >= _FEW and events.span_s == 0.0:
        return fail(
            "event clock",
            f"all {events.count} events have the time stamp {events.first_ns} ns",
            "steps of about a microsecond",
            "the time was printed with too few digits, or stored as a 32-bit float: write whole "
            "microseconds, or seconds with nine decimals (%.9f)",
            **values,
        )
    if events.count >= _FEW and events.tick_ns >= _COARSE_TICK_NS:
        return fail(
            "event clock",
            found,
            "steps of about a microsecond",
            f"the timestamps are probably in a smaller unit (factor {_factor(events.tick_ns / 1e3)}: "
            f"{'microseconds' if events.tick_ns >= 3e8 else 'finer steps'} read as seconds): convert them",
            **values,
        )
    if events.count >= _FEW and not low <= rate <= high:
        unit = "smaller" if rate < low else "larger"
        factor = _factor(0.5 / rate if rate < low else rate / 10.0)
        return fail(
            "event clock",
            found,
            f"{low:g} to {high:g} events per second and pixel",
            f"the timestamps are probably in a {unit} unit (factor {factor}): convert them",
            **values,
        )
    return ok("event clock", found, **values)


def check_flicker(inspection: Inspection) -> CheckResult | None:
    """Flicker of lamps: it produces events that do not come from motion."""
    events = inspection.events
    if events is None or events.count < _FEW or events.span_s < _LEAST_FLICKER_S:
        return None
    sample_hz = NS_PER_S / events.bin_ns
    if sample_hz < 2.5 * max(_LAMPS_HZ):
        return note("flicker", f"not checked in a recording of {events.span_s:.4g} s")
    length = min(_SEGMENT, events.bins.size)
    frequency, power = welch(events.bins.astype(np.float64), sample_hz, nperseg=length)
    mean = float(events.bins.mean())
    width_hz = 2.0 * sample_hz / length
    lines = {}
    for lamp in _LAMPS_HZ:
        on = np.abs(frequency - lamp) <= width_hz
        around = (np.abs(frequency - lamp) <= 15.0) & ~on
        contrast = power[on].max() / max(float(np.median(power[around])), 1e-12)
        depth = np.sqrt(2.0 * np.trapezoid(power[on], frequency[on])) / max(mean, 1e-12)
        if contrast > _LINE_CONTRAST and depth > _LINE_DEPTH:
            lines[f"{lamp:g}"] = float(depth)
    if not lines:
        return ok("flicker", "no spectral line at 50, 60, 100 or 120 Hz", lines=lines)
    text = ", ".join(f"{lamp} Hz ({depth:.0%} of the rate)" for lamp, depth in lines.items())
    return warning(
        "flicker",
        f"the event rate is modulated at {text}",
        "a rate that depends on the motion only",
        "record in daylight or with flicker-free lamps, or enable the sensor's flicker filter",
        lines=lines,
    )


def _factor(ratio: float) -> int:
    """The power of 1000 nearest to a ratio, at least 1000."""
    return int(1000 ** max(1, min(3, round(np.log(min(max(ratio, 1.0), 1e12)) / np.log(1000.0)))))


def _rate(hz: float) -> str:
    return f"{hz / 1e6:.3g} Mev/s" if hz >= 1e5 else f"{hz:.4g} ev/s"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
