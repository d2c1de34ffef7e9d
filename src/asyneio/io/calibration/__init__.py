# SPDX-License-Identifier: Apache-2.0
"""Calibration files: every common format is read, Kalibr's is written."""

from asyneio.io.calibration.files import CAMCHAIN_FILE as CAMCHAIN_FILE
from asyneio.io.calibration.files import IMU_FILE as IMU_FILE
from asyneio.io.calibration.files import find_calibration as find_calibration
from asyneio.io.calibration.files import open_calibration as open_calibration
from asyneio.io.calibration.files import parse_calibration as parse_calibration
from asyneio.io.calibration.files import read_calibration as read_calibration
from asyneio.io.calibration.files import read_imu_noise as read_imu_noise
from asyneio.io.calibration.files import sources_of as sources_of
from asyneio.io.calibration.resolve import CalibrationSelection as CalibrationSelection
from asyneio.io.calibration.resolve import CalibrationSources as CalibrationSources
from asyneio.io.calibration.resolve import IncompleteCalibration as IncompleteCalibration
from asyneio.io.calibration.resolve import require_calibration as require_calibration
