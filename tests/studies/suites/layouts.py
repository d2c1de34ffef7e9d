"""Tiny recordings in the layout of each data set.

The body moves on a curved path, and the ground truth is that of the frame whose poses the data set publishes.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.io import write_uzh_folder
from asyneio.types import (
    NS_PER_S,
    Calibration,
    CameraIntrinsics,
    Distortion,
    Estimate,
    FloatArray,
    IntArray,
    Packet,
    PoseTrajectory,
    StepReport,
)
from tests.cli.fakes import FakeOdometry
from tests.io.calibration.rigs import RATE_HZ, _kalibr_camera, _kalibr_noise, _rows, make_rig
from tests.io.event_recordings import make_event_recording, make_events
from tests.io.hdf5.layouts import EPOCH_US, write_columns, write_lines, write_mvsec
from tests.io.recordings import START_NS, make_estimate, make_stream
from tests.io.ros.bags import recording_records, write_bag

SECONDS = 4.0
GRAVITY = (0.0, 0.0, 9.81)


def body_pose(t_s: FloatArray) -> FloatArray:
    """Poses (N,4,4) of the body: 0.5 m/s along a sine, turning about z at 0.2 rad/s and nodding."""
    T = np.tile(np.eye(4), (t_s.size, 1, 1))
    angles = np.column_stack([0.2 * t_s, 0.3 * np.sin(t_s), np.zeros_like(t_s)])
    T[:, :3, :3] = Rotation.from_euler("zyx", angles).as_matrix()
    T[:, :3, 3] = np.column_stack([0.5 * t_s, 0.3 * np.sin(2.0 * t_s), 0.1 * np.cos(3.0 * t_s)])
    return T


class CurvedOdometry(FakeOdometry):
    """Estimates on the path, a millimetre beside it; `origin_ns` is the time at which the path begins."""

    origin_ns = START_NS

    def track(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        _, report = super().track(packet)
        step_s = 1e-4
        t_s = (packet.t_end_ns - self.origin_ns) / NS_PER_S
        before, T_w_b, after = body_pose(t_s + step_s * np.array([-1.0, 0.0, 1.0]))
        turn = Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).as_rotvec()
        T_w_b[:3, 3] += 1e-3 * self._rng.standard_normal(3)
        estimate = replace(
            make_estimate(packet.t_end_ns),
            T_w_b=T_w_b,
            velocity_w=(after[:3, 3] - before[:3, 3]) / (2.0 * step_s),
            angular_velocity_b=turn / (2.0 * step_s),
        )
        return [estimate], report


class FromZero(CurvedOdometry):
    """The same for a data set whose clock begins at zero."""

    origin_ns = 0


def poses(rate_hz: float, T_b_m: FloatArray, shift_ns: int = 0, start_ns: int = START_NS) -> PoseTrajectory:
    """Ground truth of the frame m, in a clock that is behind that of the body by `shift_ns`."""
    t_s = np.arange(int(SECONDS * rate_hz)) / rate_hz
    T = body_pose(t_s) @ T_b_m
    t_ns: IntArray = start_ns + np.rint(t_s * NS_PER_S).astype(np.int64) - shift_ns
    return PoseTrajectory(t_ns, T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat())


def rows_of(path: PoseTrajectory, unit_ns: int = NS_PER_S) -> list[tuple[object, ...]]:
    """Lines `t x y z qx qy qz qw`."""
    return [
        (f"{t / unit_ns:.9f}" if unit_ns == NS_PER_S else f"{t / unit_ns:.3f}", *p, *q)
        for t, p, q in zip(path.t_ns.tolist(), path.position.tolist(), path.quaternion.tolist(), strict=True)
    ]


def rig(width: int, height: int) -> Calibration:
    """A rig with a rotated camera half a metre away, so that a wrong frame is noticed."""
    found = make_rig(Distortion.NONE, translation=(0.3, -0.2, 0.35), shift_ns=2_000_000)
    camera = CameraIntrinsics(300.0, 300.0, width / 2, height / 2, width, height, Distortion.NONE, ())
    return replace(found, camera=camera)


def write_kalibr(folder: Path, calibration: Calibration, camera: str = "camchain-imucam.yaml") -> None:
    """Kalibr's two files, with a second camera of the same size."""
    folder.mkdir(parents=True, exist_ok=True)
    T_c_b = np.linalg.inv(calibration.T_b_c)
    T_c_b[3] = [0.0, 0.0, 0.0, 1.0]
    entry = _kalibr_camera(calibration, f"  T_cam_imu:\n{_rows(T_c_b)}")
    (folder / camera).write_text(f"cam0:\n{entry}cam1:\n{entry.replace('/dvs/', '/other/')}")
    noise = camera.replace("camchain-imucam", "imu").replace("_cam.", "_imu.")
    (folder / noise).write_text(_kalibr_noise(calibration))


