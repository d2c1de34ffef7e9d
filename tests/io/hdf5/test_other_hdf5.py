"""HDF5 of v2e, E2VID and MATLAB."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from tests.io.event_columns import SIZE, T0_US, assert_events, read


def write_v2e(file: h5py.File, events: np.ndarray) -> None:
    rows = np.stack([events[:, 0], events[:, 1], events[:, 2], 2 * events[:, 3] - 1], 1)
    file.create_dataset("events", data=rows.astype("<u4"), compression="gzip")


def write_e2vid(file: h5py.File, events: np.ndarray) -> None:
    group = file.create_group("events")
    group["ts"], group["ps"] = events[:, 0] / 1e6, events[:, 3].astype(bool)
    group["xs"], group["ys"] = events[:, 1].astype("i2"), events[:, 2].astype("i2")
    file.attrs["sensor_resolution"] = (180, 240)


def write_matlab(file: h5py.File, events: np.ndarray) -> None:
    for name, values in zip("txyp", events.T, strict=True):
        file[f"events/{name}"] = values.astype(">f8")


@pytest.mark.parametrize("write", [write_v2e, write_e2vid, write_matlab])
def test_hdf5_of_others(
    tmp_path: Path, events: np.ndarray, write: Callable[[h5py.File, np.ndarray], None]
) -> None:
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        write(file, events)
    found = read(tmp_path)
    assert_events(found.events, events)
    assert (found.width, found.height) == SIZE
    assert "rec.h5" in " ".join(found.notes)


def test_hdf5_in_nanoseconds_of_the_epoch(tmp_path: Path, events: np.ndarray) -> None:
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        for name, values in zip("txyp", events.T, strict=True):
            file[f"events/{name}"] = values if name != "t" else (values + T0_US) * 1000
    found = read(tmp_path)
    assert_events(found.events, events, T0_US)
    assert "nanoseconds (stamps since 1970)" in " ".join(found.notes)


def test_unknown_hdf5_is_listed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        file["depth/images"] = np.zeros((2, 3))
    with pytest.raises(RecordingError, match=r"contains depth/images \(2, 3\) float64; expected events/x, y"):
        open_recording(tmp_path / "rec.h5")
