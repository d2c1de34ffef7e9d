"""UZH folders: real ones, round trips, the cache, and the contradictions that are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import AsyneioError, CalibrationError, RecordingError
from asyneio.io import ReadOptions, open_recording, write_uzh_folder
from asyneio.io.recording import cache as event_cache
from asyneio.types import EVENT_DTYPE, NS_PER_S, CameraIntrinsics, Distortion, EventRecording
from tests.io.event_recordings import assert_same, make_event_recording, make_events


@pytest.fixture
def recording(rng: np.random.Generator) -> EventRecording:
    return make_event_recording(rng)


@pytest.mark.parametrize("name", ["shapes_rotation", "dynamic_translation", "boxes_translation"])
def test_real_excerpts(data_dir: Path, name: str) -> None:
    found = open_recording(data_dir / "ecd_excerpts" / name)
    table = np.loadtxt(data_dir / "ecd_excerpts" / name / "events.txt")
    assert found.events.size == 30_000
    # Relative times of these files are short enough for a float to hold their nanoseconds.
    np.testing.assert_array_equal(found.events["t_ns"], np.rint(table[:, 0] * 1e9))
    np.testing.assert_array_equal(found.events["x"], table[:, 1])
    np.testing.assert_array_equal(found.events["y"], table[:, 2])
    np.testing.assert_array_equal(found.events["p"], table[:, 3])
    assert (found.width, found.height) == (240, 180)
    assert found.camera is not None
    assert (found.camera.fx, found.camera.distortion) == (199.092366542, Distortion.RADTAN)
    assert found.calibration is None
    assert found.gyroscope.size == found.accelerometer.size == 0
    assert any("240 x 180" in note for note in found.notes)


def test_real_slider(data_dir: Path) -> None:
    found = open_recording(data_dir / "slider_depth")
    assert found.events.size == 50_000
    assert found.ground_truth is not None
    assert found.ground_truth.t_ns.size == 339


def test_round_trip(tmp_path: Path, recording: EventRecording) -> None:
    write_uzh_folder(recording, tmp_path)
    assert_same(open_recording(tmp_path), recording)
    first = (tmp_path / "events.txt").read_text().split("\n", 1)[0]
    event = recording.events[0]
    assert (
        first
        == f"{event['t_ns'] / 10**9:.0f}.{event['t_ns'] % 10**9:09d} {event['x']} {event['y']} {event['p']}"
    )
    assert (tmp_path / "groundtruth.txt").read_text()[0].isdigit()


def test_round_trip_without_calibration(tmp_path: Path, recording: EventRecording) -> None:
    write_uzh_folder(recording, tmp_path)
    lens = CameraIntrinsics(
        300.0, 301.0, 320.0, 200.0, 600, 400, Distortion.EQUIDISTANT, (0.1, 0.2, 0.3, 0.4)
    )
    bare = replace(recording, camera=lens, width=600, height=400, calibration=None, ground_truth=None)
    write_uzh_folder(bare, tmp_path)
    assert_same(open_recording(tmp_path), bare)
    assert not (tmp_path / "calib.txt").exists()


def test_times_before_zero_and_far_apart(tmp_path: Path, recording: EventRecording) -> None:
    events = np.zeros(4, dtype=EVENT_DTYPE)
    events["t_ns"] = [-(10**10) - 1, -1, 0, 10**10]
    events["x"] = [0, 9, 10, 239]
    empty = recording.gyroscope[:0]
    short = replace(recording, events=events, gyroscope=empty, accelerometer=empty)
    write_uzh_folder(short, tmp_path)
    assert (tmp_path / "events.txt").read_text().startswith("-10.000000001 0 0 0\n-0.000000001 9 0 0\n0.")
    assert_same(open_recording(tmp_path), short)


def test_stream_of_pieces(tmp_path: Path, recording: EventRecording) -> None:
    pieces = (piece for piece in np.array_split(recording.events, 7))
    write_uzh_folder(replace(recording, events=recording.events[:0]), tmp_path, pieces)
    assert_same(open_recording(tmp_path), recording)


def test_cache(tmp_path: Path, recording: EventRecording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASYNEIO_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "run"
    disordered = recording.events.copy()
    later = int(np.flatnonzero(np.diff(disordered["t_ns"]) > 0)[10])
    disordered[[later, later + 1]] = disordered[[later + 1, later]]
    write_uzh_folder(replace(recording, events=disordered), folder)
    done: list[float] = []
    first = open_recording(folder, progress=done.append, cache_from=0)
    assert_same(first, recording)
    assert isinstance(first.events, np.memmap)
    assert not first.events.flags.writeable
    assert first.events.dtype == EVENT_DTYPE
    assert done == sorted(done)
    assert done[-1] == 1.0
    again = open_recording(folder, progress=done.clear, cache_from=0)  # type: ignore[arg-type]
    assert_same(again, recording)
    assert again.notes == first.notes
    assert done, "a cached conversion was made again"
    # Another content is another conversion, and the old one goes.
    write_uzh_folder(replace(recording, events=recording.events[:100]), folder)
    assert open_recording(folder, cache_from=0).events.size == 100
    assert len(list((tmp_path / "cache").glob("*.json"))) == 1


def test_damaged_cache_is_made_again(
    tmp_path: Path, recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ASYNEIO_CACHE", str(tmp_path / "cache"))
    write_uzh_folder(recording, tmp_path / "run")
    open_recording(tmp_path / "run", cache_from=0)
    for pattern, content in (("*.events.npy", b"\x93NUMPY"), ("*.json", b"{"), ("*.samples.npy", b"")):
        next((tmp_path / "cache").glob(pattern)).write_bytes(content)
        assert_same(open_recording(tmp_path / "run", cache_from=0), recording)


def test_cache_that_cannot_be_written(
    tmp_path: Path, recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ASYNEIO_CACHE", str(tmp_path / "file"))
    write_uzh_folder(recording, tmp_path / "run")
    found = open_recording(tmp_path / "run", cache_from=0)
    assert_same(found, recording)
    assert "is not cached" in found.notes[-1]


def test_cache_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ASYNEIO_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert event_cache.cache_folder() == Path("/somewhere/asyneio")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert event_cache.cache_folder() == Path.home() / ".cache" / "asyneio"


def test_exchanged_sensors(tmp_path: Path, recording: EventRecording) -> None:
    swapped = replace(recording, gyroscope=recording.accelerometer, accelerometer=recording.gyroscope)
    write_uzh_folder(swapped, tmp_path)
    found = open_recording(tmp_path)
    np.testing.assert_array_equal(found.accelerometer, recording.accelerometer)
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    assert any("gyroscope first (from gravity)" in note for note in found.notes)


def test_no_gravity(tmp_path: Path, recording: EventRecording) -> None:
    still = recording.accelerometer.copy()
    still["xyz"] *= 0.01
    write_uzh_folder(replace(recording, accelerometer=still), tmp_path)
    with pytest.raises(RecordingError, match="gravity"):
        open_recording(tmp_path)


def test_clocks_apart(tmp_path: Path, recording: EventRecording) -> None:
    moved = recording.events.copy()
    moved["t_ns"] -= 100 * NS_PER_S
    write_uzh_folder(replace(recording, events=moved), tmp_path)
    with pytest.raises(RecordingError, match=r"do not overlap.*100\.\d+ s apart"):
        open_recording(tmp_path)


def test_microseconds_for_seconds(tmp_path: Path, recording: EventRecording) -> None:
    scaled = recording.events.copy()
    scaled["t_ns"] = (scaled["t_ns"] - scaled["t_ns"][0]) * 1_000_000
    empty = recording.gyroscope[:0]
    write_uzh_folder(replace(recording, events=scaled, gyroscope=empty, accelerometer=empty), tmp_path)
    with pytest.raises(RecordingError, match="likely factor 1000000"):
        open_recording(tmp_path)


def test_larger_sensor_is_recognised(tmp_path: Path, rng: np.random.Generator) -> None:
    events = make_events(rng, 2000)
    events["x"] = rng.integers(0, 640, 2000)
    bare = replace(make_event_recording(rng), events=events, camera=None, calibration=None)
    write_uzh_folder(bare, tmp_path)
    found = open_recording(tmp_path)
    assert (found.width, found.height) == (640, 480)
    assert any("640 x 480" in note for note in found.notes)


def test_guess_is_remembered(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    events = make_events(rng, 2000)
    events["x"] = rng.integers(0, 346, 2000)
    bare = replace(make_event_recording(rng), events=events, camera=None, calibration=None)
    write_uzh_folder(bare, tmp_path)
    first = open_recording(tmp_path, cache_from=0)
    monkeypatch.setattr(event_cache, "_convert", None)
    again = open_recording(tmp_path, cache_from=0)
    assert (again.width, again.height, again.notes) == (346, 260, first.notes)
    assert_same(again, first)


def test_wrong_resolution_in_the_calibration(tmp_path: Path, recording: EventRecording) -> None:
    write_uzh_folder(recording, tmp_path)
    path = tmp_path / "camchain-imucam.yaml"
    path.write_text(path.read_text().replace("[240, 180]", "[180, 240]"))
    with pytest.raises(RecordingError, match="wrong resolution"):
        open_recording(tmp_path)


def test_different_times_cannot_share_a_file(tmp_path: Path, recording: EventRecording) -> None:
    with pytest.raises(RecordingError, match="write HDF5 instead"):
        write_uzh_folder(replace(recording, gyroscope=recording.gyroscope[1:]), tmp_path)


@pytest.mark.parametrize("text", ["", "1 2 3", "a b c d e f g h i", "nan " * 9, "0 " * 9])
def test_lens_that_is_none(tmp_path: Path, rng: np.random.Generator, text: str) -> None:
    write_uzh_folder(replace(make_event_recording(rng, 50), camera=None, calibration=None), tmp_path)
    (tmp_path / "calib.txt").write_text(text)
    with pytest.raises(CalibrationError):
        open_recording(tmp_path)


@pytest.mark.parametrize("name", ["imu.txt", "groundtruth.txt"])
@pytest.mark.parametrize("text", ["", "x\n" * 30, "1 2\n", "\0\0"])
def test_bad_neighbours(tmp_path: Path, recording: EventRecording, name: str, text: str) -> None:
    write_uzh_folder(recording, tmp_path)
    (tmp_path / name).write_text(text)
    if name == "groundtruth.txt":
        found = open_recording(tmp_path)
        assert found.ground_truth is None
        assert any("not used as ground truth" in note and name in note for note in found.notes)
        return
    with pytest.raises(AsyneioError, match=r"imu\.txt"):
        open_recording(tmp_path)
    found = open_recording(tmp_path, ReadOptions(samples_needed=False))
    assert found.gyroscope.size == 0
    assert any("the inertial samples are not used" in note and name in note for note in found.notes)


@pytest.mark.parametrize("name", ["imu.yaml", "camchain-imucam.yaml"])
@pytest.mark.parametrize("text", ["", "a: [1,\n", "gyroscope_noise_density: many\n"])
def test_bad_calibration_beside_events(
    tmp_path: Path, recording: EventRecording, name: str, text: str
) -> None:
    write_uzh_folder(recording, tmp_path)
    (tmp_path / name).write_text(text)
    with pytest.raises(CalibrationError, match=name):
        open_recording(tmp_path)
    found = open_recording(tmp_path, ReadOptions(samples_needed=False))
    assert found.calibration is None
    assert found.gyroscope.size == recording.gyroscope.size
    assert (found.camera is not None) or name != "imu.yaml"
    assert any("the calibration is not used" in note and name in note for note in found.notes)
    # What the user names is needed.
    with pytest.raises(CalibrationError, match=name):
        open_recording(tmp_path, ReadOptions(imu=tmp_path / name, samples_needed=False))


def test_imu_noise_without_a_camera(tmp_path: Path, recording: EventRecording) -> None:
    write_uzh_folder(recording, tmp_path)
    (tmp_path / "camchain-imucam.yaml").unlink()
    assert open_recording(tmp_path).calibration is None
    found = open_recording(tmp_path, ReadOptions(imu=tmp_path / "imu.yaml"))
    assert found.camera is not None
    assert found.calibration is None
    assert "the calibration is incomplete: no extrinsics (camera to IMU)" in found.notes
