"""M3ED."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from asyneio.io import write_imu_noise
from tests.io.hdf5.layouts import assert_events, poses, read, whole_us, write_m3ed
from tests.io.recordings import make_calibration


def test_m3ed(tmp_path: Path, rng: np.random.Generator) -> None:
    events = whole_us(rng, scale=4)
    T_left_imu, T_left_right = poses(rng, 2)
    path = tmp_path / "falcon_indoor_flight_1_data.h5"
    write_m3ed(path, events, T_left_imu, T_left_right)
    T_c_w = poses(rng, 40)
    with h5py.File(tmp_path / "falcon_indoor_flight_1_pose_gt.h5", "w") as file:
        file["Cn_T_C0"], file["Ln_T_L0"], file["ts"] = T_c_w, T_c_w, np.arange(40) * 50_000.0
    found = read(tmp_path)
    assert_events(found, events)
    assert found.gyroscope.size == found.accelerometer.size == 796
    assert any("ignored 4 of 800 rows" in note for note in found.notes)
    assert found.camera is not None
    assert (found.camera.fx, found.camera.width, found.camera.coefficients[0]) == (1034.0, 1280, -0.09)
    assert found.calibration is None
    assert found.ground_truth is not None
    centres = np.linalg.inv(T_c_w)[:, :3, 3]
    np.testing.assert_allclose(found.ground_truth.position, centres, atol=1e-12)
    write_imu_noise(tmp_path / "imu.yaml", make_calibration().noise)
    for side, T_left_camera in (("left", np.eye(4)), ("right", T_left_right)):
        full = read(path, events=side)
        assert full.calibration is not None
        T_b_c = np.linalg.inv(T_left_imu) @ T_left_camera
        np.testing.assert_allclose(full.calibration.T_b_c, T_b_c, atol=1e-12)
    moved = read(path, events="left").ground_truth
    assert moved is not None
    T_w_b = np.linalg.inv(T_c_w) @ T_left_imu
    np.testing.assert_allclose(moved.position, T_w_b[:, :3, 3], atol=1e-12)
