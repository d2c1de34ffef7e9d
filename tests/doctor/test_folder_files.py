"""Every file of a folder is reported, used or not; a reader's failure is kept even if other data are
found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.doctor import Severity, examine
from asyneio.io import ReadOptions, write_uzh_folder
from tests.io.event_recordings import make_event_recording


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    write_uzh_folder(make_event_recording(rng), tmp_path)
    return tmp_path


@pytest.mark.slow
def test_files_used_and_not_used(folder: Path) -> None:
    (folder / "notes.md").write_text("about this recording")
    plain = next(v for v in examine(folder).results if v.check == "files")
    assert plain.severity is Severity.OK
    assert "events.txt (events)" in plain.measured
    assert "imu.txt (inertial samples)" in plain.measured
    np.save(folder / "other.npy", np.column_stack([np.arange(9), np.ones((9, 3), dtype=int)]))
    result = next(v for v in examine(folder).results if v.check == "files")
    assert result.severity is Severity.NOTE
    assert "other.npy (NumPy .npy or .npz with columns of events: another recording)" in result.measured
    assert set(result.values["unused"]) == {"notes.md", "other.npy"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("other.bag", b"#ROSBAG V2.0\n" + bytes(100), "a ROS 1 bag, unreadable: "),
        (
            "other.raw",
            b"% evt 4.0\n% geometry 240x180\n% end\n" + bytes(800),
            "EVT 4.0, which is not supported",
        ),
        ("other.h5", b"noise" * 100, "other.h5 (of an unknown format)"),
    ],
)
def test_an_unreadable_recording_beside_a_good_one(
    folder: Path, name: str, content: bytes, text: str
) -> None:
    (folder / name).write_bytes(content)
    report = examine(folder)
    result = next(v for v in report.results if v.check == "files")
    assert result.severity is Severity.WARNING
    assert text in result.measured
    assert name in result.fix
    assert result.values["unreadable"] == [name]


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        (
            "rec.raw",
            b"% evt 4.0\n% geometry 240x180\n% end\n" + bytes(800),
            "in EVT 4.0, which is not supported",
        ),
        ("events.csv", b"a,b\n1,2\n", "events.csv is of an unknown format"),
        ("rec.aedat", b"#!AER-DAT3.1\r\n", "AEDAT of another version"),
        ("rec.h5", b"\x89HDF\r\n\x1a\n" + bytes(100), "rec.h5"),
    ],
)
def test_a_failure_is_kept_beside_inertial_samples(
    folder: Path, name: str, content: bytes, text: str
) -> None:
    (folder / "events.txt").unlink()
    (folder / name).write_bytes(content)
    report = examine(folder)
    assert report.worst is Severity.FAIL
    assert text in report.headline
    assert report.headline.startswith("not usable as it is; first cause: ")


def test_inertial_samples_alone_do_not_fail(folder: Path) -> None:
    (folder / "events.txt").unlink()
    assert examine(folder).worst < Severity.FAIL


def test_a_reader_failure_is_reported_once(folder: Path) -> None:
    lines = (folder / "events.txt").read_text().splitlines()
    (folder / "events.txt").write_text("\n".join(line.replace(".", ",").replace(" ", ";") for line in lines))
    report = examine(folder)
    assert [v.check for v in report.results if v.severity is Severity.FAIL] == ["events"]
    assert "decimal commas" in report.headline
    assert not any("record again" in result.fix for result in report.results)


def test_missing_named_samples_do_not_hide_the_rest(folder: Path) -> None:
    report = examine(folder, ReadOptions(samples="absent.csv"))
    assert [v.check for v in report.results if v.severity is Severity.FAIL] == ["inertial samples"]
    assert "absent.csv (--samples) does not exist" in report.headline
    assert report.events > 0
    assert any(result.check == "event rate" for result in report.results)


@pytest.mark.parametrize("name", ["imu.csv", "imu.txt"])
def test_unreadable_samples_do_not_hide_the_events(folder: Path, name: str) -> None:
    (folder / "imu.txt").unlink()
    (folder / name).write_text("t;gx;gy;gz;ax;ay;az\n" + "2020-09-13T12:26:40;1;2;3;4;5;6\n" * 40)
    report = examine(folder)
    assert report.worst is Severity.FAIL
    assert report.events > 0
    assert name in report.headline
    assert any(result.check == "event rate" for result in report.results)


def test_a_malformed_calibration_file_does_not_hide_the_intrinsics(folder: Path) -> None:
    (folder / "imu.yaml").write_text("a: [1,\n")
    report = examine(folder)
    assert report.headline.startswith("not usable as it is; first cause: calibration: ")
    assert "imu.yaml" in report.headline
    assert any(result.check == "distortion" for result in report.results)


def test_several_recordings_without_readable_events(folder: Path) -> None:
    (folder / "events.txt").unlink()
    for name in ("a.npy", "b.npy"):
        np.save(folder / name, np.column_stack([np.arange(2000), np.ones((2000, 3), dtype=int)]))
    report = examine(folder)
    failures = [result for result in report.results if result.severity is Severity.FAIL]
    assert len(failures) == 1
    assert "contains 2 recordings: a.npy, b.npy; name one of them" in failures[0].measured
    files = next(v for v in report.results if v.check == "files")
    assert "imu.txt (inertial samples)" in files.measured
    assert "a.npy (NumPy" in files.measured


def test_links_to_nothing_and_a_truncated_file(folder: Path) -> None:
    (folder / "gone.bag").symlink_to(folder / "nowhere")
    (folder / "itself").symlink_to(folder / "itself")
    files = next(v for v in examine(folder).results if v.check == "files")
    assert "gone.bag (a link to a file that does not exist)" in files.measured
    assert "itself (a link to a file that does not exist)" in files.measured
    report = examine(folder / "itself")
    assert "to itself; check the link" in report.results[0].measured


def test_recordings_in_folders_below(tmp_path: Path, rng: np.random.Generator) -> None:
    write_uzh_folder(make_event_recording(rng), tmp_path / "one")
    report = examine(tmp_path)
    assert f"its folders contain recordings: {tmp_path / 'one'}" in report.results[0].measured
