# SPDX-License-Identifier: Apache-2.0
"""TUM-VIE: two event cameras of 1280 x 720 pixels, IMU at 200 Hz, motion capture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from asyneio.io.calibration.rigid_transform import read_quaternion_pose
from asyneio.io.calibration.values import mapping
from asyneio.io.calibration.yaml_json import load_mapping
from asyneio.studies.suites.data_set import DataSet, Location, PerSequence, TruthFrame
from asyneio.studies.suites.published import Published, by_sequence
from asyneio.types import Calibration, FloatArray

#: The sequences in the room of the motion capture, which cover it completely.
COMPARED = ("mocap-1d-trans", "mocap-3d-trans", "mocap-6dof", "mocap-desk", "mocap-desk2")
#: Recorded with calibration A; all others with B.
_WITH_A = (
    *(f"loop-floor{floor}" for floor in range(4)),
    "mocap-desk",
    "mocap-desk2",
    "skate-easy",
)
_SUPEREVENT = "SuperEvent (arXiv 2504.00139), table 4"
_STEREO_DEVO = "Stereo-DEVO (arXiv 2509.08235), table II"


def marker_pose(files: Sequence[Path], calibration: Calibration) -> FloatArray:
    """`T_b_m` (4,4) from `T_imu_marker` of `mocap-imu-calibration{A,B}.json`, markers to IMU.

    Raises:
        CalibrationError: the file is malformed.
    """
    (path,) = files
    section = mapping(load_mapping(path), "value0", path)
    T_b_m, _ = read_quaternion_pose(mapping(section, "T_imu_marker", path), "T_imu_marker", path)
    return T_b_m


def _by_setup(pattern: str) -> PerSequence:
    """Names of files of the two calibrations."""
    return PerSequence((pattern.format("B"),), dict.fromkeys(_WITH_A, (pattern.format("A"),)))


def _result(method: str, uses: str, ate_cm: tuple[float, ...], source: str = _SUPEREVENT) -> Published:
    return Published(method, uses, by_sequence(COMPARED, ate_cm), "se3", source)


TUM_VIE = DataSet(
    name="tum-vie",
    title="TUM-VIE, left event camera",
    sequences=(*COMPARED, "mocap-shake", "mocap-shake2"),
    locations=(
        Location("{name}-events_left.h5"),
        Location("{name}/{name}-events_left.h5"),
    ),
    calibration=_by_setup("camera-calibration{}.json"),
    # cam0 and cam1 are the frame cameras.
    camera="cam2",
    frame=TruthFrame.MARKERS,
    markers=_by_setup("mocap-imu-calibration{}.json"),
    marker_pose=marker_pose,
    protocols=("se3", "posyaw"),
    published=(
        _result("OKVIS2 + SuperEvent (learned keypoints)", "E+I, stereo", (0.44, 0.89, 0.43, 0.58, 0.41)),
        _result("DEIO (learned, GPU)", "E+I", (1.08, 1.12, 1.39, 1.41, 1.19)),
        _result("Stereo-DEVO (learned, GPU)", "E, stereo", (1.05, 1.26, 1.69, 2.44, 1.79), _STEREO_DEVO),
        _result("ESVO2", "E+I, stereo", (3.33, 7.26, 3.21, 6.16, 4.02)),
    ),
    sources=(
        "Klenk et al., TUM-VIE, IROS 2021 (arXiv 2108.07329), and cvg.cit.tum.de/data/datasets/"
        "visual-inertial-event-dataset: files, clocks, cameras",
        "robust-e-nerf, scripts/tum_vie_to_esim.py: which sequences use calibration A; T_imu_marker "
        "maps markers "
        "to the IMU",
    ),
    remark="Expected next to the recordings: camera-calibration{A,B}.json, "
    "mocap-imu-calibration{A,B}.json, and "
    "NAME-vi_gt_data with imu_data.txt and mocap_data.txt. If the calibration has no noise of the IMU: "
    "--imu.",
)
