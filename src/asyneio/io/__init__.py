"""Files in and out: tracks folders, Kalibr calibrations, TUM trajectories, estimates without loss."""

from asyneio.io.estimates_file import read_estimates, to_trajectory, write_estimates
from asyneio.io.kalibr import read_calibration
from asyneio.io.kalibr_writer import write_camchain, write_imu_noise
from asyneio.io.tracks_folder import read_tracks_folder
from asyneio.io.tracks_writer import write_tracks_folder
from asyneio.io.tum import read_tum, write_tum

__all__ = [
    "read_calibration",
    "read_estimates",
    "read_tracks_folder",
    "read_tum",
    "to_trajectory",
    "write_camchain",
    "write_estimates",
    "write_imu_noise",
    "write_tracks_folder",
    "write_tum",
]
