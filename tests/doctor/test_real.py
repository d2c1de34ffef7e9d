"""Expected results of the doctor for every real file and folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from asyneio.doctor import Severity, examine

OK, NOTE, WARNING, FAIL = Severity.OK, Severity.NOTE, Severity.WARNING, Severity.FAIL

#: An excerpt of a fraction of a second without an IMU.
_EXCERPT = {"duration": WARNING, "imu": WARNING, "calibration": WARNING}
#: A short recording of a stationary camera with an IMU.
_STATIC = {"duration": WARNING, "imu": OK, "imu units": OK, "stationary": NOTE, "calibration": WARNING}


@dataclass(frozen=True)
class Row:
    """A file or folder below the data, the commands that can use it, results by check, and words of the
    report.

    Every check that is not listed must give OK or NOTE.
    """

    path: str
    usable_for: tuple[str, ...]
    results: dict[str, Severity]
    words: tuple[str, ...] = field(default=())


ROWS = (
    Row(
        "davis240_imu/IMU_rotDisk.aedat",
        ("run", "track"),
        {"imu units": OK, "extrinsics": NOTE, "time offset": OK},
        ("agrees: error", "about 2 of 3 axes", "converted from the sensor's counts"),
    ),
    Row(
        "davis240_imu/IMU_translBoxes.aedat",
        ("run", "track"),
        {"imu units": OK, "extrinsics": NOTE},
        ("does not contradict the calibration and excludes 16 of 23 other mountings",),
    ),
    Row("davis240_imu", (), {"recording": FAIL}, ("2 recordings", "name one of them")),
    Row(
        "davis240_imu/camchain-imucam.yaml",
        (),
        {"recording": WARNING, "distortion": OK},
        ("a calibration alone",),
    ),
    Row("dvs128/building.mat", (), {"recording": FAIL}, ("a MATLAB file", "one line `t[s] x y p` per event")),
    Row("dvs128/stripes.mat", (), {"recording": FAIL}, ("a MATLAB file", "one line `t[s] x y p` per event")),
    Row("ecd_excerpts/shapes_rotation", ("track",), _EXCERPT | {"distortion": OK}, ("no inertial samples",)),
    Row("ecd_excerpts/dynamic_translation", ("track",), _EXCERPT | {"distortion": OK}, ("a short excerpt",)),
    Row("ecd_excerpts/boxes_translation", ("track",), _EXCERPT | {"event rate": NOTE}, ("2.64 Mev/s",)),
    Row(
        "ecd_shapes_rotation_imu",
        ("track",),
        {
            "duration": WARNING,
            "clocks": OK,
            "imu range": OK,
            "imu units": OK,
            "imu gravity": NOTE,
            "distortion": OK,
        },
        ("0.106004 s: a short excerpt", "in the steadiest half second", "at least 1 s"),
    ),
    Row("slider_depth", ("track",), _EXCERPT | {"ground truth": OK}, ("no inertial samples",)),
    Row(
        "euroc_V1_01",
        (),
        {"recording": WARNING, "imu units": OK, "imu rate": OK, "imu gaps": OK, "ground truth": OK},
        ("inertial samples alone", "gyroscope first", "29120 samples of the gyroscope"),
    ),
    Row("tumvi_calib", ("run",), {"extrinsics": OK, "time offset": OK, "clocks": OK}, ("agrees: error",)),
    Row(
        "formats/davis346_static.aedat4",
        ("track",),
        _STATIC,
        ("stationary throughout", "g and deg/s, which the format defines", "0.169941 s: a short excerpt"),
    ),
    Row(
        "formats/dvxplorer_static.aedat4",
        ("track",),
        _STATIC,
        ("stationary throughout", "g and deg/s, which the format defines", "0.589917 s: a short excerpt"),
    ),
    Row("formats/gen3.evt2.raw", ("track",), _EXCERPT, ("640 x 480", "521252 events")),
    Row(
        "formats/event_packet_evt3.bag",
        ("track",),
        {"imu": WARNING, "calibration": WARNING, "flicker": WARNING, "duration": OK},
        ("a ROS 1 bag", "modulated at 120 Hz"),
    ),
    Row("formats/event_packet_libcaer_cmp_ros2", ("track",), _EXCERPT, ("a ROS 2 bag",)),
    Row("motion_profiles", (), {"recording": FAIL}, ("this is a trajectory",)),
    Row("textures", (), {"recording": FAIL}, ("these are pictures",)),
    Row("README.md", (), {"recording": FAIL}, ("of an unknown format",)),
)


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.path)
def test_result(data_dir: Path, row: Row) -> None:
    report = examine(data_dir / row.path)
    found = {result.check: result.severity for result in report.results}
    assert {check: found.get(check) for check in row.results} == row.results
    others = {check: severity for check, severity in found.items() if check not in row.results}
    assert {check: severity for check, severity in others.items() if severity > NOTE} == {}
    assert report.usable_for == row.usable_for
    text = " ".join(f"{v.measured} {v.expected} {v.fix}" for v in report.results)
    text += " ".join(report.repairs)
    assert [words for words in row.words if words not in text] == []


def test_every_entry_of_the_data_has_a_row(data_dir: Path) -> None:
    named = {row.path.split("/")[0] for row in ROWS}
    assert {entry.name for entry in data_dir.iterdir()} <= named


def test_a_wrong_mounting_of_a_real_camera_fails(data_dir: Path, tmp_path: Path) -> None:
    """The calibration of the rotating disk, with the camera rotated by 180 degrees."""
    text = (data_dir / "davis240_imu" / "camchain-imucam.yaml").read_text()
    wrong = text.replace("[-1.0, 0.0, 0.0, 0.0]", "[1.0, 0.0, 0.0, 0.0]").replace(
        "[0.0, 0.0, -1.0, 0.0]", "[0.0, 0.0, 1.0, 0.0]"
    )
    assert wrong != text
    (tmp_path / "camchain-imucam.yaml").write_text(wrong)
    for name in ("imu.yaml", "IMU_rotDisk.aedat"):
        (tmp_path / name).symlink_to(data_dir / "davis240_imu" / name)
    result = next(v for v in examine(tmp_path).results if v.check == "extrinsics")
    assert result.severity is FAIL
    assert "mirrored" in result.fix


@pytest.mark.slow
def test_clipped_readings_of_a_real_gyroscope_are_found(data_dir: Path, tmp_path: Path) -> None:
    """Quantised, unsaturated readings of a DAVIS240, clipped like those of a sensor with a range of 500
    deg/s."""
    source = data_dir / "ecd_shapes_rotation_imu"
    rows = np.loadtxt(source / "imu.txt")
    end = float(np.deg2rad(500.0))
    clipped = np.abs(rows[:, 4:]) >= end
    assert np.count_nonzero(clipped.any(axis=1)) == 2093
    rows[:, 4:] = np.clip(rows[:, 4:], -end, end)
    np.savetxt(tmp_path / "imu.txt", rows, fmt="%.9f")
    for name in ("events.txt", "camchain-imucam.yaml", "imu.yaml"):
        (tmp_path / name).symlink_to(source / name)
    result = next(v for v in examine(tmp_path).results if v.check == "imu range")
    assert result.severity is WARNING
    found = result.values["found"]["gyroscope"]["saturated"]
    assert 0.95 * clipped.any(axis=1).sum() <= found <= 1.01 * clipped.any(axis=1).sum()
