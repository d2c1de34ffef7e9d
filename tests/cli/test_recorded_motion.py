"""`asyneio simulate` along recorded poses, with the samples of the same IMU."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.io import open_recording, read_inertial_file
from asyneio.simulation import draw_motion
from asyneio.simulation.imu import specific_force_b
from asyneio.types import EventRecording
from tests.cli.conftest import Asyneio

START_NS = 1_403_715_273_000_000_000
NOISE = """gyroscope_noise_density: 2.0e-4
accelerometer_noise_density: 2.0e-3
gyroscope_random_walk: 2.0e-5
accelerometer_random_walk: 2.0e-4
update_rate: 200
"""


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with poses and samples of one motion of 4 s in the layout of EuRoC."""
    rng = np.random.default_rng(4)
    motion = draw_motion("moderate", rng, np.eye(3), 1.0)
    t_s = np.arange(0.0, 4.0, 0.005)
    t_ns = START_NS + np.rint(1e9 * t_s).astype(np.int64)
    T_w_b = motion.T_w_b(t_s)
    q = Rotation.from_matrix(T_w_b[:, :3, :3]).as_quat()
    poses = np.hstack([T_w_b[:, :3, 3] + rng.normal(0.0, 5e-4, (t_s.size, 3)), q[:, [3, 0, 1, 2]]])
    sensors = np.hstack([motion.angular_velocity_b(t_s), specific_force_b(motion, t_s, 9.81)])
    sensors += rng.normal(0.0, 1.0, sensors.shape) * np.repeat([0.003, 0.03], 3)
    pose_names = "#timestamp [ns],p_x,p_y,p_z,q_w,q_x,q_y,q_z"
    names = "#timestamp [ns]," + ",".join(f"{s}_RS_S_{axis}" for s in "wa" for axis in "xyz")
    write(tmp_path / "poses.csv", pose_names, t_ns, poses)
    write(tmp_path / "imu.csv", names, t_ns, sensors)
    write(tmp_path / "degrees.csv", names, t_ns, sensors * np.repeat([57.29578, 1.0], 3))
    write(tmp_path / "turned.csv", names, t_ns, sensors[:, [1, 2, 0, 4, 5, 3]])
    write(tmp_path / "later.csv", names, t_ns + 10**12, sensors)
    write(tmp_path / "places.csv", "#timestamp [ns],p_x,p_y,p_z", t_ns, poses[:, :3])
    write(
        tmp_path / "fixed.csv", pose_names, t_ns, np.hstack([poses[:, :3], np.tile([1, 0, 0, 0], (800, 1))])
    )
    (tmp_path / "noise.yaml").write_text(NOISE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(file: Path, names: str, t_ns: np.ndarray, values: np.ndarray) -> None:
    lines = [f"{t},{','.join(map(repr, row))}" for t, row in zip(t_ns, values.tolist(), strict=True)]
    file.write_text("\n".join([names, *lines]) + "\n")


@pytest.mark.slow
def test_real_samples_are_kept_as_they_are(asyneio: Asyneio, files: Path) -> None:
    status, out, err = asyneio(
        *("simulate", "event_slow", "--poses", "poses.csv", "--samples", "imu.csv", "--imu", "noise.yaml"),
        *("--from", "1", "--duration", "0.3", "-o", "out", "--json"),
    )
    assert status == 0, err
    found = json.loads(out)
    left = found["path"]["left_over_rms"]
    assert left["gyroscope"] == pytest.approx(0.003, rel=0.2)
    assert left["accelerometer"] == pytest.approx(0.03, rel=0.2)
    assert left["position"] < 1e-3
    assert "residuals (RMS)" in err
    recording = open_recording(files / "out")
    assert isinstance(recording, EventRecording)
    assert recording.events.size == found["events"] > 1000
    real = read_inertial_file(files / "imu.csv")
    for written, stream in (
        (recording.gyroscope, real.gyroscope),
        (recording.accelerometer, real.accelerometer),
    ):
        inside = stream[(stream["t_ns"] >= START_NS + 10**9) & (stream["t_ns"] <= START_NS + 13 * 10**8)]
        np.testing.assert_array_equal(written, inside)
    assert recording.calibration is not None
    assert recording.calibration.noise.gyroscope_density == 2e-4
    assert recording.ground_truth is not None
    assert recording.ground_truth.t_ns[0] == START_NS + 10**9


@pytest.mark.slow
def test_poses_alone_get_a_simulated_imu(asyneio: Asyneio, files: Path) -> None:
    poses = ("simulate", "event_slow", "--poses", "poses.csv", "--duration", "0.1")
    status, _, err = asyneio(*poses, "-o", "out")
    assert status == 0, err
    recording = open_recording(files / "out")
    assert recording.gyroscope.size == 101


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--samples", "imu.csv"), "require --poses FILE"),
        (("--poses", "absent.csv"), "absent.csv"),
        (("--poses", "places.csv", "--samples", "imu.csv"), "unit quaternion"),
        (("--poses", "fixed.csv", "--samples", "imu.csv"), "orientation of the poses never changes"),
        (("--poses", "poses.csv", "--samples", "later.csv"), "less than 1 s in common"),
        (("--poses", "poses.csv", "--samples", "turned.csv"), "deg relative to the body of the poses"),
        (("--poses", "poses.csv", "--samples", "imu.csv", "--duration", "9"), "use a smaller offset"),
    ],
)
def test_what_does_not_fit_together(
    asyneio: Asyneio, files: Path, arguments: tuple[str, ...], message: str
) -> None:
    status, out, err = asyneio("simulate", "event_slow", *arguments, "-o", "out")
    assert (status, out) == (1, "")
    last = err.strip().splitlines()[-1]
    assert last.startswith("asyneio: ")
    assert message in last
    assert not (files / "out").exists()


def test_a_scenario_of_tracks_is_rejected(asyneio: Asyneio, files: Path) -> None:
    status, _, err = asyneio("simulate", "moderate", "--poses", "poses.csv", "-o", "out")
    assert status == 1
    assert "--poses requires a scenario of events" in err


@pytest.mark.slow
def test_degrees_are_converted_and_said(asyneio: Asyneio, files: Path) -> None:
    status, _, err = asyneio(
        *("simulate", "event_slow", "--poses", "poses.csv", "--samples", "degrees.csv", "--duration", "0.1"),
        *("-o", "out"),
    )
    assert status == 0, err
    assert "so it is in deg/s: converted to rad/s" in err
