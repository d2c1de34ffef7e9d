# SPDX-License-Identifier: Apache-2.0
"""The time span that all sensors of a recording share, cut into packets of one knot interval."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice, pairwise

import numpy as np

from asyneio.errors import RecordingError
from asyneio.inertial.gravity_axes import axis_complaint
from asyneio.inertial.gravity_witness import ask_gravity
from asyneio.io.recording.clock_jumps import PAUSE_NS
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

#: Longest accepted recording [s]: a week.
_LONGEST_S = 7 * 86400


def usable_span(recording: Recording | EventRecording) -> tuple[int, int]:
    """First and last time [ns, IMU clock] covered by both inertial sensors and by the camera.

    The end of a tracks recording is that of its inertial samples alone.

    Raises:
        RecordingError: the recording has no events, no samples of an inertial sensor or no calibration, or
            is longer than a week.
    """
    for name in ("gyroscope", "accelerometer"):
        if getattr(recording, name).size == 0:
            raise RecordingError(
                f"{recording.name} contains no {name} samples; odometry needs both inertial sensors "
                "(`asyneio track` needs events only)"
            )
    streams = (recording.gyroscope["t_ns"], recording.accelerometer["t_ns"])
    start_ns = max(int(t_ns[0]) for t_ns in streams)
    end_ns = min(int(t_ns[-1]) for t_ns in streams)
    if isinstance(recording, Recording):
        return check_length(recording.name, max(start_ns, int(recording.observations["t_ns"][0])), end_ns)
    if recording.events.size == 0:
        raise RecordingError(f"{recording.name} contains no events")
    shift_ns = calibration_of(recording).timeshift_ns
    first_ns, last_ns = (int(recording.events[i]["t_ns"]) + shift_ns for i in (0, -1))
    return check_length(recording.name, max(start_ns, first_ns), min(end_ns, last_ns))


def check_length(name: str, start_ns: int, end_ns: int) -> tuple[int, int]:
    """Return both ends unchanged.

    Raises:
        RecordingError: they are more than a week apart, so some timestamps are wrong.
    """
    if end_ns - start_ns > _LONGEST_S * NS_PER_S:
        raise RecordingError(
            f"{name} lasts {(end_ns - start_ns) / NS_PER_S / 86400.0:.0f} days, from {start_ns} to {end_ns} "
            "ns: some timestamps are wrong, or differ from the others in unit or epoch; run `asyneio doctor` "
            "to find them"
        )
    return start_ns, end_ns


def packets(
    recording: Recording | EventRecording,
    start_ns: int,
    interval_ns: int,
    count: int,
    tracked: Iterable[RecordArray] | None = None,
    skip: int = 0,
) -> Iterator[Packet]:
    """Cut a recording into `count` packets of one knot interval each, in time order.

    A packet contains the measurements after the end of the previous packet, up to and including its own end;
    the first packet also includes its start. An incomplete last interval is dropped, as no knot ends it.

    Args:
        recording: the recording.
        start_ns: start of the first packet [ns, IMU clock].
        interval_ns: length of a packet [ns].
        count: number of packets.
        tracked: observations of each packet, as an `ObservationStream` yields them; None: those in the
            recording itself. Packets of an event recording also carry the number of its events.
        skip: packets to omit at the beginning; `tracked` does not contain their observations.
    """
    ends_ns = start_ns + interval_ns * np.arange(count + 1, dtype=np.int64)
    events = [None] * count if isinstance(recording, Recording) else event_counts(recording, ends_ns)
    streams = (recording.gyroscope, recording.accelerometer)
    inertial = [islice(batches(stream, ends_ns), skip, None) for stream in streams]
    if tracked is None:
        tracked = islice(batches(observations_of(recording), ends_ns), skip, None)
    columns = zip(ends_ns[1 + skip :], tracked, *inertial, events[skip:], strict=True)
    for end_ns, observations, gyroscope, accelerometer, count_of_events in columns:
        yield Packet(int(end_ns), observations, gyroscope, accelerometer, count_of_events)


def event_counts(recording: EventRecording, ends_ns: IntArray) -> list[int]:
    """Number of events in each of N packets; `ends_ns` (N+1,): start of the first, all ends [ns, IMU clock].

    Raises:
        RecordingError: the recording has no calibration.
    """
    # One search at a time: of a memory map, only a few pages are read.
    t_ns = recording.events["t_ns"]
    shift_ns = calibration_of(recording).timeshift_ns
    cuts = [int(np.searchsorted(t_ns, int(end) - shift_ns, side="right")) for end in ends_ns]
    return [b - a for a, b in pairwise(cuts)]


def batches(stream: RecordArray, ends_ns: IntArray) -> Iterator[RecordArray]:
    """Cut records with an ascending `t_ns` at the N+1 times `ends_ns`: N views, the first with its start."""
    cut = np.searchsorted(stream["t_ns"], ends_ns, side="right")
    cut[0] = np.searchsorted(stream["t_ns"], ends_ns[0], side="left")
    for start, end in pairwise(cut):
        yield stream[start:end]


def observations_of(recording: Recording | EventRecording) -> RecordArray:
    """Observations (OBSERVATION_DTYPE) in the recording itself: none in an event recording."""
    return recording.observations if isinstance(recording, Recording) else np.empty(0, OBSERVATION_DTYPE)


def calibration_of(recording: Recording | EventRecording) -> Calibration:
    """The calibration, which the estimator requires.

    Raises:
        RecordingError: the recording has none.
    """
    if recording.calibration is None:
        raise RecordingError(
            f"{recording.name} has no complete calibration (intrinsics, extrinsics, IMU noise); put "
            "camchain-imucam.yaml and imu.yaml (Kalibr, or another supported format) next to it or pass them "
            "with --calibration and --imu; --preset adds the published values of a camera model"
        )
    return recording.calibration


def check_clock_jumps(recording: Recording | EventRecording, lost_gap_s: float) -> None:
    """Reject a setting with which poses would be predicted across a jump of the clock.

    Args:
        recording: what to run.
        lost_gap_s: time without inertial samples after which a segment ends [s].

    Raises:
        RecordingError: time jumps back, and the pause there need not end a segment.
    """
    pause_s = PAUSE_NS / NS_PER_S
    if isinstance(recording, EventRecording) and recording.clock_jumps and lost_gap_s >= pause_s:
        raise RecordingError(
            f"{recording.name}: time jumps back, and a segment must end there, but "
            f"health.lost_inertial_gap_s is {lost_gap_s:g} s; set it below {pause_s:g} s"
        )


def check_inertial_scales(recording: Recording | EventRecording) -> None:
    """Reject inertial samples whose scale or axes disagree with gravity: positions would be off by metres.

    Raises:
        RecordingError: measured gravity is far from 9.81 m/s^2, or rotates at another rate or about another
            axis than the gyroscope measures.
    """
    witness = ask_gravity(recording.gyroscope, recording.accelerometer)
    if witness is None:
        return
    complaint = (
        witness.force_complaint()
        or axis_complaint(recording.gyroscope, recording.accelerometer, witness)
        or witness.gyroscope_complaint()
    )
    if complaint:
        raise RecordingError(f"{recording.name}: {complaint}. Run `asyneio doctor` to examine the recording")
