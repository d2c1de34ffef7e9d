"""One trajectory in the layout of every tool, and from every place that may hold one, is the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.io import write_estimates, write_tum
from asyneio.io.recording.trajectory_reader import read_trajectory, read_trajectory_file
from asyneio.io.trajectory_source import read_estimated, read_reference
from asyneio.types import PoseTrajectory
from tests.io.recordings import START_NS, make_estimate, straight_path

PATH = straight_path(1.0)
EUROC = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
OPENVINS = "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pr22 Pr23 Pr33 Pt11 Pt12 Pt13 Pt22 Pt23 Pt33\n"
ROSTOPIC = (
    "%time,field.header.stamp,field.header.frame_id,"
    + ",".join(f"field.pose.position.{a}" for a in "xyz")
    + ","
    + ",".join(f"field.pose.orientation.{a}" for a in "xyzw")
    + "\n"
)


def text(order: str, unit: str, mark: str = " ", tail: str = "") -> str:
    """Lines of `order`: t, n (stamp of another kind), p, q (w last), w (w first), a name of a frame (f)."""
    lines = []
    for t_ns, p, q in zip(PATH.t_ns.tolist(), PATH.position.tolist(), PATH.quaternion.tolist(), strict=True):
        stamp = {
            "s": f"{t_ns // 10**9}.{t_ns % 10**9:09d}", "us": f"{t_ns // 1000}.{t_ns % 1000:03d}",
            "ns": str(t_ns), "ns.": f"{t_ns}.000000",
        }[unit]  # fmt: skip
        fields = {"t": [stamp], "n": ["12345"], "p": p, "q": q, "w": [q[3], *q[:3]], "f": ["world"]}
        lines.append(mark.join(str(field) for part in order for field in fields[part]) + tail + "\n")
    return "".join(lines)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (text("tpq", "s"), ""),
        ("# timestamp tx ty tz qx qy qz qw\n" + text("tpq", "s"), ""),
        (text("tpq", "s", ", "), ""),
        (text("tpq", "ns."), "quaternion with w last, time in ns"),
        ("# timestamp[us] px py pz qx qy qz qw\n" + text("tpq", "us"), "time in us"),
        (EUROC + "\n" + text("tpw", "ns", ","), "quaternion with w first, time in ns"),
        (EUROC + ", v x, v y, v z\n" + text("tpw", "ns", ",", ",0,0,0"), "3 further column(s) ignored"),
        (text("tpw", "ns", ",", ",0.1,0.2,0.3,"), "quaternion with w first, time in ns"),
        (text("tpw", "ns", ",", ",0" * 9), "quaternion with w first, time in ns"),
        (OPENVINS + text("tpq", "s", " ", " 0" * 12), "quaternion with w last, time in s"),
        (
            "# timestamp(s) q p v bg ba cam_imu_dt num_cam\n" + text("tqp", "s", " ", " 0" * 9),
            "quaternion with w last, time in s",
        ),
        (ROSTOPIC + text("ntfpq", "ns", ","), "quaternion with w last, time in ns"),
        ("# t px py pz qx qy qz qw vx vy vz\n" + text("tpq", "s", "  ", " 0 0 0 "), "3 further"),
    ],
)
def test_layouts(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text(content)
    found, notes = read_trajectory(path)
    assert_same(found)
    assert (said in " ".join(notes)) if said else notes == ()


def assert_same(found: PoseTrajectory) -> None:
    np.testing.assert_array_equal(found.t_ns, PATH.t_ns)
    np.testing.assert_allclose(found.position, PATH.position, atol=1e-12)
    np.testing.assert_allclose(found.quaternion, PATH.quaternion, atol=1e-12)


def matrices() -> np.ndarray:
    R = Rotation.from_quat(PATH.quaternion).as_matrix()
    return np.concatenate([R, PATH.position[:, :, None]], axis=2).reshape(-1, 12)


def test_kitti(tmp_path: Path) -> None:
    path = tmp_path / "00.txt"
    np.savetxt(path, matrices())
    untimed = read_trajectory_file(path)
    assert not untimed.timed
    np.testing.assert_allclose(untimed.poses.quaternion, PATH.quaternion, atol=1e-9)
    with pytest.raises(RecordingError, match=r"without times.*times\.txt"):
        read_trajectory(path)
    # The cure of that sentence.
    (tmp_path / "times.txt").write_text(
        "".join(f"{t // 10**9}.{t % 10**9:09d}\n" for t in PATH.t_ns.tolist())
    )
    np.testing.assert_array_equal(read_trajectory(path)[0].t_ns, PATH.t_ns)
    for row in ("1 2 3 4 5 6 7 8 9 10 11 12", "-1 0 0 0 0 1 0 0 0 0 1 0"):
        # The second one is a reflection.
        path.write_text(f"{row}\n" * 9)
        with pytest.raises(RecordingError, match="not rigid transforms"):
            read_trajectory(path)


def test_a_row_that_is_a_reflection_is_not_used(tmp_path: Path) -> None:
    rows = matrices()
    rows[1, :3] *= -1.0
    path = tmp_path / "00.txt"
    np.savetxt(path, rows)
    found = read_trajectory_file(path).poses
    np.testing.assert_allclose(found.quaternion, np.delete(PATH.quaternion, 1, axis=0), atol=1e-9)


def test_columns_that_the_user_names(tmp_path: Path) -> None:
    path = tmp_path / "mine.txt"
    path.write_text(text("npqt", "ns"))
    with pytest.raises(RecordingError, match=r"mine\.txt"):
        read_trajectory(path)
    assert_same(read_trajectory_file(path, "-,px,py,pz,qx,qy,qz,qw,t_ns").poses)
    with pytest.raises(RecordingError, match=r"9 columns, but 8 names .* with - for those to ignore"):
        read_trajectory_file(path, "px,py,pz,qx,qy,qz,qw,t_ns")


def test_poses_that_were_lost_and_rows_out_of_order(tmp_path: Path) -> None:
    path = tmp_path / "mocap.txt"
    lines = text("tpq", "s").splitlines()
    gaps = [line.split()[0] + "  nan" * 7 if k % 3 else line for k, line in enumerate(lines)]
    path.write_text("\n".join(gaps[50:] + gaps[:50]) + "\n")
    found, notes = read_trajectory(path)
    np.testing.assert_array_equal(found.t_ns, PATH.t_ns[::3])
    assert [note.split(": ")[1][:8] for note in notes] == ["skipped ", "sorted b"]


def test_seconds_at_one_hertz(tmp_path: Path) -> None:
    for start in (0, 1_600_000_000):
        path = tmp_path / f"{start}.txt"
        path.write_text("".join(f"{start + k}.000000000 {k} 0 0 0 0 0 1\n" for k in range(9)))
        assert np.diff(read_trajectory(path)[0].t_ns)[0] == 10**9


@pytest.mark.parametrize(
    "content", ["".join(f"{k / 100} 1 2 3\n" for k in range(9)), "#t x y z\n1.0 1 2 3\n1.1 1 2 3\n"]
)
def test_positions_alone(tmp_path: Path, content: str) -> None:
    path = tmp_path / "leica.txt"
    path.write_text(content)
    with pytest.raises(RecordingError, match="positions without orientations, the first line is"):
        read_trajectory(path)


def test_places(tmp_path: Path, rng: np.random.Generator) -> None:
    write_tum(tmp_path / "trajectory.tum", PATH)
    for read in (read_estimated, read_reference):
        assert_same(read(tmp_path).longest)
    write_estimates(
        tmp_path / "estimates.npz", [make_estimate(START_NS + k * 50_000_000, rng) for k in range(5)]
    )
    for read in (read_estimated, read_reference):
        assert read(tmp_path).longest.t_ns.size == 5
    truth = tmp_path / "recording" / "mav0" / "state_groundtruth_estimate0"
    truth.mkdir(parents=True)
    (truth / "data.csv").write_text(EUROC + "\n" + text("tpw", "ns", ","))
    assert_same(read_reference(tmp_path / "recording").longest)
    with pytest.raises(RecordingError, match="contains no trajectory; expected a results folder"):
        read_estimated(tmp_path / "recording")
