# SPDX-License-Identifier: Apache-2.0
"""Write a recording as a tracks folder; reading it back gives identical numbers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from asyneio.io.calibration.kalibr_writer import write_camchain, write_imu_noise
from asyneio.io.parsing.atomic import write_text
from asyneio.io.recording.tum import write_tum
from asyneio.types import RecordArray, Recording


def write_tracks_folder(recording: Recording, path: Path) -> None:
    """Write tracks, inertial samples, calibration and ground truth (if any), each file atomically.

    Gyroscope and accelerometer share `imu.csv` if their stamps are equal, otherwise each has its own file.
    Files of an earlier call in the other layout, and an old ground truth, are removed. `tracks.csv`, by which
    a tracks folder is recognized, is the last file: a folder that could not be completed has none.

    Raises:
        RecordingError: a file cannot be written.
    """
    observations = recording.observations
    (path / "tracks.csv").unlink(missing_ok=True)
    _write_inertial(path, recording.gyroscope, recording.accelerometer)
    write_camchain(path / "camchain-imucam.yaml", recording.calibration)
    write_imu_noise(path / "imu.yaml", recording.calibration.noise)
    if recording.ground_truth is None:
        (path / "groundtruth.tum").unlink(missing_ok=True)
    else:
        write_tum(path / "groundtruth.tum", recording.ground_truth)
    write_csv(
        path / "tracks.csv",
        "t_ns,id,u,v",
        (
            (observations["t_ns"] - recording.calibration.timeshift_ns).tolist(),
            observations["id"].tolist(),
            observations["u"].tolist(),
            observations["v"].tolist(),
        ),
    )


def write_csv(path: Path, header: str, columns: Iterable[list[int] | list[float]]) -> None:
    """Write columns of equal length under a header; floats in the shortest exact form."""
    rows = zip(*columns, strict=True)
    write_text(path, "\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n")


def _write_inertial(path: Path, gyroscope: RecordArray, accelerometer: RecordArray) -> None:
    combined, separate = path / "imu.csv", (path / "gyroscope.csv", path / "accelerometer.csv")
    gyro, accel = _columns(gyroscope), _columns(accelerometer)
    if np.array_equal(gyroscope["t_ns"], accelerometer["t_ns"]):
        write_csv(combined, "t_ns,gx,gy,gz,ax,ay,az", (*gyro, *accel[1:]))
        stale: tuple[Path, ...] = separate
    else:
        write_csv(separate[0], "t_ns,gx,gy,gz", gyro)
        write_csv(separate[1], "t_ns,ax,ay,az", accel)
        stale = (combined,)
    for old in stale:
        old.unlink(missing_ok=True)


def _columns(stream: RecordArray) -> list[list[int] | list[float]]:
    return [stream["t_ns"].tolist(), *(stream["xyz"][:, axis].tolist() for axis in range(3))]
