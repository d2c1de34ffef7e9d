# SPDX-License-Identifier: Apache-2.0
"""MVSEC: two DAVIS346 on a drone, IMU at 1 kHz, motion capture (indoors)."""

from __future__ import annotations

from asyneio.studies.suites.data_set import DataSet, Location, PerSequence, TruthFrame
from asyneio.studies.suites.published import Published, by_sequence

COMPARED = ("indoor_flying1", "indoor_flying2", "indoor_flying3", "indoor_flying4")
_STEREO_DEVO = "Stereo-DEVO (arXiv 2509.08235), table II"
_ESVO2 = "ESVO2 (arXiv 2410.09374), table VI"


def _result(method: str, uses: str, ate_cm: tuple[float, ...], source: str = _STEREO_DEVO) -> Published:
    return Published(method, uses, by_sequence(COMPARED, ate_cm), "se3", source)


MVSEC = DataSet(
    name="mvsec",
    title="MVSEC indoor flying, left camera",
    sequences=COMPARED,
    locations=(Location("{name}_data.hdf5"), Location("{name}/{name}_data.hdf5")),
    calibration=PerSequence(("camchain-imucam.yaml", "camchain-imucam-indoor_flying.yaml")),
    imu=PerSequence(("imu.yaml",)),
    events="left",
    # cam1 is the right camera of the same size.
    camera="cam0",
    preset="DAVIS346",
    # The reader moves the poses of the camera to the IMU with the extrinsics.
    frame=TruthFrame.BODY,
    # Poses at 20 Hz.
    max_gap_s=0.15,
    protocols=("se3", "posyaw"),
    published=(
        _result("Stereo-DEVO (learned, GPU)", "E, stereo", (3.76, 8.00, 5.57, 4.57)),
        _result("ESVO2", "E+I, stereo", (7.63, 10.05, 7.35, 5.59), _ESVO2),
        _result("DEIO (learned, GPU)", "E+I", (7.52, 6.96, 29.75, 12.71)),
    ),
    sources=(
        "Zhu et al., The Multivehicle Stereo Event Camera Dataset, RA-L 2018, and "
        "daniilidis-group.github.io/mvsec: files, calibration in Kalibr's format",
    ),
    remark="Expected next to NAME_data.hdf5: NAME_gt.hdf5, and camchain-imucam-indoor_flying.yaml of the "
    "calibration "
    "archive. The noise of the IMU, if there is no imu.yaml, comes from the preset DAVIS346 (a data sheet).",
)
