# SPDX-License-Identifier: Apache-2.0
"""The formats of event recordings: how each is recognised by its content, and its reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from asyneio.io.aedat.aedat2 import MAGIC as AEDAT2_MAGIC
from asyneio.io.aedat.aedat2 import read_aedat2
from asyneio.io.aedat.aedat4 import MAGIC as AEDAT4_MAGIC
from asyneio.io.aedat.aedat4 import read_aedat4
from asyneio.io.event_numpy import MAGIC as NUMPY_MAGIC
from asyneio.io.event_numpy import is_npz, read_numpy
from asyneio.io.event_stream import MAGIC as EVENT_STREAM_MAGIC
from asyneio.io.event_stream import read_event_stream
from asyneio.io.hdf5.asyneio_reader import MAGIC as HDF5_MAGIC
from asyneio.io.hdf5.asyneio_reader import is_asyneio_hdf5, read_events_hdf5
from asyneio.io.hdf5.dsec import is_event_columns, is_stereo_folder, read_event_columns, read_stereo_folder
from asyneio.io.hdf5.event_table import is_event_table, read_event_table
from asyneio.io.hdf5.m3ed import is_m3ed, read_m3ed
from asyneio.io.hdf5.mvsec import is_mvsec, read_mvsec
from asyneio.io.hdf5.prophesee import is_prophesee_hdf5, read_prophesee_hdf5
from asyneio.io.parsing.gzip_file import MAGIC as GZIP_MAGIC
from asyneio.io.parsing.gzip_file import unpacked_head
from asyneio.io.parsing.zip_member import MAGIC as ZIP_MAGIC
from asyneio.io.prophesee.header import MAGIC as PROPHESEE_MAGIC
from asyneio.io.prophesee.reader import read_prophesee
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.ros.mcap import MAGIC as MCAP_MAGIC
from asyneio.io.ros.reader import read_bag_parts, read_rosbag1, read_rosbag2
from asyneio.io.ros.rosbag1 import MAGIC as ROSBAG_MAGIC
from asyneio.io.ros.rosbag2 import is_packed_rosbag2, is_rosbag2_folder, is_rosbag2_sqlite
from asyneio.io.ros.split_bags import parts_in
from asyneio.io.text.layout import HEAD_BYTES, is_event_text
from asyneio.io.uzh.folder_reader import EVENTS_FILE, read_gzip_text, read_uzh_folder
from asyneio.io.uzh.zip_reader import read_uzh_zip


@dataclass(frozen=True)
class Format:
    """A format of recordings.

    `matches(path, head)`: whether a file that begins with the bytes `head`, or a folder (`head` is empty),
    has this format. `read`: finds its contents without decoding them. `chooses`: the options by which the
    user selects among several streams.
    """

    name: str
    title: str
    matches: Callable[[Path, bytes], bool]
    read: Callable[[Path, ReadOptions], Contents]
    chooses: tuple[str, ...] = ()


def _hdf5(
    name: str,
    title: str,
    matches: Callable[[Path], bool],
    read: Callable[[Path, ReadOptions], Contents],
    *chooses: str,
) -> Format:
    """A format of HDF5 files."""
    return Format(
        name, title, lambda path, head: head.startswith(HDF5_MAGIC) and matches(path), read, chooses
    )


_TOPICS = ("events", "samples")

#: Tried in this order; the first match reads the recording.
FORMATS = (
    Format(
        "uzh",
        "a UZH folder (events.txt)",
        lambda path, _: path.is_dir() and (path / EVENTS_FILE).is_file(),
        read_uzh_folder,
    ),
    _hdf5("hdf5", "asyneio's HDF5", is_asyneio_hdf5, read_events_hdf5),
    Format(
        "stereo",
        "a folder of DSEC, VECtor or TUM-VIE",
        lambda path, _: is_stereo_folder(path),
        read_stereo_folder,
        ("events", "samples"),
    ),
    _hdf5("mvsec", "MVSEC's HDF5", is_mvsec, read_mvsec, "events"),
    _hdf5("m3ed", "M3ED's HDF5", is_m3ed, read_m3ed, "events"),
    _hdf5("prophesee-hdf5", "Prophesee's HDF5", is_prophesee_hdf5, read_prophesee_hdf5, "samples"),
    _hdf5(
        "columns",
        "HDF5 like DSEC or E2VID (events/x, y, t, p)",
        is_event_columns,
        read_event_columns,
        "samples",
    ),
    _hdf5("table", "HDF5 like v2e (events, four columns)", is_event_table, read_event_table, "samples"),
    Format(
        "prophesee",
        "Prophesee RAW (EVT 2.0, 2.1, 3.0) or DAT",
        lambda _, head: head.startswith(PROPHESEE_MAGIC),
        read_prophesee,
        ("samples",),
    ),
    Format("aedat2", "AEDAT-2.0 of a DAVIS240", lambda _, head: head.startswith(AEDAT2_MAGIC), read_aedat2),
    Format("aedat4", "AEDAT4", lambda _, head: head.startswith(AEDAT4_MAGIC), read_aedat4),
    Format(
        "numpy",
        "NumPy .npy or .npz with columns of events",
        lambda path, head: (
            head.startswith(NUMPY_MAGIC) or (head.startswith(ZIP_MAGIC) and path.is_file() and is_npz(path))
        ),
        read_numpy,
        ("samples",),
    ),
    Format(
        "zip", "a zipped UZH folder", lambda _, head: head.startswith(ZIP_MAGIC), read_uzh_zip, ("events",)
    ),
    Format("rosbag1", "a ROS 1 bag", lambda _, head: head.startswith(ROSBAG_MAGIC), read_rosbag1, _TOPICS),
    Format("rosbag2", "a ROS 2 bag (folder)", lambda path, _: is_rosbag2_folder(path), read_rosbag2, _TOPICS),
    Format(
        "bag-parts",
        "a split ROS bag (NAME_0.bag, NAME_1.bag)",
        lambda path, _: bool(parts_in(path)),
        read_bag_parts,
        _TOPICS,
    ),
    Format(
        "packed-bag", "MCAP or SQLite of ROS 2, compressed (zstd)", is_packed_rosbag2, read_rosbag2, _TOPICS
    ),
    Format("mcap", "MCAP", lambda _, head: head.startswith(MCAP_MAGIC), read_rosbag2, _TOPICS),
    Format("sqlite", "SQLite of ROS 2", lambda _, head: is_rosbag2_sqlite(head), read_rosbag2, _TOPICS),
    Format(
        "event-stream",
        "Event Stream (.es)",
        lambda _, head: head.startswith(EVENT_STREAM_MAGIC),
        read_event_stream,
        ("samples",),
    ),
    Format(
        "text",
        "event text (t[s] x y p, or CSV of a camera)",
        lambda _, head: is_event_text(head),
        read_uzh_folder,
    ),
    Format(
        "gzip-text",
        "event text, compressed with gzip",
        lambda _, head: head.startswith(GZIP_MAGIC) and is_event_text(unpacked_head(head, HEAD_BYTES)),
        read_gzip_text,
    ),
)


def format_of(path: Path, head: bytes) -> Format | None:
    """The format of a file that begins with `head`, or of a folder (`head` empty); None if unknown."""
    return next((format for format in FORMATS if format.matches(path, head)), None)
