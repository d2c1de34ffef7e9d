"""Recordings as ROS 1 bags, with the topics of the UZH event camera data set.

| topic | type |
|---|---|
| `/dvs/events` | dvs_msgs/EventArray: camera clock |
| `/dvs/imu` | sensor_msgs/Imu: IMU clock, no orientation |
| `/optitrack/davis` | geometry_msgs/PoseStamped: the true poses, IMU clock |
| `/dvs/camera_info` | sensor_msgs/CameraInfo, once a second |

Extrinsics, time shift and IMU noise have no message; they go into Kalibr's files beside the bag.
"""

from __future__ import annotations

import heapq
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer, WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from asyneio.errors import RecordingError
from asyneio.io.atomic import atomic_path
from asyneio.io.event_source import Progress
from asyneio.types import NS_PER_S, CameraIntrinsics, Distortion, EventRecording, RecordArray

EVENTS_TOPIC, IMU_TOPIC, TRUTH_TOPIC, LENS_TOPIC = (
    "/dvs/events", "/dvs/imu", "/optitrack/davis", "/dvs/camera_info",
)  # fmt: skip
EVENT_MSG = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
EVENT_ARRAY_MSG = "Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"

#: A message holds at most so many events, of at most so long.
_MESSAGE_EVENTS, _MESSAGE_NS = 2**16, NS_PER_S // 100
_PACKED = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("polarity", "u1")])
_TYPES = {
    EVENTS_TOPIC: "dvs_msgs/msg/EventArray",
    IMU_TOPIC: "sensor_msgs/msg/Imu",
    TRUTH_TOPIC: "geometry_msgs/msg/PoseStamped",
    LENS_TOPIC: "sensor_msgs/msg/CameraInfo",
}
#: When a message was recorded [ns], its topic, its bytes.
_Record = tuple[int, str, bytes]


def write_rosbag(recording: EventRecording, path: Path, progress: Progress | None = None) -> None:
    """Write a recording as a bag, whole or not at all; events are read in pieces.

    Args:
        recording: what to write.
        path: the bag; one that is there is replaced.
        progress: is told the fraction of the events written.

    Raises:
        RecordingError: the bag cannot be written, gyroscope and accelerometer have different times, or a time
            does not fit ROS (before 1970 or after 2106).
    """
    if not np.array_equal(recording.gyroscope["t_ns"], recording.accelerometer["t_ns"]):
        raise RecordingError(
            "a message of the IMU holds both sensors at one time, but their times differ; write HDF5 instead"
        )
    _check_times(recording)
    records = heapq.merge(
        _event_records(recording, progress),
        _imu_records(recording),
        _truth_records(recording),
        _lens_records(recording),
        key=lambda record: record[0],
    )
    typestore = dvs_typestore()
    try:
        with atomic_path(path) as temporary:
            temporary.unlink()
            with Writer(temporary) as writer:
                connections = {
                    topic: writer.add_connection(topic, kind, typestore=typestore)
                    for topic, kind in _TYPES.items()
                }
                for logged_ns, topic, data in records:
                    # Time 0 is no time in ROS.
                    writer.write(connections[topic], max(logged_ns, 1), data)
    except WriterError as error:
        raise RecordingError(f"cannot write {path}: {error}") from error


def dvs_typestore() -> Typestore:
    """The types of ROS 1 with those of dvs_msgs."""
    typestore = get_typestore(Stores.ROS1_NOETIC)
    typestore.register(get_types_from_msg(EVENT_MSG, "dvs_msgs/msg/Event"))
    typestore.register(get_types_from_msg(EVENT_ARRAY_MSG, "dvs_msgs/msg/EventArray"))
    return typestore


