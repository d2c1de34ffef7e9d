"""Recordings of ROS 1 and ROS 2: what of a bag is taken, and how it was told."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import CalibrationError, RecordingError
from asyneio.io.bag import Bag, Topic
from asyneio.io.calibration import find_rig
from asyneio.io.calibration.lens import make_lens
from asyneio.io.contents import Contents, ReadOptions, Samples, no_samples, split_samples
from asyneio.io.event_packets import ENCODINGS, TRIGGER, unwrap_first_times
from asyneio.io.event_source import SAMPLE_DTYPE
from asyneio.io.ros_events import RosEvents
from asyneio.io.ros_schema import Located
from asyneio.io.ros_survey import EventTopic, Survey, survey
from asyneio.io.rosbag1 import Rosbag1
from asyneio.io.rosbag2 import open_rosbag2
from asyneio.io.sensor_clock import SensorClock, fit_clock
from asyneio.io.stamps import drop_equal_stamps, sort_in_time
from asyneio.types import CameraIntrinsics, Distortion, PoseTrajectory

_MAX_LISTED = 20
_DISTORTIONS = {
    "plumb_bob": Distortion.RADTAN, "radtan": Distortion.RADTAN,
    "equidistant": Distortion.EQUIDISTANT, "fisheye": Distortion.EQUIDISTANT,
    "rational_polynomial": Distortion.RADTAN, "": Distortion.NONE, "none": Distortion.NONE,
}  # fmt: skip
#: Steps of an event's time, where it is one number: ns, us, ms, s.
_UNITS_NS = (1, 1000, 1_000_000, 1_000_000_000)
_POSE_DTYPE = np.dtype([("t_ns", "<i8"), ("p", "<f8", (3,)), ("q", "<f8", (4,))])


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
    samples, sample_notes = _samples(found, options.samples, bag.path)
    truth, truth_notes = _truth(found)
    size = known.size if min(known.size) > 0 else None
    lens, lens_notes = _lens(found, topic, size)
    if found.broken:
        notes += (f"{bag.path.name}: {found.broken} message(s) are damaged",)
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
    if wanted is not None:
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
        raise RecordingError(
            f"{topic.name} has packets encoded as {', '.join(map(repr, known.encodings)) or 'nothing'}; "
            f"expected one of {', '.join(ENCODINGS)}"
        )
    if known.big_endian:
        raise RecordingError(
            f"{topic.name} was recorded by a big-endian machine; only little-endian packets are understood"
        )


def _clock(known: EventTopic, topic: Topic) -> tuple[int, SensorClock]:
    """What a step of the events' time is [ns], and the clock that maps it to the host's."""
    host_ns = np.array(known.host_ns, dtype=np.int64)
    if known.decoder is None:
        sensor_ns = np.array(known.sensor_ns, dtype=np.int64)
        if "evt3" in known.encodings:
            sensor_ns = unwrap_first_times(sensor_ns, host_ns)
        return 1, fit_clock(sensor_ns, host_ns, topic.name)
    if not known.sensor_ns:
        return 1, SensorClock()
    steps = np.array(known.sensor_ns, dtype=np.int64)
    lengths = int(host_ns[-1] - host_ns[0]), int(steps[-1] - steps[0])
    ratio = lengths[0] / lengths[1] if min(lengths) > 0 else host_ns[0] / max(int(steps[0]), 1)
    unit_ns = min(_UNITS_NS, key=lambda unit: abs(np.log(max(ratio, 1e-9) / unit)))
    return unit_ns, fit_clock(steps * unit_ns, host_ns, topic.name)


def _samples(found: Survey, wanted: str | None, path: Path) -> tuple[Samples, tuple[str, ...]]:
    topic = _choose(found, list(found.imus), wanted, "samples", path)
    if topic is None:
        return no_samples(path.name), ()
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


def _truth(found: Survey) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """The poses of the only topic that has them."""
    topics = [topic for topic in found.poses if found.counts[topic]]
    if len(topics) != 1:
        text = f"several topics of poses, none taken as truth: {_listed(found, topics)}"
        return None, (text,) if topics else ()
    stamps, _, values = found.poses[topics[0]].columns()
    rows = np.empty(stamps.size, dtype=_POSE_DTYPE)
    rows["t_ns"], rows["p"], rows["q"] = stamps, values[:, :3], values[:, 3:]
    norm = np.linalg.norm(rows["q"], axis=1)
    good = (np.abs(norm - 1.0) < 1e-2) & np.isfinite(rows["p"]).all(axis=1)
    name = topics[0].name
    if not good.any():
        return None, (f"{name}: no pose is usable as truth",)
    dropped = f"{name}: dropped {good.size - good.sum()} pose(s) that are none"
    rows, sorted_note = sort_in_time(rows[good], name)
    rows, repeated_note = drop_equal_stamps(rows, name)
    quaternion = rows["q"] / np.linalg.norm(rows["q"], axis=1, keepdims=True)
    truth = PoseTrajectory(rows["t_ns"].copy(), rows["p"].copy(), quaternion)
    notes = (f"the poses of {name} were taken as truth",) + (() if good.all() else (dropped,))
    return truth, notes + sorted_note + repeated_note


def _lens(
    found: Survey, events: Topic, size: tuple[int, int] | None
) -> tuple[CameraIntrinsics | None, tuple[str, ...]]:
    """The lens of the only CameraInfo of this size, or of that in the namespace of the events."""
    lenses: dict[Topic, CameraIntrinsics] = {}
    notes: list[str] = []
    for topic, (located, data) in found.cameras.items():
        try:
            lens = _parse_lens(located, data, topic.name)
        except (CalibrationError, ValueError) as error:
            notes.append(f"{topic.name} was not taken for the lens: {error}")
            continue
        if lens is not None and size in (None, (lens.width, lens.height)):
            lenses[topic] = lens
    space = events.name.rsplit("/", 1)[0]
    near = [topic for topic in lenses if topic.name.rsplit("/", 1)[0] == space]
    chosen = near if len(near) == 1 else list(lenses)
    if len({lenses[topic] for topic in chosen}) == 1:
        text = f"lens of {chosen[0].name}, unless a file tells another; extrinsics and IMU noise need a file"
        return lenses[chosen[0]], (*notes, text)
    if chosen:
        notes.append(f"several lenses, none taken: {_listed(found, chosen)}; give one with --calibration")
    return None, tuple(notes)


def _parse_lens(located: Located, data: bytes, name: str) -> CameraIntrinsics | None:
    """The lens of a CameraInfo; None where it says that the camera is not calibrated."""
    upper = "K" in located.places
    k, d = (located.values(data, key if upper else key.lower()) for key in ("K", "D"))
    if not k[0]:
        return None
    model = located.text(data, "distortion_model").strip()
    distortion = _DISTORTIONS.get(model)
    if distortion is None or (model == "rational_polynomial" and d[5:].any()):
        raise CalibrationError(f"the distortion model {model[:30]!r} is not understood")
    # A plumb_bob always has a third radial coefficient.
    radtan = d[:5] if d[4:5].any() else d[:4]
    coefficients = (radtan if distortion is Distortion.RADTAN else d).tolist()
    if not any(coefficients):
        distortion, coefficients = Distortion.NONE, []
    size = tuple(int(located.number(data, side)) for side in ("width", "height"))
    return make_lens((k[0], k[4], k[2], k[5]), size, distortion, coefficients, Path(name))