MARKERS = np.eye(4)
MARKERS[:3, :3] = Rotation.from_rotvec([0.2, -0.4, 0.9]).as_matrix()
MARKERS[:3, 3] = [-0.4, 0.1, 0.25]


@dataclass(frozen=True)
class Layout:
    """How a data set is written: sequence, function of the folder, estimator that fits its clock."""

    sequence: str
    write: Callable[[Path, np.random.Generator], None]
    odometry: type[CurvedOdometry] = CurvedOdometry


def _uzh(folder: Path, rng: np.random.Generator) -> None:
    calibration = rig(240, 180)
    recording = replace(
        make_event_recording(rng),
        events=make_events(rng, 3000, SECONDS),
        gyroscope=make_stream(rng, 200.0, SECONDS, [0.1, 0.0, -0.2]),
        accelerometer=make_stream(rng, 200.0, SECONDS, list(GRAVITY)),
        calibration=calibration,
        camera=calibration.camera,
        ground_truth=poses(100.0, calibration.T_b_c, calibration.timeshift_ns),
    )
    write_uzh_folder(recording, folder / "boxes_6dof")


def _tum_vie(folder: Path, rng: np.random.Generator) -> None:
    calibration = rig(1280, 720)
    events = make_events(rng, 3000, SECONDS)
    events["t_ns"] = (events["t_ns"] - START_NS) // 1000 * 1000
    write_columns(folder / "mocap-6dof-events_left.h5", events)
    write_columns(folder / "mocap-6dof-events_right.h5", events)
    data = folder / "mocap-6dof-vi_gt_data"
    rows = [(f"{5000 * k:.3f}", 0.0, 0.0, 0.3, *GRAVITY, 25.0) for k in range(int(200 * SECONDS))]
    write_lines(data / "imu_data.txt", "# timestamp[us] gx gy gz ax ay az temperature\n", rows)
    truth = poses(120.0, MARKERS, start_ns=0)
    header = "# timestamp[us] px py pz qx qy qz qw\n"
    write_lines(data / "mocap_data.txt", header, rows_of(truth, 1000))
    noise = calibration.noise
    lens = {"fx": 300.0, "fy": 300.0, "cx": 640.0, "cy": 360.0}
    frame = {"camera_type": "pinhole", "intrinsics": lens}
    other = {**_quaternion_pose(calibration.T_b_c), "px": 1.0}
    content = {
        "T_imu_cam": [other, other, _quaternion_pose(calibration.T_b_c), other],
        "intrinsics": [frame] * 4,
        "resolution": [[1024, 1024]] * 2 + [[1280, 720]] * 2,
        "imu_update_rate": RATE_HZ,
        "accel_noise_std": [noise.accelerometer_density] * 3,
        "gyro_noise_std": [noise.gyroscope_density] * 3,
        "accel_bias_std": [noise.accelerometer_walk] * 3,
        "gyro_bias_std": [noise.gyroscope_walk] * 3,
        "cam_time_offset_ns": 0,
    }
    (folder / "camera-calibrationB.json").write_text(json.dumps({"value0": content}))
    markers = {"T_imu_marker": _quaternion_pose(MARKERS)}
    (folder / "mocap-imu-calibrationB.json").write_text(json.dumps({"value0": markers}))


def _quaternion_pose(T: FloatArray) -> dict[str, float]:
    q = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    values = [*T[:3, 3].tolist(), *q]
    return dict(zip(("px", "py", "pz", "qx", "qy", "qz", "qw"), values, strict=True))


def _vector(folder: Path, rng: np.random.Generator) -> None:
    calibration = rig(640, 480)
    events = make_events(rng, 3000, SECONDS)
    events["t_ns"] = (events["t_ns"] - START_NS) // 1000 * 1000
    data = folder / "desk_normal"
    write_columns(data / "desk_normal1.synced.left_event.hdf5", events, EPOCH_US)
    samples = [
        (f"{(START_NS + k * 5_000_000) / NS_PER_S:.9f}", 0.0, 0.0, 0.3, *GRAVITY)
        for k in range(int(200 * SECONDS))
    ]
    write_lines(data / "desk_normal1.synced.imu.txt", "# timestamp gx gy gz ax ay az\n", samples)
    header = "# timestamp px py pz qx qy qz qw\n"
    write_lines(data / "desk_normal1.synced.gt.txt", header, rows_of(poses(120.0, MARKERS)))
    write_kalibr(folder, calibration)
    T_0_c = np.eye(4)
    T_0_c[:3, 3] = [0.11, 0.02, -0.03]
    T_0_m = T_0_c @ np.linalg.inv(calibration.T_b_c) @ MARKERS
    for name, camera, key, T in (
        ("camera_mocap_extrinsic_results1.yaml", "cam0", "T_cam_body", T_0_m),
        ("small_scale_joint_camera_extrinsic_results.yaml", "cam2", "T_cam0_cam2", T_0_c),
    ):
        numbers = ", ".join(map(repr, T.ravel().tolist()))
        (folder / name).write_text(f"{camera}:\n  {key}: [{numbers}]\n")


