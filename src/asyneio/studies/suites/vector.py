# SPDX-License-Identifier: Apache-2.0
"""VECtor: two event cameras of 640 x 480 pixels, IMU at 200 Hz, motion capture or lidar as ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asyneio.io.calibration.rigid_transform import check_rigid, inverse_rigid
from asyneio.io.calibration.values import mapping, numbers
from asyneio.io.calibration.yaml_json import load_mapping
from asyneio.studies.suites.data_set import DataSet, Location, PerSequence, TruthFrame
from asyneio.studies.suites.published import Published
from asyneio.types import Calibration, FloatArray

#: The sequences in the room of the motion capture.
COMPARED = (
    "board_slow",
    "corner_slow",
    "robot_normal",
    "robot_fast",
    "desk_normal",
    "desk_fast",
    "sofa_normal",
    "sofa_fast",
    "mountain_normal",
    "mountain_fast",
    "hdr_normal",
    "hdr_fast",
)
_ESVO2 = "ESVO2 (arXiv 2410.09374), table VI"
_STEREO_DEVO = "Stereo-DEVO (arXiv 2509.08235), table II"


def marker_pose(files: Sequence[Path], calibration: Calibration) -> FloatArray:
    """`T_b_m` (4,4) from two files of the data set and the extrinsics of the event camera.

    `camera_mocap_extrinsic_results1.yaml` has `T_cam_body` of cam0, the left frame camera, from the markers;
    `small_scale_joint_camera_extrinsic_results.yaml` has `T_cam0_cam2` from the left event camera.

    Raises:
        CalibrationError: a file is malformed.
    """
    mocap, cameras = files
    T_0_m = _flat(mapping(load_mapping(mocap), "cam0", mocap), "T_cam_body", mocap)
    T_0_c = _flat(mapping(load_mapping(cameras), "cam2", cameras), "T_cam0_cam2", cameras)
    return np.asarray(calibration.T_b_c @ inverse_rigid(T_0_c) @ T_0_m)


def _flat(section: dict[str, Any], key: str, path: Path) -> FloatArray:
    """A transform (4,4) of sixteen numbers, row by row. Raises CalibrationError."""
    T = np.array(numbers(section, key, 16, path)).reshape(4, 4)
    return check_rigid(T[:3, :3], T[:3, 3], key, path)[0]


VECTOR = DataSet(
    name="vector",
    title="VECtor, left event camera",
    sequences=COMPARED,
    # The number counts repetitions; only the first was published.
    locations=(
        Location("{name}1.synced.left_event.hdf5"),
        Location("{name}/{name}1.synced.left_event.hdf5"),
        Location("{name}1/{name}1.synced.left_event.hdf5"),
    ),
    calibration=PerSequence(("camchain-imucam.yaml",)),
    imu=PerSequence(("imu.yaml",)),
    camera="cam0",
    frame=TruthFrame.MARKERS,
    markers=PerSequence(
        ("camera_mocap_extrinsic_results1.yaml", "small_scale_joint_camera_extrinsic_results.yaml")
    ),
    marker_pose=marker_pose,
    protocols=("se3", "posyaw"),
    published=(
        Published(
            "Stereo-DEVO (learned, GPU)",
            "E, stereo",
            {
                "robot_normal": 3.16,
                "corner_slow": 1.06,
                "hdr_normal": 6.71,
                "sofa_normal": 7.18,
                "desk_normal": 6.48,
            },
            "se3",
            _STEREO_DEVO,
        ),
        Published(
            "ESVO2",
            "E+I, stereo",
            {
                "robot_normal": 4.81,
                "robot_fast": 24.18,
                "corner_slow": 2.15,
                "hdr_normal": 13.53,
                "sofa_normal": 40.28,
                "desk_normal": 16.47,
            },
            "se3",
            _ESVO2,
        ),
        Published(
            "DEIO (learned, GPU)", "E+I", {"corner_slow": 10.70, "desk_normal": 254.76}, "se3", _STEREO_DEVO
        ),
    ),
    sources=(
        "Gao et al., VECtor, RA-L 2022, and star-datasets.github.io/vector: files",
        "mpl_calibration_toolbox, camera_mocap hand-eye calibration: T_cam_body maps the markers to the "
        "camera",
    ),
    remark="The data set publishes its calibration in files of its own: write intrinsics, extrinsics "
    "and IMU noise "
    "of the left event camera as Kalibr's camchain-imucam.yaml (cam0) and imu.yaml. Expected in the "
    "same folder: "
    "camera_mocap_extrinsic_results1.yaml and small_scale_joint_camera_extrinsic_results.yaml.",
)
