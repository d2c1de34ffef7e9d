"""Inertial samples and poses in the layouts of data sets; what is ambiguous, gravity decides or we refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording, read_inertial_file
from asyneio.io.recording.trajectory_reader import read_trajectory

EUROC = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)
GYROSCOPE, ACCELEROMETER = (0.1, 0.2, 0.3), (0.0, 0.0, 9.81)
T_NS = [1_403_715_273_262_142_976 + 5_000_000 * k for k in range(50)]


def lines(times: list[str], *columns: float, separator: str = " ") -> str:
    return "".join(separator.join([time, *map(repr, columns)]) + "\n" for time in times)


def write(folder: Path, text: str) -> Path:
    path = folder / "imu.txt"
    path.write_text(text)
    return path


SECONDS = [f"{t // 10**9}.{t % 10**9:09d}" for t in T_NS]
MICROSECONDS = [f"{t // 1000}.{t % 1000:03d}" for t in T_NS]
NANOSECONDS = [str(t) for t in T_NS]


BOTH = (*GYROSCOPE, *ACCELEROMETER)
TUM_VIE = "# timestamp[us] gx gy gz ax ay az temperature\n"
VECTOR = "#timestamp gx gy gz ax ay az mx my mz\n"
FPV = "# id timestamp ang_vel_x ang_vel_y ang_vel_z lin_acc_x lin_acc_y lin_acc_z\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (EUROC + lines(NANOSECONDS, *BOTH, separator=","), "gyroscope first (from the header), time in ns"),
        (lines(SECONDS, *ACCELEROMETER, *GYROSCOPE), "accelerometer first (from gravity), time in s"),
        (lines(SECONDS, *BOTH), "gyroscope first (from gravity), time in s"),
        (TUM_VIE + lines(MICROSECONDS, *BOTH, 20.5), "first (from the header), time in us; 1 further"),
        (lines(MICROSECONDS, *BOTH, 20.5), "gyroscope first (from gravity), time in us; 1 further"),
        (VECTOR + lines(SECONDS, *BOTH, 9.81, 0.0, 0.0), "3 further column(s)"),
        (
            "t_ns,gx,gy,gz,ax,ay,az\n" + lines(NANOSECONDS, *BOTH, separator=","),
            "(from the header), time in ns",
        ),
        (
            "ax,ay,az,t,gx,gy,gz\n" + "".join(f"0.0,0.0,9.81,{t},0.1,0.2,0.3\n" for t in SECONDS),
            "accelerometer first (from the header), time in s",
        ),
        (
            FPV + "".join(f"{k} {t} 0.1 0.2 0.3 0 0 9.81\n" for k, t in enumerate(SECONDS)),
            "(from the header), time in s",
        ),
        (
            "\ufeff% made by hand\r\n\r\n" + lines(NANOSECONDS, *BOTH).replace("\n", "\r\n"),
            "(from gravity), time in ns",
        ),
    ],
)
def test_layouts(tmp_path: Path, text: str, said: str) -> None:
    found = read_inertial_file(write(tmp_path, text))
    assert said in found.notes[0]
    np.testing.assert_array_equal(found.gyroscope["t_ns"], T_NS)
    np.testing.assert_array_equal(found.accelerometer["t_ns"], T_NS)
    np.testing.assert_array_equal(found.gyroscope["xyz"], [GYROSCOPE] * 50)
    np.testing.assert_array_equal(found.accelerometer["xyz"], [ACCELEROMETER] * 50)


def test_real_euroc(data_dir: Path) -> None:
    folder = data_dir / "euroc_V1_01"
    found = read_inertial_file(folder / "imu0_data.csv")
    plain = np.loadtxt(folder / "imu0_data.csv", delimiter=",")
    assert found.gyroscope.size == len(plain)
    np.testing.assert_array_equal(found.gyroscope["xyz"], plain[:, 1:4])
    np.testing.assert_array_equal(found.accelerometer["xyz"], plain[:, 4:7])
    # Float64 cannot hold these stamps: the exact ones are in the text.
    assert found.gyroscope["t_ns"][:2].tolist() == [1403715273262142976, 1403715273267142912]
    assert 9.5 < np.median(np.linalg.norm(found.accelerometer["xyz"], axis=1)) < 10.1
    truth, notes = read_trajectory(folder / "groundtruth_20hz_full_state.csv")
    assert "quaternion with w first, time in ns" in notes[0]
    assert truth.t_ns[0] == 1403715273262142976
    np.testing.assert_allclose(truth.quaternion[0], [-0.824237, -0.106942, -0.551702, 0.069433], atol=1e-6)
    np.testing.assert_array_equal(truth.position[0], [0.878895, 2.1834, 0.948427])
    # The attitude is right when it takes the IMU's reading to the vertical.
    stamps = found.accelerometer["t_ns"]
    x, y, z, w = truth.quaternion.T
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
    force = found.accelerometer["xyz"][np.searchsorted(stamps, truth.t_ns[10:-10])]
    along = (force * up[10:-10]).sum(axis=1) / np.linalg.norm(force, axis=1)
    assert np.median(along) > 0.98


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no line of numbers"),
        ("# only a header\n", "no line of numbers"),
        ("1 2 3\n2 3 4\n", "2 line.s. of 3 numbers"),
        (lines(SECONDS, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6), "cannot determine which columns"),
        (lines(SECONDS, *ACCELEROMETER, *ACCELEROMETER), "cannot determine which columns"),
        (lines([str(k * 10**7) for k in range(9)], *BOTH), ""),
        (lines(["5"] * 9, *BOTH), "time does not advance"),
        (lines([str(k * 10**12) for k in range(9)], *BOTH), "in no unit"),
        ("t_s gx gy gz ax ay az\n" + lines(["9" * 30, "1"], *BOTH), "does not fit into 64 bits"),
        (lines(SECONDS[:1], *BOTH), "1 line.s. of 7"),
        (lines(SECONDS, *BOTH) + "x\n" * 30, "more than 20 unreadable"),
        ("1" * 5000, "is too long"),
    ],
)  # fmt: skip
def test_refused(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    if not message:
        assert "time in ns" in read_inertial_file(path).notes[0]
        return
    with pytest.raises(RecordingError, match=message):
        read_inertial_file(path)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot read"):
        read_inertial_file(tmp_path / "none")


def test_bad_lines_and_gaps_in_numbers(tmp_path: Path) -> None:
    text = lines(SECONDS[:20], *BOTH) + "half a line\n"
    text += f"{SECONDS[20]} nan nan nan 0 0 9.81\n" + lines(SECONDS[21:], *BOTH)
    found = read_inertial_file(write(tmp_path, text + SECONDS[0][:7]))
    assert found.gyroscope.size == 50
    assert np.isnan(found.gyroscope["xyz"][20]).all()
    assert any("skipped 2 unreadable line(s), number 21, 52" in note for note in found.notes)


def test_folder_of_euroc_without_events(tmp_path: Path) -> None:
    for name in ("imu0", "mav0/imu0"):
        folder = tmp_path / name.replace("/", "-")
        (folder / name).mkdir(parents=True)
        (folder / name / "data.csv").write_text(EUROC)
        with pytest.raises(RecordingError, match=rf"inertial samples \({name}/data.csv\) but no events"):
            open_recording(folder)


def test_real_folder_without_events(data_dir: Path) -> None:
    """Neither its samples nor the matrix in its YAML are events."""
    with pytest.raises(RecordingError, match=r"inertial samples \(imu0_data.csv\) but no events"):
        open_recording(data_dir / "euroc_V1_01")


@pytest.mark.parametrize(
    ("text", "w_first", "unit"),
    [
        ("#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
         + lines(NANOSECONDS, 1.0, 2.0, 3.0, 0.5, 0.1, 0.7, 0.5, separator=","), True, "ns"),
        (lines(SECONDS, 1.0, 2.0, 3.0, 0.1, 0.7, 0.5, 0.5), False, "s"),
        ("# timestamp[us] px py pz qx qy qz qw\n"
         + lines(MICROSECONDS, 1.0, 2.0, 3.0, 0.1, 0.7, 0.5, 0.5), False, "us"),
        (lines(NANOSECONDS, 1.0, 2.0, 3.0, 0.5, 0.1, 0.7, 0.5, *[0.0] * 9, separator=","), True, "ns"),
    ],
)  # fmt: skip
def test_truth(tmp_path: Path, text: str, w_first: bool, unit: str) -> None:
    truth, notes = read_trajectory(write(tmp_path, text))
    np.testing.assert_array_equal(truth.t_ns, T_NS)
    np.testing.assert_array_equal(truth.position, [[1.0, 2.0, 3.0]] * 50)
    np.testing.assert_array_equal(truth.quaternion, [[0.1, 0.7, 0.5, 0.5]] * 50)
    told = f"quaternion with w {'first' if w_first else 'last'}, time in {unit}"
    # The layout of TUM needs no word.
    assert notes == () if unit == "s" else told in notes[0]


def test_truth_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"contain unit quaternions; the first line is .1403715273"):
        read_trajectory(write(tmp_path, lines(SECONDS, *range(7))))
