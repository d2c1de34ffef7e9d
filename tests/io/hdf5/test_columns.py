"""Columns of unknown origin: size and unit are detected; hostile files are rejected."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import ReadOptions, write_camchain, write_imu_noise
from asyneio.io.hdf5 import columns as hdf5_columns
from asyneio.io.open_recording import open_contents
from asyneio.types import EVENT_DTYPE, NS_PER_S
from tests.io.event_recordings import make_events
from tests.io.hdf5.layouts import (
    GRAVITY,
    assert_events,
    read,
    whole_us,
    write_columns,
    write_lines,
    write_mvsec,
)
from tests.io.recordings import make_calibration


def test_unknown_origin(tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """The size is guessed from a look at some events, not from decoding all of them again and again."""
    events = whole_us(rng)
    events["x"] += 100
    decoded = []
    real = hdf5_columns.ColumnEvents.chunks
    monkeypatch.setattr(hdf5_columns.ColumnEvents, "chunks", lambda self: decoded.append(1) or real(self))  # type: ignore[func-returns-value]
    for group in ("events", "/"):
        write_columns(tmp_path / "mine.h5", events, 77, group)
        found = read(tmp_path / "mine.h5")
        assert_events(found, events, 77_000)
        assert (found.width, found.height) == (346, 260)
        notes = " ".join(found.notes)
        assert "columns t x y p, time in microseconds (like DSEC)" in notes
        assert "assumed from the events: 346 x 260" in notes
    assert len(decoded) == 2


def test_samples_beside_unknown_origin(tmp_path: Path, rng: np.random.Generator) -> None:
    write_columns(tmp_path / "mine.h5", whole_us(rng))
    rows = [(5_000_000 * k, 0.1, 0.2, 0.3, *GRAVITY) for k in range(400)]
    write_lines(tmp_path / "imu0" / "data.csv", "", [(",".join(map(str, row)),) for row in rows])
    found = read(tmp_path / "mine.h5")
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    assert any("gyroscope first (from gravity), time in ns" in note for note in found.notes)
    other = [(0.005 * k, *GRAVITY, 0.4, 0.5, 0.6) for k in range(400)]
    write_lines(tmp_path / "other.txt", "", other)
    for name in (str(tmp_path / "other.txt"), "other.txt"):
        named = read(tmp_path / "mine.h5", samples=name)
        np.testing.assert_array_equal(named.gyroscope["xyz"][0], [0.4, 0.5, 0.6])
    with pytest.raises(RecordingError, match=r"inertial samples nothing\.txt not found"):
        read(tmp_path / "mine.h5", samples="nothing.txt")


def test_memory_is_bounded(tmp_path: Path) -> None:
    """Three million events, 48 MB decoded: a few blocks of them are in memory at a time."""
    events = np.zeros(3_000_000, dtype=EVENT_DTYPE)
    events["t_ns"] = np.arange(events.size) * 1000
    write_columns(tmp_path / "x.h5", events, 5)
    source = open_contents(tmp_path / "x.h5", ReadOptions()).decode()
    tracemalloc.start()
    count = sum(piece.size for piece, _ in source.chunks())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == events.size
    assert peak < 16 * 2**20


def test_no_events(tmp_path: Path, rng: np.random.Generator) -> None:
    for name in ("t", "x", "y", "p"):
        with h5py.File(tmp_path / "x.h5", "a") as file:
            file[f"events/{name}"] = np.zeros(0, dtype="<u4")
    write_mvsec(tmp_path / "y.hdf5", make_events(rng, 10)[:0])
    for path in ("x.h5", "y.hdf5"):
        with pytest.raises(RecordingError, match="contains no events"):
            read(tmp_path / path)


def test_blocks_do_not_matter(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hdf5_columns, "BLOCK_EVENTS", 333)
    events = whole_us(rng)
    write_columns(tmp_path / "x.h5", events, 5)
    assert_events(read(tmp_path / "x.h5"), events, 5000)
    stamped = make_events(rng, 1000)
    write_mvsec(tmp_path / "y.hdf5", stamped)
    assert np.abs(read(tmp_path / "y.hdf5").events["t_ns"] - stamped["t_ns"]).max() <= 120


def external_link(file: h5py.File) -> None:
    del file["events/x"]
    file["events/x"] = h5py.ExternalLink("other.h5", "/x")


def soft_link_of_the_group(file: h5py.File) -> None:
    file.move("events", "moved")
    file["events"] = h5py.SoftLink("/moved")


def linked_offset(file: h5py.File) -> None:
    del file["t_offset"]
    file["t_offset"] = h5py.ExternalLink("other.h5", "/x")


def huge_offset(file: h5py.File) -> None:
    del file["t_offset"]
    file["t_offset"] = np.uint64(2**63)


def offset_of_text(file: h5py.File) -> None:
    del file["t_offset"]
    file["t_offset"] = "now"


def short(file: h5py.File) -> None:
    del file["events/y"]
    file["events/y"] = np.zeros(7, dtype="<u2")


def absurd_stamps(file: h5py.File) -> None:
    count = file["events/t"].shape[0]
    del file["events/t"]
    file["events/t"] = np.full(count, 2**64 - 1, dtype="<u8")


def bomb(file: h5py.File) -> None:
    for name in ("t", "x", "y", "p"):
        del file[f"events/{name}"]
        file.create_dataset(f"events/{name}", (10**14,), "<u4", chunks=(2**16,), compression="gzip")


@pytest.mark.parametrize(
    "change",
    [external_link, soft_link_of_the_group, linked_offset, huge_offset, offset_of_text, short,
     absurd_stamps, bomb],
)  # fmt: skip
def test_refused(tmp_path: Path, rng: np.random.Generator, change: Callable[[h5py.File], None]) -> None:
    path = tmp_path / "x.h5"
    write_columns(path, whole_us(rng), 0)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(3000, dtype="<u2")
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(RecordingError):
        read(path)


def test_calibration_beside(tmp_path: Path, rng: np.random.Generator) -> None:
    """A lens found beside events of unknown origin gives the size as well."""
    calibration = make_calibration()
    write_camchain(tmp_path / "camchain-imucam.yaml", calibration)
    write_imu_noise(tmp_path / "imu.yaml", calibration.noise)
    write_columns(tmp_path / "mine.h5", whole_us(rng))
    found = read(tmp_path / "mine.h5")
    assert found.calibration is not None
    assert (found.width, found.height) == (240, 180)
    assert found.events["t_ns"][-1] < 3 * NS_PER_S
