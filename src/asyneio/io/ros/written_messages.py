# SPDX-License-Identifier: Apache-2.0
"""A recording as messages sorted by time, with the topics of the UZH event camera data set.

| topic | type |
|---|---|
| `/dvs/events` | dvs_msgs/EventArray: camera clock |
| `/dvs/imu` | sensor_msgs/Imu: IMU clock, no orientation |
| `/optitrack/davis` | geometry_msgs/PoseStamped: ground truth, IMU clock |
| `/dvs/camera_info` | sensor_msgs/CameraInfo, once per second |

No message contains extrinsics, time shift and IMU noise; they are stored in Kalibr's files next to the bag.
"""

from __future__ import annotations

import heapq
import struct
from collections.abc import Iterator
from typing import Protocol

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from asyneio.errors import RecordingError
from asyneio.progress import ProgressCallback
from asyneio.types import NS_PER_S, CameraIntrinsics, Distortion, EventRecording, RecordArray

EVENTS_TOPIC, IMU_TOPIC, GROUND_TRUTH_TOPIC, CAMERA_INFO_TOPIC = (
    "/dvs/events", "/dvs/imu", "/optitrack/davis", "/dvs/camera_info",
)  # fmt: skip
TYPES = {
    EVENTS_TOPIC: "dvs_msgs/msg/EventArray",
    IMU_TOPIC: "sensor_msgs/msg/Imu",
    GROUND_TRUTH_TOPIC: "geometry_msgs/msg/PoseStamped",
    CAMERA_INFO_TOPIC: "sensor_msgs/msg/CameraInfo",
}

#: Upper bounds on the number of events in a message, and on its duration.
_MESSAGE_EVENTS, _MESSAGE_NS = 2**16, NS_PER_S // 100
#: Frame names have three letters, so that a header ends at an aligned position in CDR.
_SENSOR, _WORLD = b"dvs", b"map"

#: Recording time of a message [ns], topic, bytes.
Record = tuple[int, str, bytes]


class Encoding(Protocol):
    """Serialization of messages."""

    def header(self, number: int, t_ns: int, frame: bytes) -> bytes:
        """A header with everything before it; `frame` has three letters."""

    def events(self, events: RecordArray) -> bytes:
        """The number of events (EVENT_DTYPE) and the events, after a header and two 32-bit numbers."""

    def intrinsics(self, model: bytes, d: tuple[float, ...], others: tuple[float, ...]) -> bytes:
        """Distortion model, coefficients and matrices, after a header and two 32-bit numbers."""


def typestore(store: Stores, time: str) -> Typestore:
    """The types of a ROS version and of dvs_msgs; `time` is the type of event times."""
    found = get_typestore(store)
    event = f"uint16 x\nuint16 y\n{time} ts\nbool polarity\n"
    array = "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"
    found.register(get_types_from_msg(event, "dvs_msgs/msg/Event"))
    found.register(get_types_from_msg(array, "dvs_msgs/msg/EventArray"))
    return found


def records_of(
    recording: EventRecording, encoding: Encoding, last_s: int, progress: ProgressCallback | None
) -> Iterator[Record]:
    """All messages of a recording, sorted by time; events are read in pieces.

    Args:
        recording: what to write.
        encoding: of the messages.
        last_s: end of the range of stamps [s].
        progress: called with the fraction of the events processed.

    Raises:
        RecordingError: gyroscope and accelerometer have different times, or a time does not fit.
    """
    if not np.array_equal(recording.gyroscope["t_ns"], recording.accelerometer["t_ns"]):
        raise RecordingError(
            "an IMU message stores both sensors at the same time, but their times differ; write HDF5 instead"
        )
    _check_times(recording, last_s)
    return heapq.merge(
        _events(recording, encoding, progress),
        _samples(recording, encoding),
        _truth(recording, encoding),
        _camera_info(recording, encoding),
        key=lambda record: record[0],
    )


