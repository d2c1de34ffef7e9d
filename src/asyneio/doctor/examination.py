# SPDX-License-Identifier: Apache-2.0
"""Read a recording and run all checks on it, in a fixed order."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from asyneio.doctor.checks.event_pixels import (
    check_hot_pixels,
    check_polarity,
    check_repeats,
    check_resolution,
)
from asyneio.doctor.checks.event_time import (
    check_event_clock,
    check_event_order,
    check_event_pauses,
    check_event_rate,
    check_flicker,
)
from asyneio.doctor.checks.extrinsics import check_extrinsics, check_time_offset
from asyneio.doctor.checks.image_scale import check_image_scale
from asyneio.doctor.checks.imu_scale import check_imu_scale
from asyneio.doctor.checks.imu_sources import check_one_source
from asyneio.doctor.checks.imu_time import (
    check_duration,
    check_imu_gaps,
    check_imu_order,
    check_imu_rate,
    check_imu_there,
    check_overlap_of_clocks,
    streams_of,
)
from asyneio.doctor.checks.imu_values import (
    check_dead_axes,
    check_gravity,
    check_imu_units,
    check_noise,
    check_spikes_and_saturation,
    check_stationary,
)
from asyneio.doctor.checks.intrinsics import check_calibration_there, check_distortion, check_focal_length
from asyneio.doctor.checks.replay import check_replay
from asyneio.doctor.checks.truth import check_truth
from asyneio.doctor.folder_files import check_files
from asyneio.doctor.gathering import gather
from asyneio.doctor.inspection import Inspection, fail, ok
from asyneio.doctor.other_kinds import MATLAB, PICTURES, POSES
from asyneio.doctor.result import CheckResult, Report, Severity
from asyneio.io.recording.contents import ReadOptions

#: In the order of the report. A check returns None if it does not apply.
CHECKS: tuple[Callable[[Inspection], CheckResult | None], ...] = (
    check_files,
    check_duration,
    check_event_rate,
    check_event_clock,
    check_event_order,
    check_event_pauses,
    check_repeats,
    check_resolution,
    check_polarity,
    check_hot_pixels,
    check_flicker,
    check_imu_there,
    check_imu_rate,
    check_imu_order,
    check_imu_gaps,
    check_one_source,
    check_imu_units,
    check_dead_axes,
    check_spikes_and_saturation,
    check_stationary,
    check_gravity,
    check_imu_scale,
    check_noise,
    check_replay,
    check_overlap_of_clocks,
    check_calibration_there,
    check_distortion,
    check_focal_length,
    check_extrinsics,
    check_image_scale,
    check_time_offset,
    check_truth,
)


#: Checks of the events that were read.
_OF_EVENTS = {
    "duration", "event rate", "event clock", "event order", "event pauses", "repeated events", "resolution",
    "polarity", "hot pixels", "flicker", "clocks",
}  # fmt: skip

#: Checks of the IMU, its calibration and its clock, which tracking does not need.
_OF_THE_IMU = {
    "inertial samples", "imu rate", "imu order", "imu gaps", "imu sources", "imu units", "imu axes",
    "imu range", "stationary", "imu gravity", "imu scale", "imu noise", "clocks", "extrinsics", "image scale",
    "time offset",
}  # fmt: skip

#: What to do with files that are not recordings.
FIXES = {
    MATLAB: "this is a MATLAB file: write its events as text (events.txt), one line `t[s] x y p` per event",
    PICTURES: "these are pictures: they contain no events; the simulator takes them as textures",
    POSES: "this is a trajectory: use it as ground truth (asyneio evaluate), or simulate along it",
}


def examine(
    path: Path | str, options: ReadOptions | None = None, progress: Callable[[float], None] | None = None
) -> Report:
    """Check whether a recording is usable, and report how to fix it if it is not.

    Args:
        path: a recording of any kind; what cannot be read is reported as a result, not raised.
        options: the user's reading options.
        progress: called with the fraction done, 0 to 1.
    """
    started = time.perf_counter()
    inspection, reading_s = gather(Path(path), options or ReadOptions(), progress)
    results = [_what_it_is(inspection)] if inspection.examinable else []
    fix = FIXES.get(inspection.kind, "")
    found = [result for check in CHECKS if (result := check(inspection)) is not None]
    # A check that reports the message of a reader adds the measured values.
    reported = {result.fix for result in found}
    results += [
        fail(failure.part, failure.message, "", fix)
        for failure in inspection.failures
        if failure.message not in reported
    ]
    if any(failure.part == "events" for failure in inspection.failures):
        # The reader already reported why it stopped: checks must not fail for the same cause.
        found = [result for result in found if result.check not in _OF_EVENTS or not result.fix]
    results += found
    if inspection.sees and inspection.tracks is None:
        results = [_for_odometry(result) for result in results]
    return Report(
        recording=str(path),
        results=tuple(results),
        commands=("run",) if inspection.tracks is not None else ("run", "track"),
        repairs=inspection.notes,
        events=inspection.events.count if inspection.events else 0,
        seconds=time.perf_counter() - started,
        reading_s=reading_s,
    )


def _for_odometry(result: CheckResult) -> CheckResult:
    """The result, which prevents odometry alone if it is a failure of the IMU."""
    if result.severity is not Severity.FAIL or result.check not in _OF_THE_IMU:
        return result
    return replace(result, prevents=("run",))


def _what_it_is(inspection: Inspection) -> CheckResult:
    """The kind of recording and the number of samples of each part."""
    parts = [inspection.kind]
    if inspection.events is not None:
        parts.append(f"{inspection.events.count} events")
    if inspection.tracks is not None:
        parts.append(f"{inspection.tracks.size} track observations")
    parts += [f"{t.size} samples of the {name}" for name, t, _ in streams_of(inspection)]
    if inspection.truth is not None:
        parts.append(f"{inspection.truth.t_ns.size} ground-truth poses")
    # If the reader stopped, its failure is the report.
    if inspection.sees or inspection.failures:
        return ok("recording", ", ".join(parts), kind=inspection.kind)
    return CheckResult(
        "recording",
        Severity.WARNING,
        f"{', '.join(parts)}; no events and no tracks",
        "events or feature tracks",
        "name the camera recording as well: only part of the data was checked",
        {"kind": inspection.kind},
        prevents=("run", "track"),
    )
