"""Calibration files: read in every usual kind, written in Kalibr's."""

from asyneio.io.calibration.files import CAMCHAIN_FILE as CAMCHAIN_FILE
from asyneio.io.calibration.files import IMU_FILE as IMU_FILE
from asyneio.io.calibration.files import find_rig as find_rig
from asyneio.io.calibration.files import open_calibration as open_calibration
from asyneio.io.calibration.files import parse_calibration as parse_calibration
from asyneio.io.calibration.files import read_calibration as read_calibration
from asyneio.io.calibration.files import read_imu_noise as read_imu_noise
from asyneio.io.calibration.files import rig_of as rig_of
from asyneio.io.calibration.resolve import Rig as Rig
from asyneio.io.calibration.resolve import Wanted as Wanted
from asyneio.io.calibration.resolve import require_calibration as require_calibration
from asyneio.io.calibration.resolve import settle as settle
