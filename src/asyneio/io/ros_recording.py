"""Recordings of ROS 1 and ROS 2: what of a bag is taken, and how it was told."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.bag import Bag, Topic
from asyneio.io.beside import samples_beside, truth_beside
from asyneio.io.calibration import find_rig
from asyneio.io.contents import Contents, ReadOptions, Samples, split_samples
from asyneio.io.event_packets import ENCODINGS, TRIGGER, unwrap_first_times
from asyneio.io.event_source import SAMPLE_DTYPE
from asyneio.io.ros_events import RosEvents
from asyneio.io.ros_lens import lens_of
from asyneio.io.ros_survey import EventTopic, Survey, survey
from asyneio.io.rosbag1 import Rosbag1
from asyneio.io.rosbag2 import open_rosbag2
from asyneio.io.sensor_clock import SensorClock, fit_clock
from asyneio.io.stamps import drop_equal_stamps, sort_in_time
from asyneio.io.tum import MAX_NORM_ERROR, POSE_DTYPE, poses_of
from asyneio.types import PoseTrajectory

_MAX_LISTED = 20
#: Steps of an event's time, where it is one number: ns, us, ms, s.
_UNITS_NS = (1, 1000, 1_000_000, 1_000_000_000)


def read_rosbag1(path: Path, options: ReadOptions) -> Contents:
    """A bag of ROS 1. Raises RecordingError, CalibrationError: see `read_bag`."""
    return read_bag(Rosbag1(path), path.resolve().stem, options)


def read_rosbag2(path: Path, options: ReadOptions) -> Contents:
    """A folder or file of ROS 2. Raises RecordingError, CalibrationError: see `read_bag`."""
    return read_bag(open_rosbag2(path), path.resolve().stem, options)


def read_bag(bag: Bag, name: str, options: ReadOptions) -> Contents:
    """What a bag holds.

    Events and inertial samples are taken from the only topic that has them, or the one that `options` name.

    Raises:
        RecordingError: unreadable, no topic of events, several to choose from, or clocks that jump.
        CalibrationError: a calibration file is malformed or impossible.
    """
    found = survey(bag)
    topic = _choose(found, list(found.events), options.events, "events", bag.path)
    if topic is None:
        raise RecordingError(
            f"{bag.path} holds no topic of events; it holds {_listed(found, list(found.counts))}; expected "
            "dvs_msgs/EventArray, event_camera_msgs/EventPacket, or messages with the fields of one of them"
            + "".join(f"; {note}" for note in found.notes)
        )
    known = found.events[topic]
    _check_encoding(known, topic)
    notes: tuple[str, ...] = (
        f"{bag.path.name}: events from {topic.name} ({topic.type}, {found.counts[topic]} messages)",
    )
    unit_ns, clock = _clock(known, topic)
    samples, sample_notes = _samples(found, options, bag.path)
    truth, truth_notes = _truth(found, bag.path.parent)
    size = known.size if min(known.size) > 0 else None
    lens, lens_notes = lens_of(found, topic, size)
    broken = found.broken + sum(table.broken for table in (*found.imus.values(), *found.poses.values()))
    if broken:
        notes += (f"{bag.path.name}: left out {broken} message(s) that are damaged",)
    return Contents(
        name=name,
        decode=lambda: RosEvents(bag, topic, known, unit_ns, clock),
        size=size,
        rig=find_rig(bag.path.parent, options.calibration, options.imu),
        samples=samples,
        lens=None if lens is None else lambda width, height: lens,
        truth=truth,
        variant=f"{topic.name}{bag.identity}",
        notes=(*notes, *clock.notes, *sample_notes, *lens_notes, *truth_notes, *found.notes),
    )


def _choose(
    found: Survey, candidates: list[Topic], wanted: str | None, option: str, path: Path
) -> Topic | None:
    """The topic to take; None where there is none. Raises RecordingError where it cannot be told."""
    filled = [topic for topic in candidates if found.counts[topic]]
    if wanted is not None and filled:
        named = [topic for topic in filled if topic.name == wanted]
        if not named:
            raise RecordingError(
                f"{path} has no {option} in a topic {wanted}; it has {_listed(found, filled)}"
            )
        return named[0]
    if len(filled) > 1:
        raise RecordingError(
            f"{path} has {len(filled)} topics of {option}: {_listed(found, filled)}; choose one with "
            f"--{option} TOPIC"
        )
    return filled[0] if filled else None


def _listed(found: Survey, topics: list[Topic]) -> str:
    names = [f"{topic.name} ({topic.type}, {found.counts[topic]} messages)" for topic in topics[:_MAX_LISTED]]
    more = f" and {len(topics) - _MAX_LISTED} more" if len(topics) > _MAX_LISTED else ""
    return (", ".join(names) or "no message") + more


def _check_encoding(known: EventTopic, topic: Topic) -> None:
    if known.decoder is not None:
        return
    encodings = [encoding for encoding in known.encodings if encoding != TRIGGER]
    if len(encodings) != 1 or encodings[0] not in ENCODINGS:
        found = [repr(encoding[:20]) for encoding in list(known.encodings)[:8]]
        raise RecordingError(
            f"{topic.name} has packets encoded as {', '.join(found) or 'nothing readable'}; "
            f"expected one of {', '.join(ENCODINGS)}"
        )
    if known.big_endian:
        raise RecordingError(
            f"{topic.name} was recorded by a big-endian machine; only little-endian packets are understood"
        )


def _clock(known: EventTopic, topic: Topic) -> tuple[int, SensorClock]:
    """What a step of the events' time is [ns], and the clock that maps it to the host's."""
    host_ns, steps = (np.array(times, dtype=np.int64) for times in (known.host_ns, known.sensor_ns))
    if known.decoder is None:
        sensor_ns = unwrap_first_times(steps, host_ns) if "evt3" in known.encodings else steps
        return 1, fit_clock(sensor_ns, host_ns, topic.name)
    if not steps.size:
        return 1, SensorClock()
    lengths = int(host_ns[-1] - host_ns[0]), int(steps[-1] - steps[0])
    ratio = lengths[0] / lengths[1] if min(lengths) > 0 else host_ns[0] / max(int(steps[0]), 1)
    unit_ns = min(_UNITS_NS, key=lambda unit: abs(np.log(max(ratio, 1e-9) / unit)))
    return unit_ns, fit_clock(steps * unit_ns, host_ns, topic.name)


def _samples(found: Survey, options: ReadOptions, path: Path) -> tuple[Samples, tuple[str, ...]]:
    """The samples of a topic, or where the bag has none those of a file."""
    if options.samples is not None and Path(options.samples).is_file():
        return samples_beside(path.parent, options), ()
    topic = _choose(found, list(found.imus), options.samples, "samples", path)
    if topic is None:
        return samples_beside(path.parent, options), ()
    stamps, logged, values = found.imus[topic].columns()
    notes: tuple[str, ...] = (f"{path.name}: inertial samples from {topic.name}",)
    if stamps.size and not stamps.any():
        stamps = logged
        notes += (f"{topic.name}: the samples have no stamps; the times of recording were taken",)
    rows = np.empty(stamps.size, dtype=SAMPLE_DTYPE)
    rows["t_ns"], rows["gyroscope"], rows["accelerometer"] = stamps, values[:, :3], values[:, 3:]
    return split_samples(rows, topic.name), notes + _rate_notes(stamps, logged, topic.name)


def _rate_notes(stamps: np.ndarray, logged: np.ndarray, name: str) -> tuple[str, ...]:
    """A sentence where stamps go by at another pace than recording did: a driver is known to double it."""
    if stamps.size < 2 or logged[-1] - logged[0] < 1_000_000_000:
        return ()
    pace = float(stamps[-1] - stamps[0]) / float(logged[-1] - logged[0])
    if 0.98 < pace < 1.02:
        return ()
    return (
        f"{name}: stamps go by {pace:.3f} times as fast as the recording did; the driver's clock is wrong",
    )


def _truth(found: Survey, folder: Path) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """The poses of the only topic that has them, else of a file beside the bag."""
    topics = [topic for topic in found.poses if found.counts[topic]]
    if not topics:
        return truth_beside(folder)
    if len(topics) > 1:
        text = f"several topics of poses, none taken as truth: {_listed(found, topics)}"
        return None, (text,)
    stamps, _, values = found.poses[topics[0]].columns()
    rows = np.empty(stamps.size, dtype=POSE_DTYPE)
    rows["t_ns"], rows["p"], rows["q"] = stamps, values[:, :3], values[:, 3:]
    good = np.asarray(np.isfinite(values).all(axis=1))
    good[good] = np.abs(np.linalg.norm(rows["q"][good], axis=1) - 1.0) < MAX_NORM_ERROR
    name = topics[0].name
    if not good.any():
        return None, (f"{name}: no pose is usable as truth",)
    dropped = f"{name}: dropped {good.size - good.sum()} pose(s) that are none"
    try:
        rows, sorted_note = sort_in_time(rows[good], name)
    except RecordingError as error:
        return None, (f"not taken as truth: {error}",)
    rows, repeated_note = drop_equal_stamps(rows, name)
    notes = (f"the poses of {name} were taken as truth",) + (() if good.all() else (dropped,))
    return poses_of(rows), notes + sorted_note + repeated_note
