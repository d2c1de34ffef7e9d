"""Checks on what inertial sensors read: units, dead axes, saturation, spikes, noise, rest."""

from __future__ import annotations

import numpy as np

from asyneio.doctor.checks.imu_time import streams_of
from asyneio.doctor.inspection import Inspection, fail, note, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.errors import RecordingError
from asyneio.inertial.gating import SampleGate, SensorLimits
from asyneio.inertial.repeats import Renewals
from asyneio.inertial.stationarity import LEAST_DENSITY, Stationarity, possible
from asyneio.io.recording.inertial_units import STANDARD_GRAVITY, check_units
from asyneio.types import NS_PER_S, FloatArray, RecordArray

_SENSORS = ("gyroscope", "accelerometer")
#: Least full-scale ranges [rad/s, m/s^2], as at the estimator's intake.
_LEAST_RANGES = (1.0, 12.0)
#: A reading that stays the same to the last bit for so long, and so many samples, is no measurement.
_STUCK_S, _STUCK_SAMPLES = 0.2, 50
#: Noise so many times the declared figure is trusted too much; so many times, beyond use. Declared figures
#: are often inflated on purpose, so that only the second is worth a word the other way.
_OFF, _FAR_OFF = 10.0, 100.0
_GATE_SAMPLES = 2000
#: Formats that define another unit, which their readers convert.
_BY_DEFINITION = {
    "AEDAT4": ", converted from g and deg/s, which the format defines",
    "AEDAT-2.0": ", converted from the sensor's counts",
}
_BLOCK_S = 0.005
#: The error of an accelerometer that is worth a word; gravity differs by 0.5 % over the earth.
_GRAVITY_OFF = 0.015
_UNIT_HINT = "check its unit (per sqrt(Hz), rad, m/s^2)"


def check_imu_units(evidence: Inspection) -> CheckResult | None:
    """Gravity tells the unit and the order of the columns: only an accelerometer reads it."""
    samples = evidence.samples
    if samples is None or min(samples.gyroscope.size, samples.accelerometer.size) < 2:
        return None
    finite = [rows[possible(rows["xyz"])] for rows in (samples.gyroscope, samples.accelerometer)]
    if min(rows.size for rows in finite) < 2:
        return fail("imu units", "no finite readings", "readings", "the columns hold no measurements")
    by_definition = next(
        (said for kind, said in _BY_DEFINITION.items() if evidence.kind.startswith(kind)), ""
    )
    force, rate = (float(np.median(np.linalg.norm(rows["xyz"], axis=1))) for rows in finite[::-1])
    values = {"median_accelerometer": force, "median_gyroscope": rate}
    measured = f"accelerometer {force:.4g}, gyroscope {rate:.4g} (medians)"
    expected = "accelerometer about 9.81 m/s^2, gyroscope in rad/s, each in its columns"
    try:
        streams = check_units(finite[0], finite[1], ())
    except RecordingError as error:
        return fail("imu units", measured, expected, str(error), **values)
    complaint = evidence.gravity.force_complaint() if evidence.gravity else ""
    if complaint:
        return fail("imu units", measured, expected, complaint, **values)
    if any("swapped" in said for said in streams.notes):
        cure = "gravity stands in the gyroscope's columns: they are swapped; a run swaps them back"
        return warning("imu units", measured, expected, cure, **values)
    if streams.notes:
        said = "; ".join(streams.notes)
        return warning("imu units", measured, expected, f"a run would go on so: {said}", **values)
    return ok("imu units", f"{measured}: m/s^2 and rad/s{by_definition}", **values)


def check_dead_axes(evidence: Inspection) -> CheckResult | None:
    """Axes that stay the same to the last bit: noise alone never repeats a reading for long."""
    found: dict[str, float] = {}
    whole: list[str] = []
    for name, t_ns, xyz in streams_of(evidence):
        if len(xyz) < _STUCK_SAMPLES:
            continue
        for axis, values in zip("xyz", xyz.T, strict=True):
            start, length = _longest_run(values)
            seconds = float(t_ns[start + length - 1] - t_ns[start]) / NS_PER_S
            if length >= _STUCK_SAMPLES and seconds >= _STUCK_S:
                found[f"{name} {axis}"] = seconds
                if length == len(values):
                    whole.append(f"{name} {axis}")
    if not any(True for _ in streams_of(evidence)):
        return None
    if not found:
        return ok("imu axes", "all six alive", stuck_s=found)
    measured = ", ".join(f"{axis} stays the same for {seconds:.3g} s" for axis, seconds in found.items())
    expected = "readings that differ by noise"
    if whole:
        cure = f"{', '.join(whole)}: dead, or not read; record again with the sensor working"
        return fail("imu axes", measured, expected, cure, stuck_s=found)
    return warning(
        "imu axes", measured, expected, "the sensor or its driver hung: look at that time", stuck_s=found
    )


