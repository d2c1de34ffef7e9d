# SPDX-License-Identifier: Apache-2.0
"""Recordings as ROS 1 bags; topics: see `written_messages`."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer, WriterError
from rosbags.typesys import Stores

from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import atomic_path
from asyneio.io.ros.written_messages import TYPES, records_of, typestore
from asyneio.progress import ProgressCallback
from asyneio.types import NS_PER_S, EventRecording, RecordArray

_PACKED = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("polarity", "u1")])


class _Ros1:
    """An Encoding without padding."""

    def header(self, number: int, t_ns: int, frame: bytes) -> bytes:
        """A std_msgs/Header: number, time [ns], frame."""
        return struct.pack("<IIII3s", number, *divmod(t_ns, NS_PER_S), len(frame), frame)

    def events(self, events: RecordArray) -> bytes:
        """A sequence of dvs_msgs/Event of 13 bytes each, from EVENT_DTYPE (N,)."""
        packed = np.empty(events.size, dtype=_PACKED)
        packed["x"], packed["y"], packed["polarity"] = events["x"], events["y"], events["p"]
        packed["sec"], packed["nsec"] = np.divmod(events["t_ns"], NS_PER_S)
        return struct.pack("<I", events.size) + packed.tobytes()

    def intrinsics(self, model: bytes, d: tuple[float, ...], others: tuple[float, ...]) -> bytes:
        """The part of CameraInfo from the model on: distortion `d`, then the matrices K, R and P."""
        numbers = struct.pack(f"<I{len(d)}d{len(others)}d", len(d), *d, *others)
        return struct.pack("<I", len(model)) + model + numbers


def write_rosbag(recording: EventRecording, path: Path, progress: ProgressCallback | None = None) -> None:
    """Write a recording as a bag, complete or not at all; events are read in pieces.

    Args:
        recording: what to write.
        path: the bag; replaced if it exists.
        progress: called with the fraction of the events written.

    Raises:
        RecordingError: the bag cannot be written, gyroscope and accelerometer have different times, or a time
            does not fit ROS (before 1970 or after 2106).
    """
    records = records_of(recording, _Ros1(), 2**32, progress)
    store = typestore(Stores.ROS1_NOETIC, "time")
    try:
        with atomic_path(path) as temporary:
            temporary.unlink()
            with Writer(temporary) as writer:
                add = writer.add_connection
                connections = {name: add(name, kind, typestore=store) for name, kind in TYPES.items()}
                for logged_ns, topic, data in records:
                    # Time 0 is invalid in ROS.
                    writer.write(connections[topic], max(logged_ns, 1), data)
    except WriterError as error:
        raise RecordingError(f"cannot write {path}: {error}") from error
