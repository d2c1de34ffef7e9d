"""Files of inertial samples and true poses beside events that come without."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.contents import ReadOptions, Samples, no_samples
from asyneio.io.inertial_text import read_inertial_file
from asyneio.io.truth_text import read_truth_file
from asyneio.types import PoseTrajectory

#: Looked for in this order: ours, UZH, TUM-VIE, EuRoC.
SAMPLE_FILES = ("imu.csv", "imu.txt", "imu_data.txt", "imu0/data.csv", "mav0/imu0/data.csv")
TRUTH_FILES = (
    "groundtruth.tum",
    "groundtruth.txt",
    "mocap_data.txt",
    "state_groundtruth_estimate0/data.csv",
    "mav0/state_groundtruth_estimate0/data.csv",
)


def samples_beside(folder: Path, options: ReadOptions, names: Sequence[str] = SAMPLE_FILES) -> Samples:
    """Samples of the file the user named, or else of the first of `names` that is in the folder, or none.

    Raises:
        RecordingError: the named file is not there, or one cannot be read as inertial samples.
    """
    if options.samples is not None:
        for path in (Path(options.samples), folder / options.samples):
            if path.is_file():
                return read_inertial_file(path)
        raise RecordingError(
            f"there is no file {options.samples} of inertial samples, here or in {folder}; expected one, as "
            "these events come without an IMU"
        )
    found = first_file(folder, names)
    return read_inertial_file(found) if found else no_samples(f"the IMU of {folder.name}")


def truth_beside(
    folder: Path, names: Sequence[str] = TRUTH_FILES
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """True poses of the first of `names` that is in the folder, and how they were read.

    Raises:
        RecordingError: the file cannot be read as poses.
    """
    found = first_file(folder, names)
    return read_truth_file(found) if found else (None, ())


def first_file(folder: Path, names: Sequence[str]) -> Path | None:
    """The first of the names that is a file in the folder."""
    return next((folder / name for name in names if (folder / name).is_file()), None)