def _check_times(recording: EventRecording, last_s: int) -> None:
    truth = recording.ground_truth
    series = [recording.events["t_ns"][[0, -1]] if recording.events.size else np.empty(0, np.int64)]
    series += [recording.gyroscope["t_ns"], truth.t_ns if truth else np.empty(0, np.int64)]
    for t_ns in series:
        if t_ns.size and not (t_ns.min() >= 0 and t_ns.max() < last_s * NS_PER_S):
            raise RecordingError(
                f"times of {recording.name} go from {t_ns.min() / NS_PER_S:.3f} to "
                f"{t_ns.max() / NS_PER_S:.3f} s; a bag stores 0 to {last_s} s"
            )


def _events(
    recording: EventRecording, encoding: Encoding, progress: ProgressCallback | None
) -> Iterator[Record]:
    events, start, number = recording.events, 0, 0
    size = struct.pack("<II", recording.height, recording.width)
    while start < events.size:
        piece = events[start : start + _MESSAGE_EVENTS]
        stop = int(np.searchsorted(piece["t_ns"], int(piece["t_ns"][0]) + _MESSAGE_NS))
        piece = piece[: max(stop, 1)]
        last_ns = int(piece["t_ns"][-1])
        yield last_ns, EVENTS_TOPIC, encoding.header(number, last_ns, _SENSOR) + size + encoding.events(piece)
        start, number = start + piece.size, number + 1
        if progress is not None:
            progress(start / events.size)


def _samples(recording: EventRecording, encoding: Encoding) -> Iterator[Record]:
    unknown = (-1.0, *(0.0,) * 8)
    rows = zip(
        recording.gyroscope["t_ns"].tolist(),
        recording.gyroscope["xyz"].tolist(),
        recording.accelerometer["xyz"].tolist(),
        strict=True,
    )
    for number, (t_ns, rate, force) in enumerate(rows):
        # A covariance that begins with -1 means that there is no orientation.
        values = (0.0, 0.0, 0.0, 1.0, *unknown, *rate, *(0.0,) * 9, *force, *(0.0,) * 9)
        yield t_ns, IMU_TOPIC, encoding.header(number, t_ns, _SENSOR) + struct.pack("<37d", *values)


def _truth(recording: EventRecording, encoding: Encoding) -> Iterator[Record]:
    truth = recording.ground_truth
    if truth is None:
        return
    values = np.hstack([truth.position, truth.quaternion]).tolist()
    for number, (t_ns, row) in enumerate(zip(truth.t_ns.tolist(), values, strict=True)):
        yield t_ns, GROUND_TRUTH_TOPIC, encoding.header(number, t_ns, _WORLD) + struct.pack("<7d", *row)


def _camera_info(recording: EventRecording, encoding: Encoding) -> Iterator[Record]:
    camera = recording.camera
    if camera is None or not recording.events.size:
        return
    first_ns, last_ns = recording.events["t_ns"][[0, -1]].tolist()
    content = struct.pack("<II", camera.height, camera.width) + _camera_info_body(camera, encoding)
    for number, t_ns in enumerate(range(first_ns, last_ns + 1, NS_PER_S)):
        yield t_ns, CAMERA_INFO_TOPIC, encoding.header(number, t_ns, _SENSOR) + content


def _camera_info_body(camera: CameraIntrinsics, encoding: Encoding) -> bytes:
    equidistant = camera.distortion is Distortion.EQUIDISTANT
    # ROS has another name for radtan with OpenCV's additional coefficients.
    count = 4 if equidistant else max(5, len(camera.coefficients))
    model = b"equidistant" if equidistant else b"plumb_bob" if count == 5 else b"rational_polynomial"
    d = (*camera.coefficients, *(0.0,) * 5)[:count]
    k = (camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
    r = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    p = (*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0)
    body = encoding.intrinsics(model, d, (*k, *r, *p))
    # No binning and no region of interest: the whole image.
    return body + bytes(4 + 4 + 4 * 4 + 1)
