"""What a recording holds in common, cut into packets of one knot interval."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from asyneio.errors import RecordingError
from asyneio.inertial.gravity_witness import ask_gravity
from asyneio.types import (
    NS_PER_S,
    OBSERVATION_DTYPE,
    Calibration,
    EventRecording,
    IntArray,
    Packet,
    RecordArray,
    Recording,
)

#: No recording lasts longer [s]: a week.
_LONGEST_S = 7 * 86400


def usable_span(recording: Recording | EventRecording) -> tuple[int, int]:
    """First and last instant [ns] at which both inertial sensors had data, from the first observation
    or event on.

    Raises:
        RecordingError: the recording lacks events, tracks or samples of an inertial sensor, or its
        calibration, or lasts for weeks.
    """
    for name in ("gyroscope", "accelerometer"):
        if getattr(recording, name).size == 0:
            raise RecordingError(
                f"{recording.name} holds no samples of the {name}; expected both inertial sensors: "
                "`asyneio track` follows the features of events alone"
            )
    streams = (recording.gyroscope["t_ns"], recording.accelerometer["t_ns"])
    start_ns = max(int(t_ns[0]) for t_ns in streams)
    end_ns = min(int(t_ns[-1]) for t_ns in streams)
    if isinstance(recording, Recording):
        return check_length(recording.name, max(start_ns, int(recording.observations["t_ns"][0])), end_ns)
    if recording.events.size == 0:
        raise RecordingError(f"{recording.name} holds no events")
    shift_ns = calibration_of(recording).timeshift_ns
    first_ns, last_ns = (int(recording.events[i]["t_ns"]) + shift_ns for i in (0, -1))
    return check_length(recording.name, max(start_ns, first_ns), min(end_ns, last_ns))


def check_length(name: str, start_ns: int, end_ns: int) -> tuple[int, int]:
    """Both ends, as given. Raises RecordingError where no recording lasts so long: stamps are wrong."""
    if end_ns - start_ns > _LONGEST_S * NS_PER_S:
        raise RecordingError(
            f"{name} lasts {(end_ns - start_ns) / NS_PER_S / 86400.0:.0f} days, from {start_ns} to {end_ns} "
            "ns: some stamps are wrong, or in another unit or epoch than the others; `asyneio doctor` looks "
            "for them"
        )
    return start_ns, end_ns


def packets(
    recording: Recording | EventRecording,
    start_ns: int,
    interval_ns: int,
    count: int,
    tracked: Iterable[RecordArray] | None = None,
) -> Iterator[Packet]:
    """Cut a recording into `count` packets of one knot interval each, in time order.

    A packet holds what was measured after the previous packet's end up to and including its own; the first
    also holds its start. A last interval that is not complete is left out: it has no knot at its end.
    `tracked` gives the observations of each packet where the recording holds events, whose number the packets
    then tell.
    """
    ends_ns = start_ns + interval_ns * np.arange(count + 1, dtype=np.int64)
    events = [None] * count if isinstance(recording, Recording) else event_counts(recording, ends_ns)
    inertial = [_batches(stream, ends_ns) for stream in (recording.gyroscope, recording.accelerometer)]
    batches = _batches(observations_of(recording), ends_ns) if tracked is None else tracked
    columns = zip(ends_ns[1:], batches, *inertial, events, strict=True)
    for end_ns, observations, gyroscope, accelerometer, count_of_events in columns:
        yield Packet(int(end_ns), observations, gyroscope, accelerometer, count_of_events)


def event_counts(recording: EventRecording, ends_ns: IntArray) -> list[int]:
    """Number of events of each of N packets, from the start of the first and all ends (N+1,) [ns, IMU clock].

    Raises:
        RecordingError: the recording has no calibration.
    """
    # Searched bit by bit: of a memory map only a few pages are read.
    t_ns = recording.events["t_ns"]
    shift_ns = calibration_of(recording).timeshift_ns
    cuts = [int(np.searchsorted(t_ns, int(end) - shift_ns, side="right")) for end in ends_ns]
    return [b - a for a, b in pairwise(cuts)]


def _batches(stream: RecordArray, ends_ns: IntArray) -> Iterator[RecordArray]:
    cut = np.searchsorted(stream["t_ns"], ends_ns, side="right")
    cut[0] = np.searchsorted(stream["t_ns"], ends_ns[0], side="left")
    for start, end in pairwise(cut):
        yield stream[start:end]


def observations_of(recording: Recording | EventRecording) -> RecordArray:
    """Observations that the recording itself holds: none in one of events."""
    return recording.observations if isinstance(recording, Recording) else np.empty(0, OBSERVATION_DTYPE)


def calibration_of(recording: Recording | EventRecording) -> Calibration:
    """The calibration, which an estimator cannot do without.

    Raises:
        RecordingError: there is none.
    """
    if recording.calibration is None:
        raise RecordingError(
            f"{recording.name} comes without a whole calibration (lens, extrinsics, IMU noise); expected "
            "camchain-imucam.yaml and imu.yaml (Kalibr, or another usual kind) beside it, or given with "
            "--calibration and --imu; --preset fills in what is published of a camera"
        )
    return recording.calibration


def check_inertial_scales(recording: Recording | EventRecording) -> None:
    """Refuse inertial samples whose scale gravity contradicts: positions would be off by metres.

    Raises:
        RecordingError: gravity is far from 9.81 m/s^2, or turns far from how the gyroscope says.
    """
    witness = ask_gravity(recording.gyroscope, recording.accelerometer)
    if witness is None:
        return
    complaint = witness.force_complaint() or witness.gyroscope_complaint()
    if complaint:
        raise RecordingError(
            f"{recording.name}: {complaint}. `asyneio doctor` examines the recording further"
        )
