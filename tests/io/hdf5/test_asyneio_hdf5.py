"""Our HDF5 layout: round trips, every hostile construction refused, damage harmless."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording, write_events_hdf5
from asyneio.io.hdf5 import columns as hdf5_columns
from asyneio.types import EventRecording
from tests.io.event_recordings import assert_same, make_event_recording


@pytest.fixture
def recording(rng: np.random.Generator) -> EventRecording:
    return make_event_recording(rng)


@pytest.fixture
def path(tmp_path: Path, recording: EventRecording) -> Path:
    write_events_hdf5(recording, tmp_path / "run.h5")
    return tmp_path / "run.h5"


def test_round_trip(path: Path, recording: EventRecording) -> None:
    found = open_recording(path)
    assert_same(found, recording)
    assert found.name == "synthetic"
    assert [entry.name for entry in path.parent.iterdir()] == ["run.h5"]


def test_cached(path: Path, recording: EventRecording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hdf5_columns, "BLOCK_EVENTS", 999)
    for _ in range(2):
        found = open_recording(path, cache_from=0)
        assert_same(found, recording)
        assert isinstance(found.events, np.memmap)


def test_only_events(tmp_path: Path, recording: EventRecording) -> None:
    empty = recording.gyroscope[:0]
    bare = replace(
        recording, gyroscope=empty, accelerometer=empty, camera=None, calibration=None, ground_truth=None
    )
    write_events_hdf5(bare, tmp_path / "run")
    assert_same(open_recording(tmp_path / "run"), bare)
    with_lens = replace(bare, camera=recording.camera)
    write_events_hdf5(with_lens, tmp_path / "run")
    assert_same(open_recording(tmp_path / "run"), with_lens)


def test_sensors_with_times_of_their_own(tmp_path: Path, recording: EventRecording) -> None:
    odd = replace(recording, gyroscope=recording.gyroscope[::2])
    write_events_hdf5(odd, tmp_path / "run")
    assert_same(open_recording(tmp_path / "run"), odd)


def test_stream_of_pieces(tmp_path: Path, recording: EventRecording) -> None:
    pieces = (piece for piece in np.array_split(recording.events, 7))
    write_events_hdf5(replace(recording, events=recording.events[:0]), tmp_path / "run", pieces)
    assert_same(open_recording(tmp_path / "run"), recording)


def test_failure_of_the_stream_leaves_nothing(tmp_path: Path, recording: EventRecording) -> None:
    def pieces() -> object:
        yield recording.events[:10]
        raise RecordingError("no more")

    with pytest.raises(RecordingError, match="no more"):
        write_events_hdf5(recording, tmp_path / "run", pieces())  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_polarity_of_another_kind(path: Path, recording: EventRecording) -> None:
    with h5py.File(path, "r+") as file:
        p = file["events/p"][:].astype(np.int8) * 2 - 1
        del file["events/p"]
        file["events/p"] = p
    assert_same(open_recording(path), recording)
    with h5py.File(path, "r+") as file:
        file["events/p"][0] = 0
    with pytest.raises(RecordingError, match="polarity values from -1 to 1"):
        open_recording(path)


def external_link(file: h5py.File, other: Path) -> None:
    del file["events/x"]
    file["events/x"] = h5py.ExternalLink(str(other), "/x")


def soft_link(file: h5py.File, other: Path) -> None:
    del file["events/x"]
    file["events/x"] = h5py.SoftLink("/events/y")


def linked_group(file: h5py.File, other: Path) -> None:
    file.move("events", "moved")
    file["events"] = h5py.ExternalLink(str(other), "/")


def external_storage(file: h5py.File, other: Path) -> None:
    size = file["events/x"].shape[0]
    del file["events/x"]
    file["events"].create_dataset("x", (size,), "<u2", external=[(str(other), 0, 2 * size)])


def virtual(file: h5py.File, other: Path) -> None:
    size = file["events/x"].shape[0]
    del file["events/x"]
    layout = h5py.VirtualLayout((size,), "<u2")
    layout[:] = h5py.VirtualSource(str(other), "x", (size,))
    file["events"].create_virtual_dataset("x", layout)


def objects(file: h5py.File, other: Path) -> None:
    size = file["events/x"].shape[0]
    del file["events/x"]
    file["events"].create_dataset("x", (size,), h5py.vlen_dtype(np.dtype("<u2")))


def bomb(file: h5py.File, other: Path) -> None:
    for name in ("t", "x", "y", "p"):
        attributes = dict(file[f"events/{name}"].attrs)
        del file[f"events/{name}"]
        made = file["events"].create_dataset(name, (10**15,), "<i8", chunks=(2**16,), compression="gzip")
        made.attrs.update(attributes)


def huge_chunks(file: h5py.File, other: Path) -> None:
    del file["events/x"]
    file["events"].create_dataset("x", (10,), "<u2", chunks=(2**30,), maxshape=(None,))


def object_attribute(file: h5py.File, other: Path) -> None:
    file.attrs.create("format", file.ref, dtype=h5py.ref_dtype)


def other_unit(file: h5py.File, other: Path) -> None:
    file["events/t"].attrs["unit"] = "us"


def other_layout(file: h5py.File, other: Path) -> None:
    file.attrs["version"] = 2


def short_column(file: h5py.File, other: Path) -> None:
    file["events/y"].resize((7,))


def floats(file: h5py.File, other: Path) -> None:
    t = file["events/t"][:]
    del file["events/t"]
    file["events/t"] = t * 1e-9


@pytest.mark.parametrize(
    "change",
    [external_link, soft_link, linked_group, external_storage, virtual, objects, bomb, huge_chunks,
     object_attribute, other_unit, other_layout, short_column, floats],
)  # fmt: skip
def test_refused(path: Path, change: Callable[[h5py.File, Path], None]) -> None:
    other = path.with_name("other.h5")
    with h5py.File(other, "w") as file:
        file["x"] = np.zeros(5000, dtype="<u2")
    with h5py.File(path, "r+") as file:
        change(file, other)
    with pytest.raises(RecordingError):
        open_recording(path)


def test_events_of_no_declared_format_are_read(path: Path, recording: EventRecording) -> None:
    with h5py.File(path, "r+") as file:
        del file.attrs["format"]
    found = open_recording(path)
    assert isinstance(found, EventRecording)
    np.testing.assert_array_equal(found.events["t_ns"], recording.events["t_ns"])
    assert any("nanoseconds" in note for note in found.notes)


@pytest.mark.parametrize("name", ["gyroscope", "ground_truth"])
def test_links_beside_the_events_are_refused(path: Path, name: str) -> None:
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = h5py.ExternalLink("other.h5", "/")
    with pytest.raises(RecordingError, match="link"):
        open_recording(path)


def test_damage(path: Path, rng: np.random.Generator) -> None:
    data = path.read_bytes()
    for share in (0.0, 0.01, 0.3, 0.9):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(RecordingError):
            open_recording(path)
