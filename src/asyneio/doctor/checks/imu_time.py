# SPDX-License-Identifier: Apache-2.0
"""Checks of inertial timestamps: rate, gaps, order, and a common clock with the camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from asyneio.doctor.inspection import Inspection, fail, note, ok, warning
from asyneio.doctor.result import CheckResult, Severity
from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import GAP_NS, MAX_DISORDER_NS, PLAUSIBLE_RATE_HZ, check_overlap
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: After a gap of the first length the estimator is DEGRADED; after the second it initializes again.
_LONG_GAP_NS, _LOST_GAP_NS = 50_000_000, 500_000_000
#: Tolerated ratios to the declared rate, and ratios of samples written twice or at half their spacing.
_RATE_RATIO, _TWICE_RATIO = (0.8, 1.25), (1.8, 2.2)
#: Steps that differ from the median by more than this fraction are jitter.
_JITTER = 0.3
#: Fraction of the camera's time span that samples must cover.
_COVERED = 0.98
_MIN_S = 1.0


def streams_of(inspection: Inspection) -> Iterator[tuple[str, IntArray, FloatArray]]:
    """Name, timestamps (N,) [ns] and readings (N,3) of each sensor with samples, in file order, without
    isolated wrong timestamps."""
    for readings in inspection.readings:
        yield readings.name, readings.rows["t_ns"], readings.rows["xyz"]


def check_imu_there(inspection: Inspection) -> CheckResult | None:
    """Odometry needs an IMU; tracking features does not."""
    found = dict((name, int(t.size)) for name, t, _ in streams_of(inspection))
    if len(found) == 2:
        counts = ", ".join(f"{count} samples of the {name}" for name, count in found.items())
        return ok("imu", counts, **found)
    if any(failure.part == "inertial samples" for failure in inspection.failures) or not inspection.sees:
        return None
    return CheckResult(
        "imu",
        Severity.WARNING,
        "no inertial samples" if not found else f"only a {', '.join(found)}",
        "gyroscope and accelerometer",
        "features can be tracked (asyneio track); for odometry pass the file with the samples",
        dict(found),
        prevents=("run",),
    )


def check_imu_rate(inspection: Inspection) -> CheckResult | None:
    """Median rate against the declared rate and the range of such sensors, and jitter."""
    rates, jitter = _rates(inspection)
    if not rates:
        return None
    measured = ", ".join(f"{name} {rate:.5g} Hz" for name, rate in rates.items())
    values: dict[str, Any] = {"hz": rates, "jittering_share": jitter}
    low, high = PLAUSIBLE_RATE_HZ
    if any(not low <= rate <= high for rate in rates.values()):
        return fail(
            "imu rate",
            measured,
            f"{low:g} to {high:g} Hz",
            "the timestamps are probably in another unit: convert them",
            **values,
        )
    declared = inspection.calibration.noise.rate_hz if inspection.calibration else None
    if declared is not None:
        values["declared_hz"] = declared
        ratios = {name: rate / declared for name, rate in rates.items()}
        off = {n: r for n, r in ratios.items() if not _RATE_RATIO[0] <= r <= _RATE_RATIO[1]}
        if off:
            twice = any(_TWICE_RATIO[0] <= ratio <= _TWICE_RATIO[1] for ratio in off.values())
            fix = (
                "twice the declared rate: the driver writes samples twice or advances timestamps by half a "
                "step; compare the length of the samples with that of the events"
                if twice
                else "correct update_rate in the calibration, or check for lost samples"
            )
            return warning(
                "imu rate", measured, f"{declared:.5g} Hz as the calibration declares", fix, **values
            )
    worst = max(jitter.values())
    if worst > 0.2:
        return note(
            "imu rate",
            f"{measured}; {worst:.0%} of the steps differ from the median by more than {_JITTER:.0%}",
            "equal steps",
            "timestamps of the host instead of the sensor: use the sensor's clock if it has one",
            **values,
        )
    return ok("imu rate", measured, **values)


def _rates(inspection: Inspection) -> tuple[dict[str, float], dict[str, float]]:
    """Median rate [Hz] and fraction of jittering steps of each sensor."""
    rates: dict[str, float] = {}
    jitter: dict[str, float] = {}
    for name, t_ns, _ in streams_of(inspection):
        steps = np.diff(np.sort(t_ns)).astype(np.float64)
        steps = steps[steps > 0.0]
        if steps.size:
            median = float(np.median(steps))
            rates[name] = NS_PER_S / median
            jitter[name] = float((np.abs(steps - median) > _JITTER * median).mean())
    return rates, jitter


def check_imu_gaps(inspection: Inspection) -> CheckResult | None:
    """Gaps between samples, which a run must bridge."""
    found: dict[str, dict[str, float]] = {}
    for name, t_ns, _ in streams_of(inspection):
        ordered = np.sort(t_ns)
        steps = np.diff(ordered).astype(np.float64)
        if steps.size == 0:
            continue
        limit = max(GAP_NS, 2.5 * float(np.median(steps)))
        gaps = np.flatnonzero(steps > limit)
        if gaps.size:
            worst = int(gaps[np.argmax(steps[gaps])])
            found[name] = {
                "count": int(gaps.size),
                "longest_s": float(steps[worst]) / NS_PER_S,
                "at_s": float(ordered[worst] - ordered[0]) / NS_PER_S,
            }
    if not any(True for _ in streams_of(inspection)):
        return None
    if not found:
        return ok("imu gaps", f"none longer than {GAP_NS / 1e6:.0f} ms", gaps=found)
    longest = max(gap["longest_s"] for gap in found.values())
    measured = "; ".join(
        f"{name}: {gap['count']:.0f} gap(s), the longest {1e3 * gap['longest_s']:.1f} ms "
        f"at {gap['at_s']:.4g} s"
        for name, gap in found.items()
    )
    expected = f"no gap longer than {GAP_NS / 1e6:.0f} ms"
    if longest * NS_PER_S <= _LONG_GAP_NS:
        return note(
            "imu gaps", measured, expected, "none needed: bridged with a larger uncertainty", gaps=found
        )
    fix = "check for lost packets; a run is degraded over each gap"
    if longest * NS_PER_S > _LOST_GAP_NS:
        fix = "poses are not connected across 0.5 s without samples: a run initializes again after the gap"
    return warning("imu gaps", measured, expected, fix, gaps=found)


def check_imu_order(inspection: Inspection) -> CheckResult | None:
    """Ascending, unique timestamps and finite readings."""
    found: dict[str, dict[str, float]] = {}
    for readings in inspection.readings:
        t_ns, xyz = readings.rows["t_ns"], readings.rows["xyz"]
        behind = np.maximum.accumulate(t_ns) - t_ns
        counts = {
            "wrong_stamps": readings.wrong_stamps,
            "backward": int(np.count_nonzero(np.diff(t_ns) < 0)),
            "worst_s": float(behind.max()) / NS_PER_S,
            "repeated": int(t_ns.size - np.unique(t_ns).size),
            "not_finite": int(np.count_nonzero(~np.isfinite(xyz).all(axis=1))),
        }
        if any(counts.values()):
            found[readings.name] = counts
    if not inspection.readings:
        return None
    expected = "ascending and unique timestamps, finite readings"
    if not found and inspection.streams is not None and len(inspection.clock_parts) > 1:
        jumps = f"time jumps back {len(inspection.clock_parts) - 1} time(s), as that of the events"
        return warning("imu order", jumps, expected, "a run begins a new segment at each jump", found=found)
    if not found:
        return ok("imu order", "ascending and unique timestamps, all readings finite", found=found)
    measured = "; ".join(f"{name}: {_disorder(counts)}" for name, counts in found.items())
    size = max(_size(inspection), 1)
    share = max((c["repeated"] + c["not_finite"] + c["wrong_stamps"]) / size for c in found.values())
    if max(c["worst_s"] for c in found.values()) * NS_PER_S > MAX_DISORDER_NS:
        return fail(
            "imu order",
            measured,
            expected,
            "the clock jumped back, and not with the events: split the recording there",
            found=found,
        )
    if share > 0.05:
        return warning(
            "imu order",
            measured,
            expected,
            "samples written twice? A run drops repeated timestamps: check which ones are correct",
            found=found,
        )
    return note(
        "imu order",
        measured,
        expected,
        "none needed: a run sorts samples and drops invalid ones",
        found=found,
    )


def _disorder(counts: dict[str, float]) -> str:
    text = (
        f"{counts['backward']:.0f} step(s) back by up to {1e3 * counts['worst_s']:.3g} ms, "
        f"{counts['repeated']:.0f} repeated timestamp(s), {counts['not_finite']:.0f} non-finite reading(s)"
    )
    if counts["wrong_stamps"]:
        text = f"{counts['wrong_stamps']:.0f} sample(s) with an isolated wrong timestamp, {text}"
    return text


def check_overlap_of_clocks(inspection: Inspection) -> CheckResult | None:
    """Common clock of camera and IMU: both time ranges and their overlap."""
    span, streams = inspection.span_ns(), list(streams_of(inspection))
    if span is None or not streams:
        return None
    shift = inspection.calibration.timeshift_ns if inspection.calibration else 0
    camera = (span[0] + shift, span[1] + shift)
    imu = max(int(t.min()) for _, t, _ in streams), min(int(t.max()) for _, t, _ in streams)
    shared = min(camera[1], imu[1]) - max(camera[0], imu[0])
    share = max(shared, 0) / max(camera[1] - camera[0], 1)
    measured = f"camera {_range(camera)}, IMU {_range(imu)}, in common {max(shared, 0) / NS_PER_S:.4g} s"
    values = {"camera_ns": list(camera), "imu_ns": list(imu), "covered_share": share}
    expected = "samples over the whole time span of the camera"
    try:
        ends = (np.array(camera), np.array(imu))
        tick_ns = inspection.events.tick_ns if inspection.events else 1
        check_overlap(*ends, "the camera", "the IMU", tick_ns)
    except RecordingError as error:
        return fail("clocks", measured, expected, str(error), **values)
    if share < _COVERED and shared < _MIN_S * NS_PER_S <= camera[1] - camera[0]:
        return warning(
            "clocks", measured, expected, "start the IMU before the camera and stop it after", **values
        )
    if share < 0.6:
        half = 0.4 < (imu[1] - imu[0]) / max(camera[1] - camera[0], 1) < 0.6
        fix = "the IMU lasts half as long: timestamps with half the step?" if half else "record both together"
        return warning("clocks", measured, expected, fix, **values)
    if share < _COVERED:
        return note("clocks", measured, expected, "none needed: events without samples are skipped", **values)
    return ok("clocks", measured, **values)


def check_duration(inspection: Inspection) -> CheckResult | None:
    """Duration, against what initialization in motion needs."""
    span = inspection.span_ns()
    if span is None:
        times = [t for _, t, _ in streams_of(inspection)]
        if not times:
            return None
        span = min(int(t.min()) for t in times), max(int(t.max()) for t in times)
    seconds = (span[1] - span[0]) / NS_PER_S
    if seconds >= _MIN_S:
        return ok("duration", f"{seconds:.6g} s", seconds=seconds)
    return CheckResult(
        "duration",
        Severity.WARNING,
        f"{seconds:.6g} s: a short excerpt",
        f"at least {_MIN_S:g} s, which initialization in motion needs",
        "sufficient for tracking features; for odometry record longer",
        {"seconds": seconds},
        prevents=("run",),
    )


def _size(inspection: Inspection) -> int:
    return max((int(t.size) for _, t, _ in streams_of(inspection)), default=0)


def _range(ends: tuple[int, int]) -> str:
    return f"{ends[0] / NS_PER_S:.6f} to {ends[1] / NS_PER_S:.6f} s"
