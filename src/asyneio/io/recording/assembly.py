"""From what a reader found to a recording: events checked, samples in SI units, one clock, one sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.errors import CalibrationError, RecordingError
from asyneio.io.calibration import CAMCHAIN_FILE, Wanted, settle
from asyneio.io.parsing.stamps import (
    check_overlap,
    check_rate,
    drop_equal_stamps,
    median_rate_hz,
    sort_in_time,
    tick_of,
)
from asyneio.io.recording.cache import EventTable, load_events
from asyneio.io.recording.checks import SensorSizeError
from asyneio.io.recording.contents import Contents, Samples, split_samples
from asyneio.io.recording.inertial_csv import InertialStreams, check_units
from asyneio.progress import ProgressCallback
from asyneio.types import INERTIAL_DTYPE, EventRecording, RecordArray

#: Sensors tried in this order where no file tells the size: DAVIS240, DVXplorer Lite, DAVIS346, VGA, HD.
USUAL_SIZES = ((240, 180), (320, 240), (346, 260), (640, 480), (1280, 720))

#: So many events show the step of their clock.
_TICK_EVENTS = 10_000


def assemble(
    contents: Contents,
    progress: ProgressCallback | None = None,
    cache_from: int | None = None,
    wanted: Wanted | None = None,
    samples_needed: bool = True,
) -> EventRecording:
    """Decode and check what a reader found.

    Args:
        contents: what it found.
        progress: is told the fraction of the events converted.
        cache_from: see `load_events`.
        wanted: which camera of the calibration, and a preset for what is missing in it.
        samples_needed: false where trouble with the inertial samples, or with calibration files that were
            found, is a note.

    Raises:
        RecordingError: events or samples that cannot be read or explained, or that do not share one clock.
        CalibrationError: the calibration is malformed, leaves a choice, or speaks of another sensor size.
        ConfigError: there is no such preset.
    """
    trouble = contents.rig.trouble
    if trouble and samples_needed:
        raise CalibrationError(trouble)
    declared_hz = contents.rig.declared_hz
    # Files of samples are small: what is wrong with them is said before the events are converted.
    inertial = _inertial(contents.samples, declared_hz, samples_needed) if contents.samples else None
    table, size, notes = _load(contents, wanted or Wanted(), progress, cache_from)
    if inertial is None:
        samples = split_samples(table.samples, f"the IMU of {contents.name}")
        inertial = _inertial(samples, declared_hz, samples_needed)
    rate_hz = median_rate_hz(inertial.gyroscope["t_ns"]) if inertial.gyroscope.size else None
    rig = settle(replace(contents.rig, trouble=""), size, wanted, contents.lens, rate_hz)
    if trouble:
        rig = replace(rig, notes=(f"the calibration is not used: {trouble}", *rig.notes))
    if rig.camera is not None and (rig.camera.width, rig.camera.height) != size:
        raise CalibrationError(
            f"the calibration is for {rig.camera.width} x {rig.camera.height} pixels, but {contents.name} "
            f"was recorded with {size[0]} x {size[1]}; use the calibration of this camera"
        )
    timeshift_ns = rig.calibration.timeshift_ns if rig.calibration else 0
    try:
        _check_clocks(table, inertial, timeshift_ns)
    except RecordingError as error:
        if samples_needed:
            raise
        inertial = _without(str(error), inertial.notes)
    return EventRecording(
        name=contents.name,
        events=table.events,
        width=size[0],
        height=size[1],
        gyroscope=inertial.gyroscope,
        accelerometer=inertial.accelerometer,
        camera=rig.camera,
        calibration=rig.calibration,
        ground_truth=contents.truth,
        notes=rig.notes + table.notes + notes + inertial.notes + contents.notes,
    )


def _check_clocks(table: EventTable, inertial: InertialStreams, timeshift_ns: int) -> None:
    """Raises RecordingError: events and samples do not share one clock."""
    for sensor, stream in (("gyroscope", inertial.gyroscope), ("accelerometer", inertial.accelerometer)):
        if not stream.size:
            continue
        # Two events, not the whole: they may be larger than memory.
        ends_ns = table.events["t_ns"][[0, -1]] + timeshift_ns
        tick_ns = tick_of(table.events["t_ns"][:_TICK_EVENTS])
        same = np.array_equal(inertial.gyroscope["t_ns"], inertial.accelerometer["t_ns"])
        what = "the IMU" if same else f"the {sensor}"
        check_overlap(ends_ns, stream["t_ns"], "the events", what, tick_ns)


def _inertial(samples: Samples, declared_hz: float | None, needed: bool) -> InertialStreams:
    """As `prepare_samples`; where samples are not needed, trouble with them leaves none and a note."""
    try:
        return prepare_samples(samples, declared_hz)
    except RecordingError as error:
        if needed:
            raise
        return _without(str(error), samples.notes)


def _without(trouble: str, notes: tuple[str, ...]) -> InertialStreams:
    said = f"the samples of the IMU are not used: {trouble}"
    return InertialStreams(np.empty(0, INERTIAL_DTYPE), np.empty(0, INERTIAL_DTYPE), (*notes, said))


def prepare_samples(samples: Samples, declared_hz: float | None) -> InertialStreams:
    """Samples as they stand in a file as two checked streams in SI units.

    Raises:
        RecordingError: time or units that cannot be explained.
    """
    if samples.trouble:
        raise RecordingError(samples.trouble)
    gyroscope, accelerometer, name = samples.gyroscope, samples.accelerometer, samples.name
    notes = samples.notes
    if min(gyroscope.size, accelerometer.size) < 2:
        if gyroscope.size or accelerometer.size:
            counts = f"{gyroscope.size} sample(s) of the gyroscope, {accelerometer.size} of the accelerometer"
            notes += (f"{name} holds {counts}: too few, left out",)
        return InertialStreams(gyroscope[:0], accelerometer[:0], notes)
    if np.array_equal(gyroscope["t_ns"], accelerometer["t_ns"]):
        # One sensor with six axes: what is wrong with one half concerns the other.
        good = _finite(gyroscope) & _finite(accelerometer)
        gyroscope, said = _in_order(gyroscope, good, declared_hz, name)
        accelerometer, _ = _in_order(accelerometer, good, None, name)
        notes += said
    else:
        gyroscope, said = _in_order(gyroscope, _finite(gyroscope), declared_hz, f"{name}, gyroscope")
        notes += said
        good = _finite(accelerometer)
        accelerometer, said = _in_order(accelerometer, good, None, f"{name}, accelerometer")
        notes += said
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
    contents: Contents, wanted: Wanted, progress: ProgressCallback | None, cache_from: int | None
) -> tuple[EventTable, tuple[int, int], tuple[str, ...]]:
    """Events, the size of the sensor, and a sentence where it was guessed."""
    size = contents.size or contents.rig.size or wanted.size
    if size is not None:
        table = load_events(contents.decode(), *size, progress, cache_from, contents.variant)
        return table, size, ()
    for usual in USUAL_SIZES:
        try:
            table = load_events(contents.decode(), *usual, progress, cache_from, contents.variant)
        except SensorSizeError:
            continue
        text = f"no file tells the sensor's size: taken to be {usual[0]} x {usual[1]}, which holds the events"
        return table, usual, (text,)
    raise RecordingError(
        f"the events of {contents.name} fit no usual sensor (up to {usual[0]} x {usual[1]}); give "
        f"the size as the resolution in {CAMCHAIN_FILE}"
    )
