"""DSEC, and the codecs that its files use."""

from __future__ import annotations

from pathlib import Path

import h5py
import hdf5plugin
import numpy as np
import pytest

from asyneio.errors import RecordingError
from tests.io.hdf5.layouts import EPOCH_US, assert_events, read, whole_us, write_columns


def test_dsec(tmp_path: Path, rng: np.random.Generator) -> None:
    left, right = whole_us(rng, scale=2), whole_us(rng, scale=2)
    root = tmp_path / "interlaken_00_c"
    write_columns(root / "events" / "left" / "events.h5", left, EPOCH_US)
    write_columns(root / "events" / "right" / "events.h5", right, EPOCH_US)
    with h5py.File(root / "events" / "left" / "rectify_map.h5", "w") as file:
        file["rectify_map"] = np.zeros((4, 4, 2))
    for path, wanted, options in (
        (root, left, {}),
        (root, right, {"events": "right"}),
        (root / "events" / "right" / "events.h5", right, {}),
    ):
        found = read(path, **options)
        assert_events(found, wanted, EPOCH_US * 1000)
        assert (found.name, found.width, found.height) == ("interlaken_00_c", 640, 480)
        assert found.gyroscope.size == 0
        notes = " ".join(found.notes)
        assert "no inertial samples" in notes
        assert f"t_offset of {EPOCH_US} us" in notes
    assert any("read from the left camera" in note for note in read(root).notes)
    with pytest.raises(RecordingError, match="no events of a camera 'top'; available: left and right"):
        read(root, events="top")


def test_blosc(tmp_path: Path, rng: np.random.Generator) -> None:
    """As DSEC publishes its files; the codecs come with the extra `h5`."""
    events = whole_us(rng)
    for codec in (hdf5plugin.Blosc(cname="zstd"), hdf5plugin.Zstd()):
        write_columns(tmp_path / "x.h5", events, 0, **codec)
        assert_events(read(tmp_path / "x.h5"), events)


def test_missing_codec_names_the_extra(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_columns(tmp_path / "x.h5", whole_us(rng), 0, **hdf5plugin.Blosc())
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda number: number < 32000)
    with pytest.raises(RecordingError, match=r"compressed with Blosc.*pip install 'asyneio\[h5\]'"):
        read(tmp_path / "x.h5")
