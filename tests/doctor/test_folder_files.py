"""Every file of a folder is told: used or not, and why; a reader's refusal stays, whatever else was found."""

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


def test_files_used_and_not_used(folder: Path) -> None:
    (folder / "notes.md").write_text("about this recording")
    plain = next(v for v in examine(folder).verdicts if v.check == "files")
    assert plain.severity is Severity.OK
    assert "events.txt (events)" in plain.measured
    assert "imu.txt (inertial samples)" in plain.measured
    (folder / "other.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    told = next(v for v in examine(folder).verdicts if v.check == "files")
    assert told.severity is Severity.NOTE
    assert "other.bag (a ROS 1 bag: another recording)" in told.measured
    assert set(told.values["unused"]) == {"notes.md", "other.bag"}


@pytest.mark.parametrize(
    ("name", "content", "said"),
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
def test_a_refusal_stays_beside_inertial_samples(folder: Path, name: str, content: bytes, said: str) -> None:
    (folder / "events.txt").unlink()
    (folder / name).write_bytes(content)
    diagnosis = examine(folder)
    assert diagnosis.worst is Severity.FAIL
    assert said in diagnosis.headline
    assert diagnosis.headline.startswith("not usable as it is; first cause: ")


def test_inertial_samples_alone_are_no_failure(folder: Path) -> None:
    (folder / "events.txt").unlink()
    assert examine(folder).worst < Severity.FAIL


def test_what_the_reader_gave_up_on_is_not_judged_again(folder: Path) -> None:
    lines = (folder / "events.txt").read_text().splitlines()
    (folder / "events.txt").write_text("\n".join(line.replace(".", ",").replace(" ", ";") for line in lines))
    diagnosis = examine(folder)
    assert [v.check for v in diagnosis.verdicts if v.severity is Severity.FAIL] == ["events"]
    assert "decimal commas" in diagnosis.headline
    assert not any("record again" in verdict.cure for verdict in diagnosis.verdicts)


def test_named_samples_that_are_not_there_leave_the_rest(folder: Path) -> None:
    diagnosis = examine(folder, ReadOptions(samples="absent.csv"))
    assert [v.check for v in diagnosis.verdicts if v.severity is Severity.FAIL] == ["inertial samples"]
    assert "absent.csv (--samples) does not exist" in diagnosis.headline
    assert diagnosis.events > 0
    assert any(verdict.check == "event rate" for verdict in diagnosis.verdicts)


@pytest.mark.parametrize("name", ["imu.csv", "imu.txt"])
def test_unreadable_samples_do_not_hide_the_events(folder: Path, name: str) -> None:
    (folder / "imu.txt").unlink()
    (folder / name).write_text("t;gx;gy;gz;ax;ay;az\n" + "2020-09-13T12:26:40;1;2;3;4;5;6\n" * 40)
    diagnosis = examine(folder)
    assert diagnosis.worst is Severity.FAIL
    assert diagnosis.events > 0
    assert name in diagnosis.headline
    assert any(verdict.check == "event rate" for verdict in diagnosis.verdicts)


def test_a_malformed_calibration_leaves_the_lens(folder: Path) -> None:
    (folder / "imu.yaml").write_text("a: [1,\n")
    diagnosis = examine(folder)
    assert diagnosis.headline.startswith("not usable as it is; first cause: calibration: ")
    assert "imu.yaml" in diagnosis.headline
    assert any(verdict.check == "lens" for verdict in diagnosis.verdicts)