def _mvsec(folder: Path, rng: np.random.Generator) -> None:
    calibration = rig(346, 260)
    folder.mkdir(parents=True)
    events = make_events(rng, 3000, SECONDS)
    data = folder / "indoor_flying1_data.hdf5"
    write_mvsec(data, events, rows=int(200 * SECONDS))
    with h5py.File(data, "r+") as file:
        # Gravity stays on one axis: the sensor turns about it.
        file["davis/left/imu"][:, 3:5] = 0.0
    truth = poses(20.0, calibration.T_b_c, calibration.timeshift_ns)
    T = np.tile(np.eye(4), (truth.t_ns.size, 1, 1))
    T[:, :3, :3] = Rotation.from_quat(truth.quaternion).as_matrix()
    T[:, :3, 3] = truth.position
    with h5py.File(folder / "indoor_flying1_gt.hdf5", "w") as file:
        file["davis/left/pose"], file["davis/left/pose_ts"] = T, truth.t_ns / NS_PER_S
    write_kalibr(folder, calibration, "camchain-imucam-indoor_flying.yaml")
    # The data set has no noise: that of the preset.
    (folder / "imu-indoor_flying.yaml").unlink()


def _dsec(folder: Path, rng: np.random.Generator) -> None:
    calibration = rig(640, 480)
    root = folder / "zurich_city_04_a"
    events = make_events(rng, 3000, SECONDS)
    events["t_ns"] = (events["t_ns"] - START_NS) // 1000 * 1000
    for side in ("left", "right"):
        write_columns(root / "events" / side / "events.h5", events, EPOCH_US)
    samples = [(START_NS + k * 5_000_000, 0.0, 0.0, 0.3, *GRAVITY) for k in range(int(200 * SECONDS))]
    lines = "".join(",".join(map(str, row)) + "\n" for row in samples)
    (root / "imu.csv").write_text("t_ns,gx,gy,gz,ax,ay,az\n" + lines)
    # At the rate of the poses that others publish; their path is straight between them.
    truth = poses(20.0, calibration.T_b_c, calibration.timeshift_ns)
    write_lines(root / "groundtruth.txt", "", rows_of(truth))
    write_kalibr(root, calibration)


def _evslam(folder: Path, rng: np.random.Generator) -> None:
    calibration = rig(640, 480)
    recording = replace(
        make_event_recording(rng),
        events=make_events(rng, 3000, SECONDS),
        width=640,
        height=480,
        gyroscope=make_stream(rng, 200.0, SECONDS, [0.1, 0.0, -0.2]),
        accelerometer=make_stream(rng, 200.0, SECONDS, list(GRAVITY)),
        ground_truth=None,
    )
    left = [
        replace(record, topic=record.topic.replace("/dvs/", "/dvxplorer_left/"))
        for record in recording_records(recording)
    ]
    right = [
        replace(record, topic=record.topic.replace("left", "right"))
        for record in left
        if record.topic.endswith("events")
    ]
    (folder / "rosbag").mkdir(parents=True)
    write_bag(folder / "rosbag" / "arm_hdr.bag", 1, sorted(left + right, key=lambda r: r.logged_ns))
    write_kalibr(folder / "calibration", calibration, "calib_results_cam.yaml")
    truth = poses(100.0, calibration.T_b_c, calibration.timeshift_ns)
    (folder / "groundtruth").mkdir()
    write_lines(folder / "groundtruth" / "arm_hdr.tum", "", rows_of(truth))


LAYOUTS = {
    "uzh": Layout("boxes_6dof", _uzh),
    "tum-vie": Layout("mocap-6dof", _tum_vie, FromZero),
    "vector": Layout("desk_normal", _vector),
    "mvsec": Layout("indoor_flying1", _mvsec),
    "dsec": Layout("zurich_city_04_a", _dsec),
    "evslam": Layout("arm_hdr", _evslam),
}
