# SPDX-License-Identifier: Apache-2.0
"""EvSLAM: two DVXplorer of 640 x 480 pixels on a drone, an arm, a slider and a car; motion capture."""

from __future__ import annotations

from asyneio.studies.suites.data_set import DataSet, Location, PerSequence, TruthFrame

EVSLAM = DataSet(
    name="evslam",
    title="EvSLAM, left event camera",
    # The nine sequences of the benchmark.
    sequences=(
        "drone_circle_fast",
        "drone_line_fast",
        "drone_8_hdr",
        "drone_s_hdr",
        "drone_rot_norm",
        "drone_rot_fast",
        "slider_hdr",
        "arm_hdr",
        "car_circle_hdr",
    ),
    locations=(Location("rosbag/{name}.bag"), Location("{name}.bag")),
    calibration=PerSequence(
        (
            "calibration/calib_results_cam.yaml",
            "calibration/calib_results_cam.txt",
            "calib_results_cam.yaml",
        )
    ),
    imu=PerSequence(
        (
            "calibration/calib_results_imu.yaml",
            "calibration/calib_results_imu.txt",
            "calib_results_imu.yaml",
        )
    ),
    truth=PerSequence(("groundtruth/{name}.tum", "ground_truth/{name}_gt.txt", "groundtruth/{name}_gt.txt")),
    events="/dvxplorer_left/events",
    inertial="/dvxplorer_left/imu",
    camera="cam0",
    frame=TruthFrame.CAMERA,
    # Reference poses at 10 Hz.
    max_gap_s=0.15,
    protocols=("evslam", "posyaw"),
    sources=(
        "Zhong et al., Event-based SLAM Benchmark for High-Speed Maneuvers (arXiv 2604.24033), and "
        "nail-hnu.github.io/EvSLAM_Dataset: files, topics, calibration in Kalibr's format",
        "github.com/NAIL-HNU/EvSLAM_Dataset, evaluation/: the nine sequences, poses and velocities of "
        "the camera",
    ),
    remark="Where the ground truth has no velocities (eleven columns), they are differences of its "
    "positions.",
)
