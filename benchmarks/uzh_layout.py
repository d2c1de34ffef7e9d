"""Simulated sequences in the layouts of the UZH event camera data set: a folder, a zip, a bag.

Evidence: simulation. As in the data set, no file contains extrinsics or noise of the IMU, and the ground
truth is the pose of the camera. `asyneio bench uzh DIR` runs on these as on the real ones.

    python benchmarks/uzh_layout.py DIR [--seconds 10] [--cache DIR]
    asyneio bench uzh DIR
"""

from __future__ import annotations

import argparse
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.io import write_uzh_folder
from asyneio.io.ros.ros1_writer import write_rosbag
from asyneio.simulation import EventSimulation
from asyneio.types import NS_PER_S, EventRecording, PoseTrajectory, RecordArray
from sequences import DEFAULT_CACHE, sequence

#: Rate [Hz] of the motion capture.
_TRUTH_HZ = 200
#: Parts of each recording of the data set in addition to events.
_KALIBR = ("camchain-imucam.yaml", "imu.yaml")
_KINDS = {"boxes_6dof": "folder", "poster_6dof": "zip", "dynamic_6dof": "bag"}


def like_uzh(simulation: EventSimulation, name: str, seconds: float) -> EventRecording:
    """The first seconds of a sequence, with the ground truth of the camera in its clock."""
    recording = simulation.recording
    calibration = recording.calibration
    assert calibration is not None
    start_ns = simulation.truth.start_ns
    end_ns = start_ns + round(seconds * NS_PER_S)

    def first(records: RecordArray) -> RecordArray:
        return records[: np.searchsorted(records["t_ns"], end_ns)]

    t_ns = np.arange(start_ns, end_ns, NS_PER_S // _TRUTH_HZ)
    T_w_c = simulation.truth.at(t_ns).T_w_b @ calibration.T_b_c
    truth = PoseTrajectory(
        t_ns - calibration.timeshift_ns, T_w_c[:, :3, 3], Rotation.from_matrix(T_w_c[:, :3, :3]).as_quat()
    )
    return replace(
        recording,
        name=name,
        events=first(recording.events),
        gyroscope=first(recording.gyroscope),
        accelerometer=first(recording.accelerometer),
        ground_truth=truth,
    )


def write(recording: EventRecording, kind: str, folder: Path) -> None:
    """One sequence in one of the three layouts."""
    if kind == "bag":
        write_rosbag(recording, folder / f"{recording.name}.bag")
        return
    laid_out = folder / recording.name
    write_uzh_folder(recording, laid_out)
    for name in _KALIBR:
        (laid_out / name).unlink()
    if kind == "zip":
        with zipfile.ZipFile(folder / f"{recording.name}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(laid_out.iterdir()):
                archive.write(file, file.name)
        shutil.rmtree(laid_out)


def main() -> None:
    """Write the three sequences."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, kind in _KINDS.items():
        simulation = sequence(f"suite_{name}", 0, None, options.cache)
        write(like_uzh(simulation, name, options.seconds), kind, options.folder)
        print(f"{name}: {kind}")


if __name__ == "__main__":
    main()
