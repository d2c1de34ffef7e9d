"""HDF5 written by Metavision."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from asyneio.errors import RecordingError
from tests.io.hdf5.layouts import assert_events, read, whole_us


def test_table_of_prophesee(tmp_path: Path, rng: np.random.Generator) -> None:
    events = whole_us(rng, scale=4)
    table = np.empty(events.size, dtype=[("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    table["x"], table["y"], table["p"], table["t"] = (
        events["x"],
        events["y"],
        events["p"],
        events["t_ns"] // 1000,
    )
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        file.create_dataset("CD/events", data=table, chunks=(512,))
        file.attrs["geometry"] = "1280x720"
    found = read(tmp_path / "x.hdf5")
    assert_events(found, events)
    assert (found.width, found.height) == (1280, 720)


def test_codec_of_prophesee_is_named(tmp_path: Path) -> None:
    """A data set compressed by a filter that is nowhere installed."""
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        table = np.zeros(10, dtype=[("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
        space = h5py.h5s.create_simple((10,), (h5py.h5s.UNLIMITED,))
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((10,))
        properties.set_filter(36559, h5py.h5z.FLAG_OPTIONAL, ())
        file.create_group("CD")
        kind = h5py.h5t.py_create(table.dtype, logical=True)
        h5py.h5d.create(file["CD"].id, b"events", kind, space, properties)
    with pytest.raises(RecordingError, match="Prophesee's ECF codec, which is not installed"):
        read(tmp_path / "x.hdf5")
