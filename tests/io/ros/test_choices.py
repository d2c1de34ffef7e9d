"""Bags with several candidates: topics, samples, ground truth, camera info, sidecar files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import ReadOptions, open_recording, write_uzh_folder
from asyneio.types import Distortion, EventRecording
from tests.io.ros.bags import Record, camera_record, header, write_bag

K = [200.0, 0, 120, 0, 201, 90, 0, 0, 1]


def renamed(records: list[Record], old: str, new: str) -> list[Record]:
    return [replace(record, topic=new) for record in records if record.topic == old]


@pytest.mark.slow
def test_several_topics(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    more = renamed(records, "/dvs/events", "/right/events")[:2] + renamed(records, "/dvs/imu", "/right/imu")
    path = write_bag(tmp_path / "run", 1, records + more)
    with pytest.raises(
        RecordingError, match=r"2 topics of events: /dvs/events .*6 messages.*/right.*--events"
    ):
        open_recording(path)
    with pytest.raises(RecordingError, match=r"2 topics of samples: /dvs/imu .*--samples TOPIC"):
        open_recording(path, ReadOptions(events="/dvs/events"))
    with pytest.raises(RecordingError, match=r"no events in a topic /dvs/imu; available: /dvs/events"):
        open_recording(path, ReadOptions(events="/dvs/imu"))
    for name, count in (("/dvs/events", 3000), ("/right/events", 1000)):
        found = open_recording(path, ReadOptions(events=name, samples="/right/imu"), cache_from=0)
        assert found.events.size == count
        np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
        assert any(f"events from {name} (dvs_msgs/EventArray" in note for note in found.notes)


def test_no_events(tmp_path: Path, records: list[Record]) -> None:
    path = write_bag(tmp_path / "run", 2, [record for record in records if record.topic != "/dvs/events"])
    with pytest.raises(RecordingError, match=r"no topic of events; .*/dvs/imu \(sensor_msgs/msg/Imu"):
        open_recording(path)


def test_samples_without_stamps(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    """Then the times of recording count; and stamps that run twice as fast are told."""
    for factor, said in ((0, "have no stamps; recording times"), (2, "advance 2.0[0-9]* times as fast")):
        changed = []
        start = records[0].logged_ns
        for record in records:
            if record.topic == "/dvs/imu":
                t_ns = start + factor * (record.logged_ns - start) if factor else 0
                record = replace(record, values=record.values | {"header": header(t_ns)})
            changed.append(record)
        found = open_recording(write_bag(tmp_path / f"run{factor}", 1, changed))
        assert re.search(said, " ".join(found.notes))
        if factor == 0:
            np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)


def test_files_beside(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    """What the bag lacks may stand in files: samples and ground truth."""
    only = [record for record in records if record.topic == "/dvs/events"]
    write_uzh_folder(recording, tmp_path / "files")
    path = write_bag(tmp_path / "run.bag", 1, only)
    assert open_recording(path).gyroscope.size == 0
    found = open_recording(path, ReadOptions(samples=str(tmp_path / "files" / "imu.txt")))
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    path.rename(tmp_path / "files" / "run.bag")
    (tmp_path / "files" / "events.txt").unlink()
    found = open_recording(tmp_path / "files" / "run.bag")
    np.testing.assert_array_equal(found.accelerometer, recording.accelerometer)
    assert found.ground_truth is not None
    assert found.calibration is not None


def test_several_truths(tmp_path: Path, records: list[Record]) -> None:
    more = renamed(records, "/optitrack/davis", "/vicon/board")
    found = open_recording(write_bag(tmp_path / "run", 1, records + more))
    assert found.ground_truth is None
    assert any("several topics of poses, none used" in note for note in found.notes)


@pytest.mark.parametrize(
    ("model", "d", "distortion", "coefficients"),
    [
        ("plumb_bob", [-0.3, 0.1, 0.0, 0.0, 0.0], Distortion.RADTAN, (-0.3, 0.1, 0.0, 0.0)),
        ("plumb_bob", [-0.3, 0.1, 0.0, 0.0, 0.2], Distortion.RADTAN, (-0.3, 0.1, 0.0, 0.0, 0.2)),
        ("plumb_bob", [0.0] * 5, Distortion.NONE, ()),
        ("equidistant", [0.1, 0.0, 0.0, 0.02], Distortion.EQUIDISTANT, (0.1, 0.0, 0.0, 0.02)),
        ("rational_polynomial", [-0.3, 0.1, 0, 0, 0, 0, 0, 0], Distortion.RADTAN, (-0.3, 0.1, 0.0, 0.0)),
        ("rational_polynomial", [0.1] * 8, Distortion.RADTAN, (0.1,) * 8),
        ("rational_polynomial", [0.0] * 8, Distortion.NONE, ()),
        ("rational_polynomial", [0.0] * 11 + [0.01], Distortion.RADTAN, (*(0.0,) * 11, 0.01)),
        ("rational_polynomial", [*(0.1,) * 8, *(0.0,) * 6], Distortion.RADTAN, (0.1,) * 8),
    ],
)
@pytest.mark.parametrize("ros", [1, 2])
def test_lens(
    tmp_path: Path,
    records: list[Record],
    ros: int,
    model: str,
    d: list[float],
    distortion: Distortion,
    coefficients: tuple[float, ...],
) -> None:
    start = records[0].logged_ns
    path = write_bag(tmp_path / "run", ros, [camera_record(start, ros, K, d, model), *records[:200]])
    lens = open_recording(path).camera
    assert lens is not None
    assert (lens.fx, lens.fy, lens.cx, lens.cy, lens.width) == (200.0, 201.0, 120.0, 90.0, 240)
    assert (lens.distortion, lens.coefficients) == (distortion, coefficients)


@pytest.mark.parametrize(
    ("k", "d", "model", "said"),
    [
        ([0.0] * 9, [], "", ""),
        (K, [0.1] * 14, "rational_polynomial", "a tilted sensor"),
        (K, [0.1] * 3, "plumb_bob", "found 3 coefficients"),
        (K, [0.1] * 4, "ftheta", "'ftheta'; expected one of"),
        ([-5.0, *K[1:]], [], "", "not used for the intrinsics"),
    ],
)
def test_no_lens(
    tmp_path: Path, records: list[Record], k: list[float], d: list[float], model: str, said: str
) -> None:
    start = records[0].logged_ns
    found = open_recording(
        write_bag(tmp_path / "run", 1, [camera_record(start, 1, k, d, model), *records[:200]])
    )
    assert found.camera is None
    assert said in " ".join(found.notes)


@pytest.mark.slow
def test_texts_of_other_length(recording: EventRecording, records: list[Record], tmp_path: Path) -> None:
    """Messages of one topic with frames of different names, the same total length or not."""
    changed = []
    for k, record in enumerate(records):
        values = dict(record.values)
        values["header"] = dict(values["header"], frame_id="imu_link"[: k % 7])
        changed.append(replace(record, values=values))
    for ros in (1, 2):
        found = open_recording(write_bag(tmp_path / f"run{ros}", ros, changed))
        np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
        np.testing.assert_array_equal(found.events, recording.events)