def check_spikes_and_saturation(evidence: Inspection) -> CheckResult | None:
    """Readings at the end of the range, and single spikes, by the estimator's own rules."""
    streams = evidence.streams
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
        return ok("imu range", "no saturated reading, no spike", found=found)
    measured = "; ".join(
        f"{name}: {c['saturated']} reading(s) at the end of the range, {c['spikes']} spike(s)"
        for name, c in found.items()
    )
    expected = "readings inside the sensor's range"
    share = max((c["saturated"] + c["spikes"]) / c["samples"] for c in found.values())
    if share < 1e-3:
        return note("imu range", measured, expected, "left out by a run", found=found)
    return warning(
        "imu range",
        measured,
        expected,
        "left out by a run, which is degraded there: set a larger range",
        found=found,
    )


def check_rest(evidence: Inspection) -> CheckResult | None:
    """At rest throughout, there is nothing to estimate."""
    streams = evidence.streams
    if streams is None or not streams.gyroscope.size:
        return None
    rest = evidence.rest
    values = {"spans": rest.spans, "still": rest.still}
    if rest.spans == 0:
        return note("rest", "too short to tell", "a tenth of a second of samples", "", **values)
    if rest.throughout:
        return note(
            "rest",
            "the sensor is at rest throughout",
            "motion",
            "fine for checks of the start and of noise; there is no odometry without motion",
            **values,
        )
    return ok("rest", f"at rest in {rest.still} of {rest.spans} half seconds", **values)


def check_gravity(evidence: Inspection) -> CheckResult | None:
    """At rest an accelerometer reads gravity: what it reads otherwise is error of its scale or its bias."""
    rest, witness = evidence.rest, evidence.gravity
    if rest.force is None or (witness is not None and witness.force_complaint()):
        return None
    where = f"at rest ({rest.still} half seconds)" if rest.still else "in the steadiest half second"
    measured = f"|a| = {rest.force:.4g} m/s^2 {where}"
    values = {"at_rest": rest.still > 0, "force": rest.force}
    off = rest.force / STANDARD_GRAVITY - 1.0
    if abs(off) <= _GRAVITY_OFF:
        return ok("imu gravity", measured, **values)
    return note(
        "imu gravity",
        f"{measured}, {off:+.1%} of gravity",
        f"{STANDARD_GRAVITY:.4g} m/s^2 within {_GRAVITY_OFF:.1%}",
        "the accelerometer's scale or bias is off: calibrate it, or expect the scale of the path to be off",
        **values,
    )


def check_noise(evidence: Inspection) -> CheckResult | None:
    """White noise at rest against the declared densities; in motion only what bounds it from above."""
    streams, calibration = evidence.streams, evidence.calibration
    if streams is None or streams.gyroscope.size < 20:
        return None
    rest = evidence.rest
    declared = (
        (calibration.noise.gyroscope_density, calibration.noise.accelerometer_density)
        if calibration
        else None
    )
    found: dict[str, float] = {}
    ratios: dict[str, float] = {}
    for index, (name, rows, still) in enumerate(
        zip(
            _SENSORS,
            (streams.gyroscope, streams.accelerometer),
            (rest.gyroscope, rest.accelerometer),
            strict=True,
        )
    ):
        density = _at_rest(still) if still else _from_differences(rows)
        found[name] = density
        if declared is not None and density > 0.0:
            ratio = density / declared[index]
            # In motion differences hold motion as well: only a figure far too large is seen.
            ratios[name] = ratio if still or ratio < 1.0 else 1.0
    how = f"at rest ({rest.still} half seconds)" if rest.still else "at most, from differences in motion"
    measured = (
        f"gyroscope {found['gyroscope']:.2g} rad/s/sqrt(Hz), accelerometer {found['accelerometer']:.2g} "
    )
    measured += f"m/s^2/sqrt(Hz) {how}"
    values = {"densities": found, "declared": list(declared) if declared else None, "at_rest": rest.still > 0}
    if declared is None:
        return ok("imu noise", measured, **values)
    expected = (
        f"{declared[0]:.2g} and {declared[1]:.2g} as the calibration declares, within a factor {_OFF:g}"
    )
    loud = max(ratios, key=lambda name: ratios[name], default="")
    quiet = min(ratios, key=lambda name: ratios[name], default="")
    if loud and ratios[loud] > _OFF:
        cure = f"the declared density of the {loud} is too small by a factor {ratios[loud]:.0f}: {_UNIT_HINT}"
        level = fail if ratios[loud] > _FAR_OFF else warning
        return level("imu noise", measured, expected, cure, **values)
    if quiet and ratios[quiet] < 1.0 / _FAR_OFF:
        factor = 1.0 / ratios[quiet]
        cure = f"the declared density of the {quiet} is too large by a factor {factor:.0f}: {_UNIT_HINT}"
        return warning("imu noise", measured, expected, cure, **values)
    return ok("imu noise", measured, **values)


def _at_rest(still: tuple[Stationarity, ...]) -> float:
    """Median over spans and axes of scatter times the square root of the step."""
    return float(np.median([found.scatter * np.sqrt(found.period_s) for found in still]))


def _from_differences(rows: RecordArray) -> float:
    """An upper bound on the same in motion: second differences, in which slow motion cancels.

    Of means over _BLOCK_S: sensors that are read often filter what they read, so that neighbours tell nothing
    of the noise below the filter.
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
