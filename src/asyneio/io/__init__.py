"""Files in and out: tracks folders, event recordings, Kalibr calibrations, TUM trajectories, estimates."""

from asyneio.io.aedat2 import read_aedat2
from asyneio.io.estimates_file import read_estimates, to_trajectory, write_estimates
from asyneio.io.kalibr import read_calibration
from asyneio.io.kalibr_writer import write_camchain, write_imu_noise
from asyneio.io.tracks_folder import read_tracks_folder
from asyneio.io.tracks_writer import write_tracks_folder
from asyneio.io.tum import read_tum, write_tum
from asyneio.io.uzh_folder import read_uzh_folder

__all__ = [
    "read_aedat2",
    "read_calibration",
    "read_estimates",
    "read_tracks_folder",
    "read_tum",
    "read_uzh_folder",
    "to_trajectory",
    "write_camchain",
    "write_estimates",
    "write_imu_noise",
    "write_tracks_folder",
    "write_tum",
]
