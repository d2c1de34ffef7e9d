# SPDX-License-Identifier: Apache-2.0
"""Turn the contents that a reader found into a recording: checked events, samples in SI units, one clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from asyneio.errors import CalibrationError, RecordingError
from asyneio.io.calibration import CAMCHAIN_FILE, CalibrationSelection, IncompleteCalibration
from asyneio.io.parsing.stamp_checks import (
    check_overlap,
    check_rate,
    drop_equal_stamps,
    median_rate_hz,
    sort_in_time,
    tick_of,
)
from asyneio.io.recording.cache import EventTable, load_events
from asyneio.io.recording.clock_jumps import ClockPart
from asyneio.io.recording.contents import Contents, Samples, split_samples
from asyneio.io.recording.event_checks import SensorSizeError
from asyneio.io.recording.inertial_units import InertialStreams, check_units
from asyneio.io.recording.sample_jumps import join_samples, jumps_back
from asyneio.progress import ProgressCallback
from asyneio.types import INERTIAL_DTYPE, Calibration, ClockJump, EventRecording, PoseTrajectory, RecordArray

#: Sensor sizes tried in this order if no file contains it: DAVIS240, DVXplorer Lite, DAVIS346, VGA, HD.
USUAL_SIZES = ((240, 180), (320, 240), (346, 260), (640, 480), (1280, 720))

#: Number of events from which the clock resolution is measured.
_TICK_EVENTS = 10_000


def assemble(
    contents: Contents,
    progress: ProgressCallback | None = None,
    cache_from: int | None = None,
    selection: CalibrationSelection | None = None,
    samples_needed: bool = True,
) -> EventRecording:
    """Decode and check the contents of a recording.

    Args:
        contents: what the reader found.
        progress: called with the fraction of the events converted.
        cache_from: see `load_events`.
        selection: which camera of the calibration, and a preset for missing values.
        samples_needed: if false, errors in inertial samples, or in calibration files found next to the
            recording, become notes.

    Raises:
        RecordingError: events or samples are unreadable or inconsistent, or do not share one clock.
        CalibrationError: the calibration is malformed, ambiguous, or for another sensor size.
        ConfigError: unknown preset.
    """
    sources = contents.calibration
    if sources.error and samples_needed:
        raise CalibrationError(sources.error)
    # Sample files are small: their errors are reported before the events are converted. Only jumps of the
    # clock are compared with those of the events.
    inertial = None
    if contents.samples and not jumps_back(contents.samples):
        inertial = _inertial(contents.samples, sources.declared_hz, samples_needed)
    table, size, notes = _load(contents, selection or CalibrationSelection(), progress, cache_from)
    if inertial is None or len(table.parts) > 1:
        samples = contents.samples or split_samples(table.samples, f"the IMU of {contents.name}")
        inertial = _inertial(samples, sources.declared_hz, samples_needed, table)
    rate_hz = median_rate_hz(inertial.gyroscope["t_ns"]) if inertial.gyroscope.size else None
    resolved, calibration_notes = _resolve(contents, size, selection, rate_hz)
    calibration = resolved if isinstance(resolved, Calibration) else None
    try:
        _check_clocks(table, inertial, calibration.timeshift_ns if calibration else 0)
    except RecordingError as error:
        if samples_needed:
            raise
        inertial = _without_samples(str(error), inertial.notes)
    ground_truth, truth_notes = usable_truth(contents, table.parts)
    return EventRecording(
        name=contents.name,
        events=table.events,
        width=size[0],
        height=size[1],
        gyroscope=inertial.gyroscope,
        accelerometer=inertial.accelerometer,
        camera=resolved.camera,
        calibration=calibration,
        ground_truth=ground_truth,
        notes=calibration_notes + table.notes + notes + inertial.notes + contents.notes + truth_notes,
        clock_jumps=tuple(_clock_jumps(table, calibration.timeshift_ns if calibration else 0)),
    )


def usable_truth(
    contents: Contents, parts: tuple[ClockPart, ...]
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """The ground truth and no note; none and a note if the clock of the events jumps back."""
    if contents.ground_truth is None or len(parts) < 2:
        return contents.ground_truth, ()
    note = "ground truth is not used: time jumps back, so its time stamps may belong to several parts"
    return None, (note,)


def _clock_jumps(table: EventTable, timeshift_ns: int) -> Iterator[ClockJump]:
    for before, after in pairwise(table.parts):
        t_ns = after.start_ns + after.offset_ns + timeshift_ns
        yield ClockJump(t_ns, before.end_ns - after.start_ns, after.offset_ns)


def _resolve(
    contents: Contents,
    size: tuple[int, int],
    selection: CalibrationSelection | None,
    rate_hz: float | None,
) -> tuple[Calibration | IncompleteCalibration, tuple[str, ...]]:
    """The calibration, and notes. Raises CalibrationError, also for another sensor size."""
    sources = contents.calibration
    resolved, notes = replace(sources, error="").resolve(size, selection, contents.intrinsics, rate_hz)
    if sources.error:
        notes = (f"the calibration is not used: {sources.error}", *notes)
    camera = resolved.camera
    if camera is not None and (camera.width, camera.height) != size:
        raise CalibrationError(
            f"the calibration is for {camera.width} x {camera.height} pixels, but {contents.name} "
            f"was recorded with {size[0]} x {size[1]}; use the calibration of this camera"
        )
    return resolved, notes


def _check_clocks(table: EventTable, inertial: InertialStreams, timeshift_ns: int) -> None:
    """Raises RecordingError: events and samples do not share one clock."""
    for sensor, stream in (("gyroscope", inertial.gyroscope), ("accelerometer", inertial.accelerometer)):
        if not stream.size:
            continue
        # Only the first and last event: all of them may exceed the memory.
        ends_ns = table.events["t_ns"][[0, -1]] + timeshift_ns
        tick_ns = tick_of(table.events["t_ns"][:_TICK_EVENTS])
        same = np.array_equal(inertial.gyroscope["t_ns"], inertial.accelerometer["t_ns"])
        what = "the IMU" if same else f"the {sensor}"
        check_overlap(ends_ns, stream["t_ns"], "the events", what, tick_ns)


def _inertial(
    samples: Samples, declared_hz: float | None, needed: bool, table: EventTable | None = None
) -> InertialStreams:
    """Like `prepare_samples`, of samples joined like the events of `table`; if samples are not needed, an
    error leaves empty streams and a note."""
    try:
        joined = join_samples(samples, table.parts, table.dropped_parts) if table else samples
        return prepare_samples(joined, declared_hz)
    except RecordingError as error:
        if needed:
            raise
        return _without_samples(str(error), samples.notes)


def _without_samples(reason: str, notes: tuple[str, ...]) -> InertialStreams:
    note = f"the inertial samples are not used: {reason}"
    return InertialStreams(np.empty(0, INERTIAL_DTYPE), np.empty(0, INERTIAL_DTYPE), (*notes, note))


def prepare_samples(samples: Samples, declared_hz: float | None) -> InertialStreams:
    """Convert samples as stored in a file to two checked streams in SI units.

    Raises:
        RecordingError: inconsistent times or units.
    """
    if samples.error:
        raise RecordingError(samples.error)
    gyroscope, accelerometer, name = samples.gyroscope, samples.accelerometer, samples.name
    notes = samples.notes
    if min(gyroscope.size, accelerometer.size) < 2:
        if gyroscope.size or accelerometer.size:
            counts = f"{gyroscope.size} gyroscope and {accelerometer.size} accelerometer sample(s)"
            notes += (f"{name} contains {counts}: too few, not used",)
        return InertialStreams(gyroscope[:0], accelerometer[:0], notes)
    if np.array_equal(gyroscope["t_ns"], accelerometer["t_ns"]):
        # One sensor with six axes: an invalid half invalidates the other.
        good = _finite(gyroscope) & _finite(accelerometer)
        gyroscope, added = _in_order(gyroscope, good, declared_hz, name)
        accelerometer, _ = _in_order(accelerometer, good, None, name)
        notes += added
    else:
        gyroscope, added = _in_order(gyroscope, _finite(gyroscope), declared_hz, f"{name}, gyroscope")
        notes += added
        good = _finite(accelerometer)
        accelerometer, added = _in_order(accelerometer, good, None, f"{name}, accelerometer")
        notes += added
    return check_units(gyroscope, accelerometer, notes)


def _finite(stream: RecordArray) -> np.ndarray:
    return np.asarray(np.isfinite(stream["xyz"]).all(axis=1))


def _in_order(
    stream: RecordArray, good: np.ndarray, declared_hz: float | None, name: str
) -> tuple[RecordArray, tuple[str, ...]]:
    notes: tuple[str, ...] = ()
    if not good.all():
        notes = (f"{name}: dropped {int(stream.size - good.sum())} sample(s) that are not finite",)
    stream, sorted_note = sort_in_time(stream[good], name)
    stream, dropped_note = drop_equal_stamps(stream, name)
    return stream, notes + sorted_note + dropped_note + check_rate(stream["t_ns"], declared_hz, name)


def _load(
    contents: Contents,
    selection: CalibrationSelection,
    progress: ProgressCallback | None,
    cache_from: int | None,
) -> tuple[EventTable, tuple[int, int], tuple[str, ...]]:
    """Events, sensor size, and a note if the size was guessed."""
    size = contents.size or contents.calibration.size or selection.size
    if size is not None:
        table = load_events(contents.decode(), *size, progress, cache_from, contents.variant)
        return table, size, ()
    for usual in USUAL_SIZES:
        try:
            table = load_events(contents.decode(), *usual, progress, cache_from, contents.variant)
        except SensorSizeError:
            continue
        return (
            table,
            usual,
            (f"sensor size not in any file; assumed from the events: {usual[0]} x {usual[1]}",),
        )
    raise RecordingError(
        f"the events of {contents.name} fit no common sensor size (up to {usual[0]} x {usual[1]}); set the "
        f"resolution in {CAMCHAIN_FILE}"
    )
