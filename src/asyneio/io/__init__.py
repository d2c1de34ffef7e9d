# SPDX-License-Identifier: Apache-2.0
"""Readers and writers: event recordings, tracks folders, calibrations, trajectories, estimates."""

from asyneio.io.calibration import read_calibration
from asyneio.io.calibration.kalibr_writer import write_camchain, write_imu_noise
from asyneio.io.hdf5.asyneio_writer import write_events_hdf5
from asyneio.io.open_recording import open_recording
from asyneio.io.recording.contents import ReadOptions
from asyneio.io.recording.inertial_reader import read_inertial_file
from asyneio.io.recording.trajectory_reader import read_trajectory
from asyneio.io.recording.tum import write_tum
from asyneio.io.results.estimates import read_estimates, to_trajectory, write_estimates
from asyneio.io.results.live_poses import read_live_poses
from asyneio.io.results.velocities import read_moving_poses
from asyneio.io.tracks.reader import read_tracks_folder
from asyneio.io.tracks.writer import write_tracks_folder
from asyneio.io.uzh.writer import write_uzh_folder

__all__ = [
    "ReadOptions",
    "open_recording",
    "read_calibration",
    "read_estimates",
    "read_inertial_file",
    "read_live_poses",
    "read_moving_poses",
    "read_tracks_folder",
    "read_trajectory",
    "to_trajectory",
    "write_camchain",
    "write_estimates",
    "write_events_hdf5",
    "write_imu_noise",
    "write_tracks_folder",
    "write_tum",
    "write_uzh_folder",
]
