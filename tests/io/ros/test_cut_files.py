"""Bags that are cut off, damaged or incomplete: everything before the damage is read."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from asyneio.types import EventRecording
from tests.io.ros.bags import Record, write_bag


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ros", "packing", "storage"),
    [(1, "", ""), (1, "lz4", ""), (1, "bz2", ""), (2, "", "mcap"), (2, "storage", "mcap")],
)
def test_cut_off(
    tmp_path: Path,
    recording: EventRecording,
    records: list[Record],
    ros: int,
    packing: str,
    storage: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Wherever a recording was cut off, what stands before is read, and how much is said."""
    monkeypatch.setattr(Writer, "__init__", small_chunks(Writer.__init__))
    path = write_bag(tmp_path / "run", ros, records, packing, storage)
    path = path if ros == 1 else path / "run.mcap"
    data = path.read_bytes()
    sizes = []
    # A block of zstd is 128 KiB unpacked: almost half of this bag.
    for share in (0.6, 0.9, 0.999) if packing == "storage" else (0.3, 0.5, 0.7, 0.9, 0.999):
        cut = tmp_path / "cut"
        cut.write_bytes(data[: int(share * len(data))])
        found = open_recording(cut)
        sizes.append(found.events.size)
        np.testing.assert_array_equal(found.events, recording.events[: sizes[-1]])
        if share < 0.9:
            assert any("truncated at byte" in note for note in found.notes)
    assert sizes == sorted(sizes)
    assert 0 < sizes[0] < sizes[-1] == 3000


@pytest.mark.parametrize("packing", ["", "lz4", "bz2"])
def test_damaged_in_the_middle(
    tmp_path: Path,
    recording: EventRecording,
    records: list[Record],
    packing: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A chunk is spoilt; those before and after it are read."""
    monkeypatch.setattr(Writer, "__init__", small_chunks(Writer.__init__))
    path = write_bag(tmp_path / "run.bag", 1, records, packing)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    # Where nothing is packed, the length of a message's header is what tells.
    at = middle if packing else data.index(b"op=\2", data.index(b"op=\2", middle) + 4) - 8
    data[at : at + 8] = b"\xff" * 8
    path.write_bytes(data)
    found = open_recording(path)
    assert 2500 + 250 < found.events.size + found.gyroscope.size < 3000 + recording.gyroscope.size
    assert found.events["t_ns"][-1] == recording.events["t_ns"][-1]
    assert any("damaged record(s), the first at byte" in note for note in found.notes)


def small_chunks(make: Callable[..., None]) -> Callable[..., None]:
    def init(self: Writer, path: Path) -> None:
        make(self, path)
        self.chunk_threshold = 5000

    return init


def test_cut_off_in_a_database(tmp_path: Path, records: list[Record]) -> None:
    """SQLite itself refuses a file that is shorter than it should be."""
    path = write_bag(tmp_path / "run", 2, records, storage="sqlite3") / "run.db3"
    data = path.read_bytes()
    cut = tmp_path / "cut.db3"
    cut.write_bytes(data[: len(data) * 2 // 3])
    with pytest.raises(RecordingError, match=r"malformed; if it is truncated, try sqlite3 cut.db3 .recover"):
        open_recording(cut)


def test_split(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    """A recording in two files, as its metadata says."""
    half = len(records) // 2
    first = write_bag(tmp_path / "run", 2, records[:half])
    second = write_bag(tmp_path / "second", 2, records[half:])
    (second / "second.mcap").rename(first / "second.mcap")
    text = (first / "metadata.yaml").read_text()
    (first / "metadata.yaml").write_text(text.replace("- run.mcap\n", "- run.mcap\n  - ../second.mcap\n", 1))
    found = open_recording(first)
    np.testing.assert_array_equal(found.events, recording.events)
    (first / "second.mcap").unlink()
    with pytest.raises(RecordingError, match=r"lists second.mcap, which does not exist"):
        open_recording(first)


def test_database_without_definitions(
    tmp_path: Path, recording: EventRecording, records: list[Record]
) -> None:
    """Before Iron a bag did not hold them; types known by name are read."""
    path = write_bag(tmp_path / "run", 2, records, storage="sqlite3")
    database = sqlite3.connect(path / "run.db3")
    with database:
        database.execute("DROP TABLE message_definitions")
    database.close()
    np.testing.assert_array_equal(open_recording(path).events, recording.events)


def test_no_message_can_be_decoded(tmp_path: Path, records: list[Record]) -> None:
    """The definition in the bag promises more than the messages hold."""
    path = write_bag(tmp_path / "run.bag", 1, records)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"uint16 x\n", b"uint64 x\n"))
    with pytest.raises(RecordingError, match=r"none of 6 message.* can be decoded: .*declares"):
        open_recording(path)
