"""Checks on the times of inertial samples: rate, gaps, order, and a common clock with the camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from asyneio.doctor.inspection import Inspection, fail, note, ok, warning
from asyneio.doctor.result import CheckResult, Severity
from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import GAP_NS, MAX_DISORDER_NS, PLAUSIBLE_RATE_HZ, check_overlap
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: The estimator calls itself degraded after a pause of this length, and begins anew after the second.
_LONG_GAP_NS, _LOST_GAP_NS = 50_000_000, 500_000_000
#: Ratio to the declared rate that is no fault, and that of samples told twice or at half their spacing.
_RATE_RATIO, _TWICE_RATIO = (0.8, 1.25), (1.8, 2.2)
#: Share of steps further than this share from the usual one, that is jitter.
_JITTER = 0.3
#: Share of what the camera saw that samples must cover.
_COVERED = 0.98
_MIN_S = 1.0


def streams_of(evidence: Inspection) -> Iterator[tuple[str, IntArray, FloatArray]]:
    """Name, stamps in the order of the file and readings of each sensor that has any, without isolated wrong
    stamps."""
    for readings in evidence.readings:
        yield readings.name, readings.rows["t_ns"], readings.rows["xyz"]


def check_imu_there(evidence: Inspection) -> CheckResult | None:
    """Odometry needs an IMU; following features does not."""
    found = dict((name, int(t.size)) for name, t, _ in streams_of(evidence))
    if len(found) == 2:
        counts = ", ".join(f"{count} samples of the {name}" for name, count in found.items())
        return ok("imu", counts, **found)
    if any(refusal.part == "inertial samples" for refusal in evidence.refusals) or not evidence.sees:
        return None
    return CheckResult(
        "imu",
        Severity.WARNING,
        "no inertial samples" if not found else f"only a {', '.join(found)}",
        "gyroscope and accelerometer",
        "features can be followed (asyneio track); for odometry give the file of the samples",
        dict(found),
        prevents=("run",),
    )


def check_imu_rate(evidence: Inspection) -> CheckResult | None:
    """The median rate, against what the calibration declares and what such sensors do."""
    rates: dict[str, float] = {}
    jitter: dict[str, float] = {}
    for name, t_ns, _ in streams_of(evidence):
        steps = np.diff(np.sort(t_ns)).astype(np.float64)
        steps = steps[steps > 0.0]
        if steps.size:
            usual = float(np.median(steps))
            rates[name] = NS_PER_S / usual
            jitter[name] = float((np.abs(steps - usual) > _JITTER * usual).mean())
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
            "time is likely in another unit: convert it",
            **values,
        )
    declared = evidence.calibration.noise.rate_hz if evidence.calibration else None
    if declared is not None:
        values["declared_hz"] = declared
        ratios = {name: rate / declared for name, rate in rates.items()}
        off = {n: r for n, r in ratios.items() if not _RATE_RATIO[0] <= r <= _RATE_RATIO[1]}
        if off:
            twice = any(_TWICE_RATIO[0] <= ratio <= _TWICE_RATIO[1] for ratio in off.values())
            cure = (
                "twice the declared rate: a driver that writes samples twice or advances stamps by half a "
                "step; compare the length of the samples with that of the events"
                if twice
                else "correct update_rate in the calibration, or look for lost samples"
            )
            return warning(
                "imu rate", measured, f"{declared:.5g} Hz as the calibration declares", cure, **values
            )
    worst = max(jitter.values())
    if worst > 0.2:
        return note(
            "imu rate",
            f"{measured}; {worst:.0%} of the steps are off by more than {_JITTER:.0%}",
            "even steps",
            "stamps of the host instead of the sensor: use the sensor's clock where there is one",
            **values,
        )
    return ok("imu rate", measured, **values)


def check_imu_gaps(evidence: Inspection) -> CheckResult | None:
    """Pauses of the samples: what was not measured must be bridged."""
    found: dict[str, dict[str, float]] = {}
    for name, t_ns, _ in streams_of(evidence):
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
    if not any(True for _ in streams_of(evidence)):
        return None
    if not found:
        return ok("imu gaps", f"none longer than {GAP_NS / 1e6:.0f} ms", gaps=found)
    longest = max(gap["longest_s"] for gap in found.values())
    measured = "; ".join(
        f"{name}: {gap['count']:.0f} gap(s), the longest {1e3 * gap['longest_s']:.1f} ms "
        f"from {gap['at_s']:.4g} s on"
        for name, gap in found.items()
    )
    expected = f"no gap longer than {GAP_NS / 1e6:.0f} ms"
    if longest * NS_PER_S <= _LONG_GAP_NS:
        return note("imu gaps", measured, expected, "bridged with more uncertainty", gaps=found)
    cure = "look for lost packets; a run calls itself degraded over each"
    if longest * NS_PER_S > _LOST_GAP_NS:
        cure = "nothing ties the poses across half a second without samples: a run begins anew after it"
    return warning("imu gaps", measured, expected, cure, gaps=found)


def check_imu_order(evidence: Inspection) -> CheckResult | None:
    """Stamps in order, each once, each reading finite."""
    found: dict[str, dict[str, float]] = {}
    for readings in evidence.readings:
        t_ns, xyz = readings.rows["t_ns"], readings.rows["xyz"]
        behind = np.maximum.accumulate(t_ns) - t_ns
        counts = {
            "misdated": readings.misdated,
            "backward": int(np.count_nonzero(np.diff(t_ns) < 0)),
            "worst_s": float(behind.max()) / NS_PER_S,
            "repeated": int(t_ns.size - np.unique(t_ns).size),
            "not_finite": int(np.count_nonzero(~np.isfinite(xyz).all(axis=1))),
        }
        if any(counts.values()):
            found[readings.name] = counts
    if not evidence.readings:
        return None
    if not found:
        return ok("imu order", "ascending, each stamp once, all readings finite", found=found)
    measured = "; ".join(f"{name}: {_disorder(counts)}" for name, counts in found.items())
    expected = "ascending stamps, each once, finite readings"
    size = max(_size(evidence), 1)
    share = max((c["repeated"] + c["not_finite"] + c["misdated"]) / size for c in found.values())
    if max(c["worst_s"] for c in found.values()) * NS_PER_S > MAX_DISORDER_NS:
        return fail(
            "imu order", measured, expected, "the clock was set back: split the recording there", found=found
        )
    if share > 0.05:
        return warning(
            "imu order",
            measured,
            expected,
            "samples written twice? A run drops what repeats: find out which stamps are right",
            found=found,
        )
    return note("imu order", measured, expected, "none needed: sorted, and the rest dropped", found=found)


def _disorder(counts: dict[str, float]) -> str:
    said = (
        f"{counts['backward']:.0f} step(s) back by up to {1e3 * counts['worst_s']:.3g} ms, "
        f"{counts['repeated']:.0f} repeated stamp(s), {counts['not_finite']:.0f} reading(s) not finite"
    )
    if counts["misdated"]:
        said = f"{counts['misdated']:.0f} sample(s) with a wrong stamp between samples in order, {said}"
    return said


def check_overlap_of_clocks(evidence: Inspection) -> CheckResult | None:
    """Camera and IMU on one clock: both ranges, and what they share."""
    span, streams = evidence.span_ns(), list(streams_of(evidence))
    if span is None or not streams:
        return None
    shift = evidence.calibration.timeshift_ns if evidence.calibration else 0
    camera = (span[0] + shift, span[1] + shift)
    imu = max(int(t.min()) for _, t, _ in streams), min(int(t.max()) for _, t, _ in streams)
    shared = min(camera[1], imu[1]) - max(camera[0], imu[0])
    share = max(shared, 0) / max(camera[1] - camera[0], 1)
    measured = f"camera {_range(camera)}, IMU {_range(imu)}, in common {max(shared, 0) / NS_PER_S:.4g} s"
    values = {"camera_ns": list(camera), "imu_ns": list(imu), "covered_share": share}
    expected = "samples over all that the camera saw"
    try:
        ends = (np.array(camera), np.array(imu))
        tick_ns = evidence.events.tick_ns if evidence.events else 1
        check_overlap(*ends, "the camera", "the IMU", tick_ns)
    except RecordingError as error:
        return fail("clocks", measured, expected, str(error), **values)
    if share < _COVERED and shared < _MIN_S * NS_PER_S <= camera[1] - camera[0]:
        return warning("clocks", measured, expected, "record both together, from before to after", **values)
    if share < 0.6:
        half = 0.4 < (imu[1] - imu[0]) / max(camera[1] - camera[0], 1) < 0.6
        cure = (
            "the IMU lasts half as long: stamps advanced by half a step?" if half else "record both together"
        )
        return warning("clocks", measured, expected, cure, **values)
    if share < _COVERED:
        return note("clocks", measured, expected, "what has no samples is left out", **values)
    return ok("clocks", measured, **values)


def check_duration(evidence: Inspection) -> CheckResult | None:
    """Long enough to start: the first window needs a second of motion."""
    span = evidence.span_ns()
    if span is None:
        times = [t for _, t, _ in streams_of(evidence)]
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
        f"at least {_MIN_S:g} s, which a start in motion needs",
        "enough to follow features; record longer for odometry",
        {"seconds": seconds},
        prevents=("run",),
    )


def _size(evidence: Inspection) -> int:
    return max((int(t.size) for _, t, _ in streams_of(evidence)), default=0)


def _range(ends: tuple[int, int]) -> str:
    return f"{ends[0] / NS_PER_S:.6f} to {ends[1] / NS_PER_S:.6f} s"
