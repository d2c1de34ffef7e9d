# SPDX-License-Identifier: Apache-2.0
"""Checks of inertial readings: units, dead axes, saturation, spikes, noise, stationary spans."""

from __future__ import annotations

from typing import Any

import numpy as np

from asyneio.doctor.checks.imu_time import streams_of
from asyneio.doctor.inspection import Inspection, fail, note, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.doctor.stationary import StationarySpans
from asyneio.errors import RecordingError
from asyneio.inertial.gating import SampleGate, SensorLimits
from asyneio.inertial.repeats import Renewals
from asyneio.inertial.stationarity import LEAST_DENSITY, Stationarity, possible
from asyneio.io.recording.inertial_units import STANDARD_GRAVITY, InertialStreams, check_units
from asyneio.types import NS_PER_S, FloatArray, RecordArray

_SENSORS = ("gyroscope", "accelerometer")
#: Smallest full-scale ranges [rad/s, m/s^2], as in the estimator's measurement buffer.
_LEAST_RANGES = (1.0, 12.0)
#: Readings identical to the last bit for this time [s] and number of samples are not measurements.
_STUCK_S, _STUCK_SAMPLES = 0.2, 50
#: Ratios of measured to declared noise that give WARNING and FAIL. Declared densities are often inflated on
#: purpose, so only the second ratio counts in the other direction.
_OFF, _FAR_OFF = 10.0, 100.0
_GATE_SAMPLES = 2000
#: Formats that define other units; their readers convert them.
_BY_DEFINITION = {
    "AEDAT4": ", converted from g and deg/s, which the format defines",
    "AEDAT-2.0": ", converted from the sensor's counts",
}
_BLOCK_S = 0.005
#: Error of the accelerometer that is reported; gravity varies by 0.5 % over the earth.
_GRAVITY_OFF = 0.015
#: A stationary sensor outside this range [m/s^2] is not calibrated: no bias explains it.
_GRAVITY_RANGE = (8.8, 10.8)
_UNIT_HINT = "check its unit (per sqrt(Hz), rad, m/s^2)"


def check_imu_units(inspection: Inspection) -> CheckResult | None:
    """Units and column order, from gravity: only an accelerometer measures it."""
    samples = inspection.samples
    if samples is None or min(samples.gyroscope.size, samples.accelerometer.size) < 2:
        return None
    finite = [rows[possible(rows["xyz"])] for rows in (samples.gyroscope, samples.accelerometer)]
    if min(rows.size for rows in finite) < 2:
        return fail("imu units", "no finite readings", "readings", "the columns hold no measurements")
    by_definition = next(
        (text for kind, text in _BY_DEFINITION.items() if inspection.kind.startswith(kind)), ""
    )
    force, rate = (float(np.median(np.linalg.norm(rows["xyz"], axis=1))) for rows in finite[::-1])
    values = {"median_accelerometer": force, "median_gyroscope": rate}
    measured = f"accelerometer {force:.4g}, gyroscope {rate:.4g} (medians)"
    expected = "accelerometer about 9.81 m/s^2, gyroscope in rad/s, each in its columns"
    try:
        streams = check_units(finite[0], finite[1], ())
    except RecordingError as error:
        return fail("imu units", measured, expected, str(error), **values)
    complaint = inspection.gravity.force_complaint() if inspection.gravity else ""
    if complaint:
        return fail("imu units", measured, expected, complaint, **values)
    if any("swapped" in text for text in streams.notes):
        fix = "gravity is in the gyroscope's columns: they are swapped; a run swaps them back"
        return warning("imu units", measured, expected, fix, **values)
    if streams.notes:
        text = "; ".join(streams.notes)
        return warning("imu units", measured, expected, f"a run would continue with this: {text}", **values)
    return ok("imu units", f"{measured}: m/s^2 and rad/s{by_definition}", **values)


