# SPDX-License-Identifier: Apache-2.0
"""UZH event camera data set (DAVIS240C): 240 x 180 pixels, IMU at 1 kHz, motion capture."""

from __future__ import annotations

from asyneio.studies.suites.data_set import DataSet, Location, TruthFrame
from asyneio.studies.suites.published import Measure, Published, by_sequence

#: The eight sequences commonly used for comparisons, in the order of the tables.
COMPARED = (
    "boxes_translation",
    "hdr_boxes",
    "boxes_6dof",
    "dynamic_translation",
    "dynamic_6dof",
    "poster_translation",
    "hdr_poster",
    "poster_6dof",
)


def _result(method: str, uses: str, mpe_percent: tuple[float, ...], alignment: str = "") -> Published:
    return Published(method, uses, by_sequence(COMPARED, mpe_percent), alignment, "the method's own paper")


PUBLISHED = (
    _result("Zhu 2017 (EVIO)", "E+I", (2.69, 1.23, 3.61, 1.90, 4.07, 0.94, 2.63, 3.56)),
    _result("Rebecq 2017", "E+I", (0.57, 0.92, 0.69, 0.47, 0.54, 0.89, 0.59, 0.82)),
    _result("Ultimate SLAM 2018", "E+I", (0.76, 0.67, 0.44, 0.59, 0.38, 0.15, 0.49, 0.30), "uslam"),
    _result(
        "Ultimate SLAM, one parameter set, zero bias start",
        "E+F+I",
        (1.12, 1.01, 0.68, 0.63, 0.76, 0.24, 1.48, 0.59),
        "uslam",
    ),
    _result("HASTE-VIO", "E+I", (2.55, 1.75, 2.03, 1.32, 0.52, 1.34, 0.57, 1.50), "uslam"),
    _result("EKLT-VIO 2022", "E+F+I", (0.48, 0.46, 0.84, 0.40, 0.79, 0.35, 0.65, 0.35), "uslam"),
    _result("Dai 2022", "E+I", (1.0, 1.8, 1.5, 0.9, 1.5, 1.9, 2.8, 1.2)),
    _result("Mono-EIO 2022", "E+I", (0.34, 0.40, 0.61, 0.26, 0.43, 0.40, 0.40, 0.26), "hku"),
    _result("Tang 2024", "E+I", (0.36, 0.31, 0.32, 0.59, 0.49, 0.23, 0.18, 0.31)),
    _result("PL-EVIO 2023", "E+F+I", (0.06, 0.10, 0.21, 0.24, 0.48, 0.54, 0.12, 0.14), "hku"),
    _result("EVI-SAM 2024", "E+F+I", (0.11, 0.13, 0.16, 0.30, 0.27, 0.34, 0.15, 0.24), "hku"),
    _result("DEVO 2024 (learned, GPU)", "E", (0.06, 0.06, 0.71, 0.09, 0.08, 0.06, 0.14, 0.44), "sim3"),
    _result(
        "DEIO 2025 (learned, GPU)",
        "E+I",
        (0.07, 0.09, 0.05, 0.06, 0.04, 0.04, 0.06, 0.08),
        "scale fitted over most of the run",
    ),
)

UZH = DataSet(
    name="uzh",
    title="UZH event camera data set, DAVIS240C",
    # Those with translation and with ground truth over their whole duration.
    sequences=(*COMPARED, "shapes_translation", "shapes_6dof"),
    locations=(
        Location("{name}", "{name}/events.txt"),
        Location("{name}.bag"),
        Location("{name}.zip"),
    ),
    preset="DAVIS240C",
    frame=TruthFrame.CAMERA,
    protocols=("posyaw", "uslam", "hku"),
    measure=Measure.MPE,
    published=PUBLISHED,
    sources=(
        "Mueggler et al., The Event-Camera Dataset and Simulator, IJRR 2017: files, ground truth of the "
        "camera",
        "Ultimate SLAM, calibration/DAVIS-IJRR17.yaml and ijrr17.launch: extrinsics, time shift",
    ),
    remark="The data set contains neither extrinsics nor IMU noise: they come from the preset DAVIS240C.",
)
