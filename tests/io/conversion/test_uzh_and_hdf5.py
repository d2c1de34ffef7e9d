"""Conversion to UZH folders, zipped ones and HDF5, which store everything."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from asyneio.io import open_recording
from asyneio.io.conversion.convert import Source, convert, from_zero
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, EventRecording
from tests.io.conversion.sources import BY_NAME, SUFFIXES, assert_events, ignore, read
from tests.io.event_recordings import assert_same


@pytest.mark.parametrize("name", SUFFIXES)
def test_round_trip(tmp_path: Path, recording: EventRecording, name: str, small_pieces: None) -> None:
    path = tmp_path / f"out{SUFFIXES[name]}"
    done: list[int] = []
    convert(Source(recording), BY_NAME[name], path, done.append)
    assert done[-1] == recording.events.size
    assert_same(read(path), recording)
    assert BY_NAME[name].lost(recording) == ()


@pytest.mark.parametrize("name", SUFFIXES)
def test_from_zero(tmp_path: Path, recording: EventRecording, name: str) -> None:
    """All clocks are shifted by the same amount, whole microseconds."""
    path, shift_ns = tmp_path / f"out{SUFFIXES[name]}", from_zero(recording)
    convert(Source(recording, shift_ns), BY_NAME[name], path, ignore)
    found = read(path)
    np.testing.assert_array_equal(found.events["t_ns"], recording.events["t_ns"] + shift_ns)
    np.testing.assert_array_equal(found.gyroscope["t_ns"], recording.gyroscope["t_ns"] + shift_ns)
    assert found.ground_truth is not None
    assert recording.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.t_ns, recording.ground_truth.t_ns + shift_ns)
    assert 0 <= min(found.events["t_ns"][0], found.gyroscope["t_ns"][0]) < 1000


@pytest.mark.parametrize("name", ["IMU_rotDisk", "IMU_translBoxes"])
def test_real_davis240(data_dir: Path, tmp_path: Path, name: str) -> None:
    """Real events with their IMU to text and HDF5: bit for bit the same."""
    real = read(data_dir / "davis240_imu" / f"{name}.aedat")
    for kind in ("hdf5", "uzh"):
        path = tmp_path / f"{name}{SUFFIXES[kind]}"
        convert(Source(real), BY_NAME[kind], path, ignore)
        found = read(path)
        assert_events(found.events, real.events)
        for sensor in ("gyroscope", "accelerometer"):
            np.testing.assert_array_equal(getattr(found, sensor), getattr(real, sensor))


@pytest.mark.parametrize("name", ["gen3.evt2.raw", "dvxplorer_static.aedat4"])
def test_real_formats(data_dir: Path, tmp_path: Path, name: str) -> None:
    real = read(data_dir / "formats" / name)
    convert(Source(real), BY_NAME["hdf5"], tmp_path / "x.h5", ignore)
    found = read(tmp_path / "x.h5")
    assert_events(found.events, real.events)
    assert (found.width, found.height) == (real.width, real.height)


@pytest.mark.slow
@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
def test_any_events(tmp_path: Path, data: st.DataObject) -> None:
    """Any times, columns, rows and polarities are written and read back unchanged."""
    steps = data.draw(st.lists(st.integers(0, 40_000_000_000), min_size=1, max_size=30))
    events = np.zeros(len(steps), dtype=EVENT_DTYPE)
    events["t_ns"] = np.cumsum(steps)
    for name, end in (("x", 240), ("y", 180), ("p", 2)):
        values = st.lists(st.integers(0, end - 1), min_size=len(steps), max_size=len(steps))
        events[name] = data.draw(values, label=name)
    events["x"][0], events["y"][0] = 239, 179
    empty = np.empty(0, INERTIAL_DTYPE)
    recording = EventRecording("any", events, 240, 180, empty, empty)
    name = data.draw(st.sampled_from(sorted(SUFFIXES)))
    path = tmp_path / f"x{SUFFIXES[name]}"
    convert(Source(recording), BY_NAME[name], path, ignore, force=True)
    assert_events(read(path).events, events)


@pytest.mark.slow
def test_from_the_cache(tmp_path: Path, recording: EventRecording) -> None:
    """The events of large recordings are a read-only memory map."""
    convert(Source(recording), BY_NAME["hdf5"], tmp_path / "source.h5", ignore)
    cached = open_recording(tmp_path / "source.h5", cache_from=0)
    assert isinstance(cached, EventRecording)
    assert isinstance(cached.events, np.memmap)
    for target in BY_NAME.values():
        path = tmp_path / f"x{target.name}{''.join(target.suffixes[:1])}"
        convert(Source(cached), target, path, ignore)
        assert_events(read(path).events, recording.events)


def test_memory_is_bounded(tmp_path: Path) -> None:
    """Two million events in a file, like those of a large recording, are written piece by piece."""
    events = np.lib.format.open_memmap(tmp_path / "events.npy", "w+", EVENT_DTYPE, (2_000_000,))
    events["t_ns"] = np.arange(events.size) * 1000
    empty = np.empty(0, INERTIAL_DTYPE)
    recording = EventRecording("large", events, 240, 180, empty, empty)
    for name in ("hdf5", "uzh"):
        target, path = BY_NAME[name], tmp_path / f"x{SUFFIXES[name]}"
        convert(Source(replace(recording, events=events[:1000])), target, path, ignore)
        tracemalloc.start()
        convert(Source(recording), target, path, ignore, force=True)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 24 * 2**20, name
