"""Inertial samples of a bag: from one topic, or from two that hold a sensor each."""

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
    """Samples of a topic: which halves of its messages are more than zeros, the streams, what was assumed."""

    topic: Topic
    turns: bool
    feels: bool
    gyroscope: RecordArray
    accelerometer: RecordArray
    notes: Notes

    @property
    def whole(self) -> bool:
        return self.turns and self.feels


def samples_of_bag(found: Survey, options: ReadOptions, path: Path) -> tuple[Samples, Notes]:
    """The samples of a topic, or of two that complement each other; where the bag has none those of a file.

    Cameras of RealSense and others have a topic of `sensor_msgs/Imu` for each sensor, zeros for the other.

    Raises:
        RecordingError: the user names a topic or file that is not there.
    """
    wanted = options.samples
    filled = [topic for topic in found.imus if found.counts[topic]]
    if (wanted is not None and Path(wanted).is_file()) or not filled:
        return find_samples(path.parent, options), ()
    if wanted is None:
        topics = filled
    else:
        names = [name.strip() for name in wanted.split(",")]
        topics = [
            topic
            for name in names
            if (topic := choose_topic(found, filled, name, "samples", path)) is not None
        ]
    imus = [_read(found, topic) for topic in topics]
    whole = [imu for imu in imus if imu.whole]
    halves = [imu for imu in imus if imu.turns != imu.feels]
    if len(imus) == 1 or len(whole) == 1:
        return _one(imus[0] if len(imus) == 1 else whole[0], found, filled, path)
    turning, feeling = ([imu for imu in halves if getattr(imu, half)] for half in ("turns", "feels"))
    if not whole and len(turning) == len(feeling) == 1:
        return _joined(turning[0], feeling[0], path)
    trouble = (
        f"{path} has {len(topics)} topics of samples: {listed_topics(found, topics)}; choose one with "
        "--samples "
        "TOPIC, or two that hold a sensor each with --samples TOPIC,TOPIC"
    )
    return no_samples(path.name, trouble), ()


def _one(imu: _ImuTopic, found: Survey, filled: list[Topic], path: Path) -> tuple[Samples, Notes]:
    name = imu.topic.name
    said: Notes = (f"{path.name}: inertial samples from {name}",)
    others = [topic for topic in filled if topic is not imu.topic]
    if imu.turns and not imu.feels:
        for other in others:
            if _read(found, other).feels:
                trouble = (
                    f"{name} holds the gyroscope alone, its accelerations are zero; give both topics: "
                    f"--samples {name},{other.name}"
                )
                return no_samples(name, trouble), ()
    if imu.feels and not imu.turns:
        for other in others:
            if _read(found, other).turns:
                trouble = (
                    f"{name} holds the accelerometer alone, its angular velocities are zero; give both "
                    "topics: "
                    f"--samples {other.name},{name}"
                )
                return no_samples(name, trouble), ()
    if others and imu.whole:
        said += (f"not used: {', '.join(topic.name for topic in others)}",)
    return Samples(imu.gyroscope, imu.accelerometer, name), (*said, *imu.notes)


def _joined(turning: _ImuTopic, feeling: _ImuTopic, path: Path) -> tuple[Samples, Notes]:
    names = f"{turning.topic.name} and {feeling.topic.name}"
    said = (
        f"{path.name}: gyroscope from {turning.topic.name}, accelerometer from {feeling.topic.name}: "
        "each has "
        "zeros for the other"
    )
    return Samples(turning.gyroscope, feeling.accelerometer, names), (said, *turning.notes, *feeling.notes)


def _read(found: Survey, topic: Topic) -> _ImuTopic:
    stamps, logged, values = found.imus[topic].columns()
    notes: Notes = ()
    if stamps.size and not stamps.any():
        stamps = logged
        notes += (f"{topic.name}: the samples have no stamps; the times of recording were taken",)
    streams = []
    for half in (values[:, :3], values[:, 3:]):
        stream = np.empty(stamps.size, dtype=INERTIAL_DTYPE)
        stream["t_ns"], stream["xyz"] = stamps, half
        streams.append(stream)
    notes += _rate_notes(stamps, logged, topic.name)
    return _ImuTopic(topic, _holds(values[:, :3]), _holds(values[:, 3:]), streams[0], streams[1], notes)


def _holds(values: FloatArray) -> bool:
    """True where readings are more than zeros and gaps."""
    return bool((np.isfinite(values) & (values != 0.0)).any())


def _rate_notes(stamps: np.ndarray, logged: np.ndarray, name: str) -> Notes:
    """A sentence where stamps go by at another pace than recording did: a driver is known to double it."""
    if stamps.size < 2 or logged[-1] - logged[0] < 1_000_000_000:
        return ()
    pace = float(stamps[-1] - stamps[0]) / float(logged[-1] - logged[0])
    if 0.98 < pace < 1.02:
        return ()
    return (
        f"{name}: stamps go by {pace:.3f} times as fast as the recording did; the driver's clock is wrong",
    )
