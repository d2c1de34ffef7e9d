# SPDX-License-Identifier: Apache-2.0
"""Recordings of ROS 2: a folder with an MCAP file; topics: see `written_messages`."""

from __future__ import annotations

import struct
import tempfile
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores

from asyneio.errors import RecordingError
from asyneio.io.ros.rosbag2 import METADATA_FILE
from asyneio.io.ros.written_messages import TYPES, records_of, typestore
from asyneio.progress import ProgressCallback
from asyneio.types import NS_PER_S, EventRecording, RecordArray

#: Sixteen bytes from the row of an event to the column of the next one: CDR has padding after the polarity.
_ROW = np.dtype(
    {
        "names": ["y", "sec", "nsec", "polarity", "next_x"],
        "formats": ["<u2", "<i4", "<u4", "u1", "<u2"],
        "offsets": [0, 4, 8, 12, 14],
        "itemsize": 16,
    }
)


class _Cdr:
    """An Encoding that aligns numbers to multiples of their size, counted from the end of the first four
    bytes."""

    def header(self, number: int, t_ns: int, frame: bytes) -> bytes:
        """The start of CDR and a std_msgs/Header: time [ns] and frame."""
        return struct.pack("<BBBBiII4s", 0, 1, 0, 0, *divmod(t_ns, NS_PER_S), len(frame) + 1, frame)

    def events(self, events: RecordArray) -> bytes:
        """A sequence of dvs_msgs/Event of 16 bytes each, from EVENT_DTYPE (N,)."""
        rows = np.zeros(events.size, dtype=_ROW)
        rows["y"], rows["polarity"] = events["y"], events["p"]
        rows["sec"], rows["nsec"] = np.divmod(events["t_ns"], NS_PER_S)
        rows["next_x"][:-1] = events["x"][1:]
        # The first event has no padding before it: its column and row are where others have the row.
        first = struct.pack("<IHH", events.size, events["x"][0], events["y"][0])
        return first + rows.tobytes()[4:-3]

    def intrinsics(self, model: bytes, d: tuple[float, ...], others: tuple[float, ...]) -> bytes:
        """The part of CameraInfo from the model on: distortion `d`, then the matrices K, R and P, aligned."""
        # A header and the size take 24 bytes.
        name = struct.pack("<I", len(model) + 1) + model + b"\0"
        name += bytes(-len(name) % 4)
        count = struct.pack("<I", len(d))
        gap = bytes(-(24 + len(name) + len(count)) % 8)
        return name + count + gap + struct.pack(f"<{len(d) + len(others)}d", *d, *others)


def files_of(folder: Path) -> tuple[Path, Path]:
    """The files of a recording in a folder."""
    return folder / f"{folder.name}.mcap", folder / METADATA_FILE


def write_rosbag2(recording: EventRecording, folder: Path, progress: ProgressCallback | None = None) -> None:
    """Write a recording as a ROS 2 folder, complete or not at all; events are read in pieces.

    Args:
        recording: what to write.
        folder: output; an earlier recording in it is replaced.
        progress: called with the fraction of the events written.

    Raises:
        RecordingError: the folder contains other files or cannot be written, gyroscope and accelerometer have
            different times, or a time does not fit ROS 2 (before 1970 or after 2038).
    """
    earlier = list(folder.iterdir()) if folder.is_dir() else [folder] if folder.exists() else []
    if not {*earlier} <= {*files_of(folder)}:
        raise RecordingError(
            f"{folder} contains files that are not part of a recording; choose another folder"
        )
    records = records_of(recording, _Cdr(), 2**31, progress)
    store = typestore(Stores.ROS2_HUMBLE, "builtin_interfaces/Time")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as temporary:
            # The file is named after the folder.
            path = Path(temporary) / folder.name
            with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
                add = writer.add_connection
                connections = {name: add(name, kind, typestore=store) for name, kind in TYPES.items()}
                for logged_ns, topic, data in records:
                    writer.write(connections[topic], logged_ns, data)
            for file in earlier:
                file.unlink()
            # An empty folder is replaced.
            path.rename(folder)
    except (WriterError, OSError) as error:
        raise RecordingError(
            f"cannot write {folder}: {error}; check the folder's permissions and free space"
        ) from error