def _check_times(recording: EventRecording) -> None:
    truth = recording.ground_truth
    series = [recording.events["t_ns"][[0, -1]] if recording.events.size else np.empty(0, np.int64)]
    series += [recording.gyroscope["t_ns"], truth.t_ns if truth else np.empty(0, np.int64)]
    for t_ns in series:
        if t_ns.size and not (t_ns.min() >= 0 and t_ns.max() < 2**32 * NS_PER_S):
            raise RecordingError(
                f"times of {recording.name} go from {t_ns.min() / NS_PER_S:.3f} to "
                f"{t_ns.max() / NS_PER_S:.3f} s; a bag holds 0 to {2**32} s"
            )


def _event_records(recording: EventRecording, progress: Progress | None) -> Iterator[_Record]:
    events, start, number = recording.events, 0, 0
    while start < events.size:
        piece = events[start : start + _MESSAGE_EVENTS]
        stop = int(np.searchsorted(piece["t_ns"], int(piece["t_ns"][0]) + _MESSAGE_NS))
        piece = piece[: max(stop, 1)]
        last_ns = int(piece["t_ns"][-1])
        size = struct.pack("<III", recording.height, recording.width, piece.size)
        yield last_ns, EVENTS_TOPIC, _header(number, last_ns, "dvs") + size + _packed(piece)
        start, number = start + piece.size, number + 1
        if progress is not None:
            progress(start / events.size)


def _packed(events: RecordArray) -> bytes:
    packed = np.empty(events.size, dtype=_PACKED)
    packed["x"], packed["y"], packed["polarity"] = events["x"], events["y"], events["p"]
    packed["sec"], packed["nsec"] = np.divmod(events["t_ns"], NS_PER_S)
    return packed.tobytes()


def _imu_records(recording: EventRecording) -> Iterator[_Record]:
    unknown = (-1.0, *(0.0,) * 8)
    rows = zip(
        recording.gyroscope["t_ns"].tolist(),
        recording.gyroscope["xyz"].tolist(),
        recording.accelerometer["xyz"].tolist(),
        strict=True,
    )
    for number, (t_ns, rate, force) in enumerate(rows):
        # A covariance that begins with -1 says that there is no orientation.
        values = (0.0, 0.0, 0.0, 1.0, *unknown, *rate, *(0.0,) * 9, *force, *(0.0,) * 9)
        yield t_ns, IMU_TOPIC, _header(number, t_ns, "dvs") + struct.pack("<37d", *values)


def _truth_records(recording: EventRecording) -> Iterator[_Record]:
    truth = recording.ground_truth
    if truth is None:
        return
    values = np.hstack([truth.position, truth.quaternion]).tolist()
    for number, (t_ns, row) in enumerate(zip(truth.t_ns.tolist(), values, strict=True)):
        yield t_ns, TRUTH_TOPIC, _header(number, t_ns, "world") + struct.pack("<7d", *row)


def _lens_records(recording: EventRecording) -> Iterator[_Record]:
    if recording.camera is None or not recording.events.size:
        return
    first_ns, last_ns = recording.events["t_ns"][[0, -1]].tolist()
    content = _lens(recording.camera)
    for number, t_ns in enumerate(range(first_ns, last_ns + 1, NS_PER_S)):
        yield t_ns, LENS_TOPIC, _header(number, t_ns, "dvs") + content


def _lens(camera: CameraIntrinsics) -> bytes:
    equidistant = camera.distortion is Distortion.EQUIDISTANT
    model = b"equidistant" if equidistant else b"plumb_bob"
    d = (*camera.coefficients, *(0.0,) * 5)[: 4 if equidistant else 5]
    k = (camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
    r = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    p = (*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0)
    size = struct.pack("<II", camera.height, camera.width)
    numbers = struct.pack(f"<I{len(d)}d9d9d12d", len(d), *d, *k, *r, *p)
    # No binning, and no region: the whole image.
    return size + struct.pack("<I", len(model)) + model + numbers + bytes(4 + 4 + 4 * 4 + 1)


def _header(number: int, t_ns: int, frame: str) -> bytes:
    name = frame.encode()
    return struct.pack(f"<IIII{len(name)}s", number, *divmod(t_ns, NS_PER_S), len(name), name)
