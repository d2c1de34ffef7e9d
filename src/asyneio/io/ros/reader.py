# SPDX-License-Identifier: Apache-2.0
"""Contents of ROS 1 and ROS 2 bags: selection of topics, clocks, calibration, ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import find_calibration
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.ros.bag import Bag, Topic
from asyneio.io.ros.camera_info import intrinsics_of_camera_info
from asyneio.io.ros.event_packets import ENCODINGS, TRIGGER, unwrap_first_times
from asyneio.io.ros.event_topic import RosEvents
from asyneio.io.ros.ground_truth import ground_truth_of_bag
from asyneio.io.ros.imu_topics import samples_of_bag
from asyneio.io.ros.rosbag1 import Rosbag1
from asyneio.io.ros.rosbag2 import open_rosbag2
from asyneio.io.ros.sensor_clock import SensorClock, fit_clock
from asyneio.io.ros.split_bags import open_parts
from asyneio.io.ros.survey import EventTopic, survey
from asyneio.io.ros.topic_choice import choose_topic, listed_topics

#: Units of event times that are one number: ns, us, ms, s.
_UNITS_NS = (1, 1000, 1_000_000, 1_000_000_000)


def read_rosbag1(path: Path, options: ReadOptions) -> Contents:
    """A bag of ROS 1. Raises RecordingError, CalibrationError: see `read_bag`."""
    return read_bag(Rosbag1(path), path.resolve().stem, options)


def read_rosbag2(path: Path, options: ReadOptions) -> Contents:
    """A folder or file of ROS 2. Raises RecordingError, CalibrationError: see `read_bag`."""
    return read_bag(open_rosbag2(path), path.resolve().stem, options)


def read_bag_parts(path: Path, options: ReadOptions) -> Contents:
    """The parts of a bag in a folder. Raises RecordingError, CalibrationError: see `read_bag`."""
    return read_bag(open_parts(path), path.resolve().name, options)


def read_bag(bag: Bag, name: str, options: ReadOptions) -> Contents:
    """Find the contents of a bag.

    Events and inertial samples come from the only topic that contains them, or from the one that `options`
    selects.

    Raises:
        RecordingError: unreadable, no topic of events, several without a selection, or clocks that jump.
        CalibrationError: a calibration file is malformed or impossible.
    """
    found = survey(bag)
    topic = choose_topic(found, list(found.events), options.events, "events", bag.path)
    if topic is None:
        raise RecordingError(
            f"{bag.path} contains no topic of events; it contains "
            f"{listed_topics(found, list(found.counts))}; expected dvs_msgs/EventArray, "
            "event_camera_msgs/EventPacket, or messages with the same fields"
            + "".join(f"; {note}" for note in found.notes)
        )
    known = found.events[topic]
    _check_encoding(known, topic)
    notes: tuple[str, ...] = (
        f"{bag.path.name}: events from {topic.name} ({topic.type}, {found.counts[topic]} messages)",
    )
    unit_ns, clock = _clock(known, topic)
    samples, sample_notes = samples_of_bag(found, options, bag.path)
    truth, truth_notes = ground_truth_of_bag(found, bag.path.parent)
    size = known.size if min(known.size) > 0 else None
    intrinsics, intrinsics_notes = intrinsics_of_camera_info(found, topic, size)
    broken = found.broken + sum(table.broken for table in (*found.imus.values(), *found.poses.values()))
    if broken:
        notes += (f"{bag.path.name}: skipped {broken} damaged message(s)",)
    return Contents(
        name=name,
        decode=lambda: RosEvents(bag, topic, known, unit_ns, clock),
        size=size,
        calibration=find_calibration(bag.path.parent, options.calibration, options.imu),
        samples=samples,
        intrinsics=None if intrinsics is None else lambda width, height: intrinsics,
        ground_truth=truth,
        variant=f"{topic.name}{bag.identity}",
        notes=(*notes, *clock.notes, *sample_notes, *intrinsics_notes, *truth_notes, *found.notes),
    )


def _check_encoding(known: EventTopic, topic: Topic) -> None:
    if known.decoder is not None:
        return
    encodings = [encoding for encoding in known.encodings if encoding != TRIGGER]
    if len(encodings) != 1 or encodings[0] not in ENCODINGS:
        found = [repr(encoding[:20]) for encoding in list(known.encodings)[:8]]
        raise RecordingError(
            f"{topic.name} has packets with the encoding {', '.join(found) or 'unknown'}; "
            f"expected one of {', '.join(ENCODINGS)}"
        )
    if known.big_endian:
        raise RecordingError(
            f"{topic.name} was recorded on a big-endian machine; only little-endian packets are supported"
        )


def _clock(known: EventTopic, topic: Topic) -> tuple[int, SensorClock]:
    """The unit of event times [ns], and the clock that maps sensor time to host time."""
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