def check_dead_axes(inspection: Inspection) -> CheckResult | None:
    """Axes that repeat a reading to the last bit: noise prevents that in a working sensor."""
    found: dict[str, float] = {}
    whole: list[str] = []
    for name, t_ns, xyz in streams_of(inspection):
        if len(xyz) < _STUCK_SAMPLES:
            continue
        for axis, values in zip("xyz", xyz.T, strict=True):
            start, length = _longest_run(values)
            seconds = float(t_ns[start + length - 1] - t_ns[start]) / NS_PER_S
            if length >= _STUCK_SAMPLES and seconds >= _STUCK_S:
                found[f"{name} {axis}"] = seconds
                if length == len(values):
                    whole.append(f"{name} {axis}")
    if not any(True for _ in streams_of(inspection)):
        return None
    if not found:
        return ok("imu axes", "all six axes respond", stuck_s=found)
    measured = ", ".join(f"{axis} is constant for {seconds:.3g} s" for axis, seconds in found.items())
    expected = "readings that vary by noise"
    if whole:
        fix = f"{', '.join(whole)}: dead or not read; record again with a working sensor"
        return fail("imu axes", measured, expected, fix, stuck_s=found)
    return warning(
        "imu axes",
        measured,
        expected,
        "the sensor or its driver stopped responding at that time",
        stuck_s=found,
    )


def check_spikes_and_saturation(inspection: Inspection) -> CheckResult | None:
    """Saturated readings and single spikes, by the estimator's own rules."""
    streams = inspection.streams
    if streams is None or not streams.gyroscope.size:
        return None
    found: dict[str, dict[str, int]] = {}
    for name, rows, least, density in zip(
        _SENSORS, (streams.gyroscope, streams.accelerometer), _LEAST_RANGES, LEAST_DENSITY, strict=True
    ):
        gate = SampleGate()
        renewals = Renewals()
        for start in range(0, rows.size, _GATE_SAMPLES):
            renewed = renewals.passed(rows[start : start + _GATE_SAMPLES])
            gate.passed(renewed, SensorLimits(density * np.sqrt(renewals.rate_hz), least))
        if gate.spikes or gate.saturated:
            found[name] = {"saturated": gate.saturated, "spikes": gate.spikes, "samples": int(rows.size)}
    if not found:
        return ok("imu range", "no saturated readings, no spikes", found=found)
    measured = "; ".join(
        f"{name}: {c['saturated']} saturated reading(s), {c['spikes']} spike(s)" for name, c in found.items()
    )
    expected = "readings inside the sensor's range"
    share = max((c["saturated"] + c["spikes"]) / c["samples"] for c in found.values())
    if share < 1e-3:
        return note("imu range", measured, expected, "none needed: a run rejects them", found=found)
    return warning(
        "imu range",
        measured,
        expected,
        "a run rejects them and is degraded there: set a larger range",
        found=found,
    )


def check_stationary(inspection: Inspection) -> CheckResult | None:
    """A recording that is stationary throughout contains no motion to estimate."""
    streams = inspection.streams
    if streams is None or not streams.gyroscope.size:
        return None
    found = inspection.stationary
    values = {"spans": found.spans, "stationary": found.count}
    if found.spans == 0:
        return note("stationary", "the recording is too short", "0.1 s of samples", "", **values)
    if found.throughout:
        return note(
            "stationary",
            "the sensor is stationary throughout",
            "motion",
            "suitable for checks of initialization and noise; odometry needs motion",
            **values,
        )
    return ok("stationary", f"stationary in {found.count} of {found.spans} half seconds", **values)


def check_gravity(inspection: Inspection) -> CheckResult | None:
    """Specific force of a stationary sensor against gravity: the difference is an error of scale or bias."""
    found, gravity = inspection.stationary, inspection.gravity
    if gravity is not None and gravity.force_complaint():
        return None
    if gravity is not None and not found.count and gravity.force_doubt():
        off = gravity.force / STANDARD_GRAVITY - 1.0
        return warning(
            "imu gravity",
            f"mean |a| = {gravity.force:.4g} m/s^2 over {gravity.seconds:.3g} s, {off:+.1%} of gravity",
            f"{STANDARD_GRAVITY:.4g} m/s^2 within {_GRAVITY_OFF:.1%}",
            "the accelerometer's scale or bias is wrong: calibrate it",
            force=gravity.force,
            stationary=False,
        )
    if found.force is None:
        return None
    where = f"stationary ({found.count} half seconds)" if found.count else "in the steadiest half second"
    measured = f"|a| = {found.force:.4g} m/s^2 {where}"
    values = {"stationary": found.count > 0, "force": found.force}
    off = found.force / STANDARD_GRAVITY - 1.0
    if abs(off) <= _GRAVITY_OFF:
        return ok("imu gravity", measured, **values)
    plausible = _GRAVITY_RANGE[0] <= found.force <= _GRAVITY_RANGE[1]
    return (note if plausible or not found.count else fail)(
        "imu gravity",
        f"{measured}, {off:+.1%} of gravity",
        f"{STANDARD_GRAVITY:.4g} m/s^2 within {_GRAVITY_OFF:.1%}",
        "the accelerometer's scale or bias is wrong: calibrate it, or the scale of the trajectory is wrong",
        **values,
    )


