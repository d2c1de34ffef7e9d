# SPDX-License-Identifier: Apache-2.0
"""Whether the clocks of camera and IMU differ by more than a run corrected.

The estimator corrects offsets of some milliseconds. A larger one ends in a trajectory that is wrong by
metres, or in none. The rotation in the tracks is therefore compared with the gyroscope as in the doctor.
"""

from __future__ import annotations

import numpy as np

from asyneio.inertial.stationarity import possible
from asyneio.rotation.alignment import OFFSET_OBSERVABLE_S, align
from asyneio.rotation.camera_rates import rates_from_tracks
from asyneio.rotation.clock_rate import find_clock_rate
from asyneio.rotation.time_offset import clock_fix
from asyneio.types import NS_PER_S, Calibration, CalibrationEstimate, RecordArray

#: Part of the recording that is compared, at its end.
_SPAN_NS = 30 * NS_PER_S
#: Offset [s] that is reported, and standard deviations that it must exceed.
_LEAST_S, _SIGMAS = 0.01, 5.0
#: Fraction of the camera's rotation that the gyroscope must explain.
_EXPLAINED = 0.6


def contradicted_clock(
    found: CalibrationEstimate | None,
    calibration: Calibration,
    gyroscope: RecordArray,
    observations: RecordArray,
) -> str:
    """What is wrong with the time offset or the rate of the clocks, as a phrase; empty if nothing is.

    Args:
        found: calibration as estimated at the end of a run; None if it did not end in a segment.
        calibration: as given to the run.
        gyroscope: samples (INERTIAL_DTYPE), ascending.
        observations: tracks (OBSERVATION_DTYPE, IMU clock), ascending.
    """
    if observations.size == 0 or gyroscope.size < 2:
        return ""
    begin = np.searchsorted(observations["t_ns"], observations["t_ns"][-1] - _SPAN_NS)
    try:
        rates = rates_from_tracks(observations[begin:], calibration.camera)
        used = 0.0 if found is None else found.time_offset_s
        readings, claimed = gyroscope[possible(gyroscope["xyz"])], calibration.T_b_c[:3, :3].T
        seen = align(rates, readings, claimed, used)
        if found is None or (seen is not None and abs(seen.offset_s - used) > _LEAST_S):
            clock = find_clock_rate(rates, readings, claimed, used)
            if clock is not None:
                return f"{clock.text(calibration.timeshift_ns / NS_PER_S)}; {clock.fix()}"
    except np.linalg.LinAlgError:
        return ""
    if seen is None or seen.offset_sigma_s > OFFSET_OBSERVABLE_S or seen.explained < _EXPLAINED:
        return ""
    if abs(seen.offset_s - used) <= max(_LEAST_S, _SIGMAS * seen.offset_sigma_s):
        return ""
    shift_s = calibration.timeshift_ns / NS_PER_S
    right, taken = shift_s + seen.offset_s, shift_s + used
    return (
        "the clocks of camera and IMU differ: the tracks rotate as the gyroscope does at t_imu = t_cam "
        f"{1e3 * right:+.1f} ms (standard deviation {1e3 * seen.offset_sigma_s:.1f} ms), but the run used "
        f"{1e3 * taken:+.1f} ms: {clock_fix(right)}"
    )
