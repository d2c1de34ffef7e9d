"""The examination: gather the evidence, put it to every check, in this order."""

from __future__ import annotations

import time
from collections.abc import Callable
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
    check_rest,
    check_spikes_and_saturation,
)
from asyneio.doctor.checks.intrinsics import check_calibration_there, check_focal_length, check_lens
from asyneio.doctor.checks.replay import check_replay
from asyneio.doctor.checks.truth import check_truth
from asyneio.doctor.folder_files import check_files
from asyneio.doctor.gathering import gather
from asyneio.doctor.inspection import Inspection, fail, ok
from asyneio.doctor.other_kinds import MATLAB, PICTURES, POSES
from asyneio.doctor.result import CheckResult, Diagnosis, Severity
from asyneio.io.recording.contents import ReadOptions
from asyneio.progress import ProgressCallback

#: One after the other; None: there is nothing that this check could look at.
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
    check_imu_units,
    check_dead_axes,
    check_spikes_and_saturation,
    check_rest,
    check_gravity,
    check_imu_scale,
    check_noise,
    check_replay,
    check_overlap_of_clocks,
    check_calibration_there,
    check_lens,
    check_focal_length,
    check_extrinsics,
    check_image_scale,
    check_time_offset,
    check_truth,
)


#: Checks that look at the events that were read.
_OF_EVENTS = {
    "duration", "event rate", "event clock", "event order", "event pauses", "repeated events", "resolution",
    "polarity", "hot pixels", "flicker", "clocks",
}  # fmt: skip

#: What to do with files that are no recordings.
CURES = {
    MATLAB: "this is a MATLAB file: write its events as text (events.txt), t[s] x y p a line",
    PICTURES: "these are pictures: they hold no events; the simulator takes them as textures",
    POSES: "this is a trajectory: compare with it (asyneio evaluate), or simulate along it",
}


def examine(
    path: Path | str, options: ReadOptions | None = None, progress: ProgressCallback | None = None
) -> Diagnosis:
    """Whether a recording is usable, and if not, what is to be done.

    Args:
        path: a recording of any kind, or anything else: what cannot be read becomes a verdict.
        options: what the user says about it.
        progress: is told the share done.
    """
    started = time.perf_counter()
    evidence, reading_s = gather(Path(path), options or ReadOptions(), progress)
    verdicts = [_what_it_is(evidence)] if evidence.examinable else []
    cure = CURES.get(evidence.kind, "")
    verdicts += [fail(refusal.part, refusal.message, "", cure) for refusal in evidence.refusals]
    found = [verdict for check in CHECKS if (verdict := check(evidence)) is not None]
    if any(refusal.part == "events" for refusal in evidence.refusals):
        # What the reader gave up on is not judged a second time.
        found = [verdict for verdict in found if verdict.check not in _OF_EVENTS or not verdict.cure]
    verdicts += found
    return Diagnosis(
        recording=str(path),
        verdicts=tuple(verdicts),
        commands=("run",) if evidence.tracks is not None else ("run", "track"),
        repairs=evidence.notes,
        events=evidence.events.count if evidence.events else 0,
        seconds=time.perf_counter() - started,
        reading_s=reading_s,
    )


def _what_it_is(evidence: Inspection) -> CheckResult:
    """The kind of recording and how much of it there is."""
    parts = [evidence.kind]
    if evidence.events is not None:
        parts.append(f"{evidence.events.count} events")
    if evidence.tracks is not None:
        parts.append(f"{evidence.tracks.size} observations of tracks")
    parts += [f"{t.size} samples of the {name}" for name, t, _ in streams_of(evidence)]
    if evidence.truth is not None:
        parts.append(f"{evidence.truth.t_ns.size} true poses")
    # Where the reader gave up, its refusal says all.
    if evidence.sees or any(refusal.part == "events" for refusal in evidence.refusals):
        return ok("recording", ", ".join(parts), kind=evidence.kind)
    return CheckResult(
        "recording",
        Severity.WARNING,
        f"{', '.join(parts)}; no events and no tracks",
        "events or feature tracks",
        "name the recording of the camera as well: these are checks of a part",
        {"kind": evidence.kind},
        prevents=("run", "track"),
    )