def check_noise(inspection: Inspection) -> CheckResult | None:
    """White noise against the declared densities; in motion only an upper bound of it is known."""
    streams, calibration = inspection.streams, inspection.calibration
    if streams is None or streams.gyroscope.size < 20:
        return None
    densities, stationary = _noise_densities(streams, inspection.stationary)
    count = inspection.stationary.count
    how = f"stationary ({count} half seconds)" if count else "at most, from differences in motion"
    measured = (
        f"gyroscope {densities['gyroscope']:.2g} rad/s/sqrt(Hz), "
        f"accelerometer {densities['accelerometer']:.2g} m/s^2/sqrt(Hz), {how}"
    )
    values: dict[str, Any] = {"densities": densities, "declared": None, "stationary": count > 0}
    if calibration is None:
        return ok("imu noise", measured, **values)
    declared = (calibration.noise.gyroscope_density, calibration.noise.accelerometer_density)
    values["declared"] = list(declared)
    expected = (
        f"{declared[0]:.2g} and {declared[1]:.2g} as the calibration declares, within a factor {_OFF:g}"
    )
    ratios: dict[str, float] = {}
    for name, density in zip(_SENSORS, declared, strict=True):
        if densities[name] > 0.0:
            ratio = densities[name] / density
            # The bound in motion includes motion, so it proves a declared density too large, never too small.
            ratios[name] = ratio if stationary[name] or ratio < 1.0 else 1.0
    noisiest = max(ratios, key=lambda name: ratios[name], default="")
    quietest = min(ratios, key=lambda name: ratios[name], default="")
    text = "the declared density of the {} is too {} by a factor {:.0f}: " + _UNIT_HINT
    if noisiest and ratios[noisiest] > _OFF:
        level = fail if ratios[noisiest] > _FAR_OFF else warning
        fix = text.format(noisiest, "small", ratios[noisiest])
        return level("imu noise", measured, expected, fix, **values)
    if quietest and ratios[quietest] < 1.0 / _FAR_OFF:
        fix = text.format(quietest, "large", 1.0 / ratios[quietest])
        return warning("imu noise", measured, expected, fix, **values)
    return ok("imu noise", measured, **values)


def _noise_densities(
    streams: InertialStreams, spans: StationarySpans
) -> tuple[dict[str, float], dict[str, bool]]:
    """White noise density of each sensor, and whether it was measured while stationary."""
    densities: dict[str, float] = {}
    stationary: dict[str, bool] = {}
    for name, rows, measured in zip(
        _SENSORS,
        (streams.gyroscope, streams.accelerometer),
        (spans.gyroscope, spans.accelerometer),
        strict=True,
    ):
        densities[name] = _stationary_density(measured) if measured else _density_bound(rows)
        stationary[name] = bool(measured)
    return densities, stationary


def _stationary_density(spans: tuple[Stationarity, ...]) -> float:
    """Median over spans and axes of the scatter times the square root of the sampling period."""
    return float(np.median([span.scatter * np.sqrt(span.period_s) for span in spans]))


def _density_bound(rows: RecordArray) -> float:
    """Upper bound of the density in motion, from second differences, in which slow motion cancels.

    The differences are between means over _BLOCK_S: many sensors filter their readings, and neighbouring
    filtered readings underestimate the noise density.
    """
    period_s = max(float(np.median(np.diff(rows["t_ns"]))) / NS_PER_S, 1e-9)
    length = max(1, round(_BLOCK_S / period_s))
    blocks = rows["xyz"][: rows.size // length * length].reshape(-1, length, 3).mean(axis=1)
    if len(blocks) < 3:
        return 0.0
    second = (blocks[2:] - 2.0 * blocks[1:-1] + blocks[:-2]) / np.sqrt(6.0)
    return float(1.4826 * np.median(np.abs(second)) * np.sqrt(period_s * length))


def _longest_run(values: FloatArray) -> tuple[int, int]:
    """Start and length of the longest run of equal values."""
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    lengths = np.diff(np.append(starts, values.size))
    longest = int(np.argmax(lengths))
    return int(starts[longest]), int(lengths[longest])
