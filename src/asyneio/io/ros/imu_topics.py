# SPDX-License-Identifier: Apache-2.0
"""Inertial samples of a bag: from one topic, or from two with one sensor each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asyneio.io.recording.contents import ReadOptions, Samples, no_samples
from asyneio.io.recording.sidecar import find_samples
from asyneio.io.ros.bag import Topic
from asyneio.io.ros.survey import Survey
from asyneio.io.ros.topic_choice import choose_topic, listed_topics
from asyneio.types import INERTIAL_DTYPE, FloatArray, RecordArray

Notes = tuple[str, ...]


@dataclass(frozen=True)
class _ImuTopic:
    """Samples of a topic: whether gyroscope and accelerometer are not only zeros, the streams, and notes."""

    topic: Topic
    has_gyroscope: bool
    has_accelerometer: bool
    gyroscope: RecordArray
    accelerometer: RecordArray
    notes: Notes

    @property
    def whole(self) -> bool:
        """Whether the topic has both sensors."""
        return self.has_gyroscope and self.has_accelerometer


def samples_of_bag(found: Survey, options: ReadOptions, path: Path) -> tuple[Samples, Notes]:
    """Samples of one topic, or of two with one sensor each; from a sidecar file if the bag has none.

    RealSense and other cameras have a topic of `sensor_msgs/Imu` for each sensor, with zeros for the other.

    Raises:
        RecordingError: the user names a topic or file that does not exist.
    """
    selected = options.samples
    filled = [topic for topic in found.imus if found.counts[topic]]
    if (selected is not None and Path(selected).is_file()) or not filled:
        return find_samples(path.parent, options), ()
    if selected is None:
        topics = filled
    else:
        names = [name.strip() for name in selected.split(",")]
        topics = [
            topic
            for name in names
            if (topic := choose_topic(found, filled, name, "samples", path)) is not None
        ]
    imus = [_read(found, topic) for topic in topics]
    whole = [imu for imu in imus if imu.whole]
    halves = [imu for imu in imus if imu.has_gyroscope != imu.has_accelerometer]
    if len(imus) == 1 or len(whole) == 1:
        return _one(imus[0] if len(imus) == 1 else whole[0], found, filled, path)
    gyroscopes = [imu for imu in halves if imu.has_gyroscope]
    accelerometers = [imu for imu in halves if imu.has_accelerometer]
    if not whole and len(gyroscopes) == len(accelerometers) == 1:
        return _joined(gyroscopes[0], accelerometers[0], path)
    error = (
        f"{path} has {len(topics)} topics of samples: {listed_topics(found, topics)}; select one with "
        "--samples TOPIC, or two with one sensor each with --samples TOPIC,TOPIC"
    )
    return no_samples(path.name, error), ()


def _one(imu: _ImuTopic, found: Survey, filled: list[Topic], path: Path) -> tuple[Samples, Notes]:
    name = imu.topic.name
    notes: Notes = (f"{path.name}: inertial samples from {name}",)
    others = [topic for topic in filled if topic is not imu.topic]
    if imu.has_gyroscope and not imu.has_accelerometer:
        for other in others:
            if _read(found, other).has_accelerometer:
                error = (
                    f"{name} contains the gyroscope only, its accelerations are zero; select both topics: "
                    f"--samples {name},{other.name}"
                )
                return no_samples(name, error), ()
    if imu.has_accelerometer and not imu.has_gyroscope:
        for other in others:
            if _read(found, other).has_gyroscope:
                error = (
                    f"{name} contains the accelerometer only, its angular velocities are zero; select both "
                    f"topics: --samples {other.name},{name}"
                )
                return no_samples(name, error), ()
    if others and imu.whole:
        notes += (f"not used: {', '.join(topic.name for topic in others)}",)
    return Samples(imu.gyroscope, imu.accelerometer, name), (*notes, *imu.notes)


def _joined(gyroscope: _ImuTopic, accelerometer: _ImuTopic, path: Path) -> tuple[Samples, Notes]:
    names = f"{gyroscope.topic.name} and {accelerometer.topic.name}"
    note = (
        f"{path.name}: gyroscope from {gyroscope.topic.name}, accelerometer from {accelerometer.topic.name}: "
        "each has zeros for the other sensor"
    )
    return Samples(gyroscope.gyroscope, accelerometer.accelerometer, names), (
        note,
        *gyroscope.notes,
        *accelerometer.notes,
    )


def _read(found: Survey, topic: Topic) -> _ImuTopic:
    stamps, logged, values = found.imus[topic].columns()
    notes: Notes = ()
    if stamps.size and not stamps.any():
        stamps = logged
        notes += (f"{topic.name}: the samples have no stamps; recording times are used",)
    streams = []
    for half in (values[:, :3], values[:, 3:]):
        stream = np.empty(stamps.size, dtype=INERTIAL_DTYPE)
        stream["t_ns"], stream["xyz"] = stamps, half
        streams.append(stream)
    notes += _rate_notes(stamps, logged, topic.name)
    return _ImuTopic(
        topic, _has_values(values[:, :3]), _has_values(values[:, 3:]), streams[0], streams[1], notes
    )


def _has_values(values: FloatArray) -> bool:
    """True if any value is finite and not zero."""
    return bool((np.isfinite(values) & (values != 0.0)).any())


def _rate_notes(stamps: np.ndarray, logged: np.ndarray, name: str) -> Notes:
    """A note if stamps and recording times advance at different rates, as with a driver that doubles them."""
    if stamps.size < 2 or logged[-1] - logged[0] < 1_000_000_000:
        return ()
    pace = float(stamps[-1] - stamps[0]) / float(logged[-1] - logged[0])
    if 0.98 < pace < 1.02:
        return ()
    return (
        f"{name}: stamps advance {pace:.3f} times as fast as the recording times; the clock of the driver "
        "is wrong",
    )
