# SPDX-License-Identifier: Apache-2.0
"""DSEC: two event cameras of 640 x 480 pixels on a car."""

from __future__ import annotations

from asyneio.studies.suites.data_set import DataSet, Location, PerSequence, TruthFrame
from asyneio.studies.suites.published import Published

_ESVO2 = "ESVO2 (arXiv 2410.09374), table VI"
_STEREO_DEVO = "Stereo-DEVO (arXiv 2509.08235), table II"

DSEC = DataSet(
    name="dsec",
    title="DSEC, left event camera",
    sequences=tuple(f"zurich_city_04_{part}" for part in "abcdef"),
    locations=(Location("{name}", "{name}/events/left/events.h5"),),
    calibration=PerSequence(("{name}/camchain-imucam.yaml", "camchain-imucam.yaml")),
    imu=PerSequence(("{name}/imu.yaml", "imu.yaml")),
    truth=PerSequence(("{name}/groundtruth.txt", "{name}/groundtruth.tum")),
    samples=PerSequence(("{name}/imu.csv",)),
    events="left",
    camera="cam0",
    frame=TruthFrame.CAMERA,
    # Poses at 5 Hz.
    max_gap_s=0.3,
    protocols=("se3", "posyaw"),
    published=(
        Published(
            "Stereo-DEVO (learned, GPU)",
            "E, stereo",
            {
                "zurich_city_04_a": 96.86,
                "zurich_city_04_b": 17.65,
                "zurich_city_04_c": 481.62,
                "zurich_city_04_d": 406.20,
            },
            "se3",
            _STEREO_DEVO,
        ),
        Published(
            "ESVO2",
            "E+I, stereo",
            {
                "zurich_city_04_a": 56.17,
                "zurich_city_04_b": 73.83,
                "zurich_city_04_c": 508.71,
                "zurich_city_04_d": 546.58,
                "zurich_city_04_e": 52.94,
                "zurich_city_04_f": 257.75,
            },
            "se3",
            _ESVO2,
        ),
    ),
    sources=(
        "Gehrig et al., DSEC, RA-L 2021, and dsec.ifi.uzh.ch: files of events",
        "github.com/NAIL-HNU/ESVO2, results/gt/dsec: poses of the left camera in the clock of the events",
    ),
    remark="DSEC publishes neither poses nor extrinsics of the IMU, and its samples only in "
    "lidar_imu.zip. Expected "
    "in the folder of each sequence: imu.csv (samples in the clock of the events), groundtruth.txt "
    "(TUM; such as "
    "those that ESVO2 publishes), and Kalibr's camchain-imucam.yaml (cam0: the left event camera) and "
    "imu.yaml (there or above).",
)
