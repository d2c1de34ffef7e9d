"""Bags that are packed, split, or hold a sensor in each topic: read as one recording, or told how."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from backports import zstd

from asyneio.errors import RecordingError
from asyneio.io import ReadOptions, open_recording
from asyneio.types import EventRecording
from tests.io.event_recordings import make_event_recording
from tests.io.ros.bags import Record, header, recording_records, write_bag

_ZERO = dict.fromkeys("xyz", 0.0)
_HALVES = {"gyro": "linear_acceleration", "accel": "angular_velocity"}


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    return make_event_recording(np.random.default_rng(5), 4000)


@pytest.fixture(scope="module")
def records(recording: EventRecording) -> list[Record]:
    return recording_records(recording)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_unpacked_as_the_recorder_would(tmp_path: Path, records: list[Record], storage: str) -> None:
    """Packed, packed and unpacked side by side, unpacked alone, and the packed file without its folder."""
    folder = write_bag(tmp_path / "run", 2, records, "file", storage)
    packed = next(folder.glob("*.zstd"))
    lone = tmp_path / packed.name
    lone.write_bytes(packed.read_bytes())
    wanted = open_recording(folder).events.copy()
    packed.with_suffix("").write_bytes(zstd.decompress(packed.read_bytes()))
    np.testing.assert_array_equal(open_recording(folder).events, wanted)
    packed.unlink()
    np.testing.assert_array_equal(open_recording(folder).events, wanted)
    np.testing.assert_array_equal(open_recording(lone).events, wanted)


def test_a_packed_file_that_is_cut_off(tmp_path: Path, records: list[Record]) -> None:
    folder = write_bag(tmp_path / "run", 2, records, "file", "mcap")
    packed = next(folder.glob("*.zstd"))
    whole = packed.read_bytes()
    packed.write_bytes(whole[:100])
    with pytest.raises(RecordingError, match=rf"{packed.name} is damaged or truncated: nothing"):
        open_recording(folder)
    # Blocks of zstd are 128 KiB unpacked: of two frames the first is whole.
    content = zstd.decompress(whole)
    half = zstd.compress(content[: len(content) // 2])
    packed.write_bytes(half + zstd.compress(content[len(content) // 2 :])[:100])
    found = open_recording(folder)
    assert 0 < found.events.size < 4000
    assert any(f"{packed.name} is damaged or truncated" in note for note in found.notes)


def test_a_listed_file_that_is_not_there(tmp_path: Path, records: list[Record]) -> None:
    folder = write_bag(tmp_path / "run", 2, records, "", "mcap")
    file = next(folder.glob("*.mcap"))
    renamed = file.rename(folder / "renamed.mcap")
    with pytest.raises(
        RecordingError, match=rf"lists {file.name}, which does not exist; the folder contains renamed.mcap"
    ):
        open_recording(folder)
    assert open_recording(renamed).events.size == 4000


def split(folder: Path, records: list[Record], ros: int, names: tuple[str, str]) -> None:
    folder.mkdir()
    middle = len(records) // 2
    for name, part in zip(names, (records[:middle], records[middle:]), strict=True):
        if ros == 1:
            write_bag(folder / name, 1, part)
        else:
            written = write_bag(folder.parent / f"{name}-folder", 2, part)
            next(written.glob("*.mcap")).rename(folder / name)


@pytest.mark.parametrize(
    ("ros", "names"),
    [
        (1, ("rec_0.bag", "rec_1.bag")),
        (1, ("2020-09-13-12-26-40_9.bag", "2020-09-13-12-27-40_10.bag")),
        (2, ("rec_0.mcap", "rec_1.mcap")),
    ],
)
def test_parts_are_joined(
    tmp_path: Path, recording: EventRecording, records: list[Record], ros: int, names: tuple[str, str]
) -> None:
    split(tmp_path / "run", records, ros, names)
    found = open_recording(tmp_path / "run")
    np.testing.assert_array_equal(found.events["t_ns"], recording.events["t_ns"])
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    assert any("are consecutive and were read as one recording" in note for note in found.notes)


def test_takes_are_not_joined(tmp_path: Path, records: list[Record]) -> None:
    later = [replace(record, logged_ns=record.logged_ns + 60 * 10**9) for record in records]
    split(tmp_path / "run", [*records, *later], 1, ("desk_1.bag", "desk_2.bag"))
    with pytest.raises(
        RecordingError, match=r"desk_2.bag begins \+[0-9.]+ s after the end of desk_1.bag; name one"
    ):
        open_recording(tmp_path / "run")
    assert open_recording(tmp_path / "run" / "desk_1.bag").events.size == 4000


def in_two_topics(records: list[Record]) -> list[Record]:
    """A topic for each sensor, the other half zeros, as RealSense does."""
    found = []
    for record in records:
        if record.topic != "/dvs/imu":
            found.append(record)
            continue
        for name, other in _HALVES.items():
            values = {**record.values, other: _ZERO}
            found.append(replace(record, topic=f"/camera/{name}/sample", values=values))
    return found


@pytest.mark.slow
def test_two_topics_complement_each_other(
    tmp_path: Path, recording: EventRecording, records: list[Record]
) -> None:
    path = write_bag(tmp_path / "run.bag", 1, in_two_topics(records))
    both = "/camera/gyro/sample,/camera/accel/sample"
    for options in (ReadOptions(), ReadOptions(samples=both)):
        found = open_recording(path, options)
        np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
        np.testing.assert_array_equal(found.accelerometer, recording.accelerometer)
    for half in both.split(","):
        with pytest.raises(RecordingError, match=f"select both topics: --samples {both}"):
            open_recording(path, ReadOptions(samples=half))
    alone = open_recording(path, ReadOptions(samples=half, samples_needed=False))
    assert alone.events.size == 4000


def test_a_whole_topic_goes_before_halves(
    tmp_path: Path, recording: EventRecording, records: list[Record]
) -> None:
    whole = [record for record in records if record.topic == "/dvs/imu"]
    path = write_bag(tmp_path / "run.bag", 1, [*in_two_topics(records), *whole])
    found = open_recording(path)
    np.testing.assert_array_equal(found.accelerometer, recording.accelerometer)
    assert any("not used: /camera/gyro/sample" in note for note in found.notes)


@pytest.mark.parametrize("ros", [1, 2])
def test_truth_as_a_path(tmp_path: Path, recording: EventRecording, records: list[Record], ros: int) -> None:
    poses = [record for record in records if record.topic == "/optitrack/davis"]
    others = [record for record in records if record.topic != "/optitrack/davis"]
    paths = [
        Record(
            poses[count - 1].logged_ns, "/gt_path", "nav_msgs/msg/Path",
            {"header": header(poses[count - 1].logged_ns), "poses": [pose.values for pose in poses[:count]]},
        )
        for count in (1, len(poses))
    ]  # fmt: skip
    path = write_bag(
        tmp_path / "run.bag", ros, sorted([*others, *paths], key=lambda record: record.logged_ns)
    )
    found = open_recording(path)
    assert recording.ground_truth is not None
    assert found.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.t_ns, recording.ground_truth.t_ns)
    np.testing.assert_array_equal(found.ground_truth.position, recording.ground_truth.position)
    assert "ground truth from the poses of /gt_path" in found.notes
