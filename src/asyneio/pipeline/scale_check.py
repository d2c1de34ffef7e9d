# SPDX-License-Identifier: Apache-2.0
"""Whether the estimated scale factors of the IMU contradict their prior.

An estimate `d` with standard deviation `s`, whose prior is zero with standard deviation `s_0`, has the
variance `s_0^2 - s^2` if the prior is right. A wrong full-scale range, unit or focal length changes it by far
more. The prior pulls the estimate towards zero; without it, it would be `d s_0^2 / (s_0^2 - s^2)`.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtri

from asyneio.config import Config
from asyneio.rotation.camera_rates import pairs_from_tracks
from asyneio.rotation.epipolar import gains_of_tracks
from asyneio.rotation.gains import Gains
from asyneio.rotation.time_offset import TurnOf
from asyneio.types import Calibration, CalibrationEstimate, FloatArray, RecordArray

#: Probability with which a sensor that meets its prior is rejected. A sensor with a scale error of three
#: standard deviations of the prior on each axis passes.
_PROBABILITY = 1e-7
#: Least standard deviation that is tested, for a narrow prior: an error of some tenths of a percent in a
#: calibrated IMU is no reason to reject a trajectory.
_TOLERANCE = 0.01
#: Largest ratio of posterior to prior variance of an axis that counts as observed.
_OBSERVED = 0.95
#: A comparison of tracks and gyroscope names the cause if it is off by this factor and by more than this
#: number of standard deviations; a larger factor of the focal length is not plausible.
_NAMED, _SIGMAS, _MOST_FOCAL = 1.06, 3.5, 1.5
#: The same factor for a run without estimates: nothing else shows an error.
_NAMED_ALONE = 1.07
#: For a note on a run that is complete: least factor, least number of windows and largest standard deviation.
#: With less rotation or fewer windows the claimed standard deviations are too small.
_NOTED, _LEAST_WINDOWS, _MOST_SIGMA = 1.045, 20, 0.02


def contradicted_scale(
    found: CalibrationEstimate | None,
    config: Config,
    calibration: Calibration,
    gyroscope: RecordArray,
    observations: RecordArray,
) -> str:
    """What is wrong with the scale of the trajectory, as a phrase; empty if nothing is.

    Without an estimate, the tracks alone are compared with the gyroscope.

    Args:
        found: calibration as estimated at the end of a run; None if it did not end in a segment.
        config: of the run; its prior of the scale factors is tested.
        calibration: as given to the run.
        gyroscope: samples (INERTIAL_DTYPE), ascending.
        observations: tracks (OBSERVATION_DTYPE, IMU clock), ascending.
    """
    if found is None:
        return "; ".join(_cause(_compare(calibration, gyroscope, observations, found), _NAMED_ALONE))
    contradictions = contradictions_of_prior(found, config)
    if not contradictions:
        return ""
    gains = _compare(calibration, gyroscope, observations, found)
    return "; ".join((*contradictions, *_cause(gains, _NAMED)))


def contradictions_of_prior(found: CalibrationEstimate | None, config: Config) -> tuple[str, ...]:
    """Contradictions between the estimated scale factors of the IMU and their prior, as phrases.

    Args:
        found: calibration as estimated; None if the estimator is not initialized.
        config: of the run; its prior of the scale factors is tested.
    """
    if found is None or found.imu is None:
        return ()
    prior, imu = config.calibration.imu_scale_sigma, found.imu
    said = [
        _contradicted(name, np.diag(matrix) - 1.0, np.diag(sigma), prior)
        for name, matrix, sigma in (
            ("gyroscope", imu.gyroscope, imu.gyroscope_sigma),
            ("accelerometer", imu.accelerometer, imu.accelerometer_sigma),
        )
    ]
    phrases = [text for text in said if text]
    if phrases:
        phrases[0] = f"the scale of the trajectory is not reliable: {phrases[0]}"
    return tuple(phrases)


def scale_notes(
    found: CalibrationEstimate | None,
    calibration: Calibration,
    gyroscope: RecordArray,
    observations: RecordArray,
) -> tuple[str, ...]:
    """A note if tracks and gyroscope show a wrong focal length or scale, although the run is complete.

    Args: as those of `contradicted_scale`.
    """
    gains = _compare(calibration, gyroscope, observations, found, _LEAST_WINDOWS)
    if gains is None or max(gains.gyroscope_sigma, gains.focal_sigma) > _MOST_SIGMA:
        return ()
    return tuple(f"{text}: calibrate again, or run `asyneio doctor`" for text in _cause(gains, _NOTED))


def _contradicted(name: str, error: FloatArray, sigma: FloatArray, prior: float) -> str:
    """A contradiction of the prior by scale errors (3,) with their standard deviations, or nothing."""
    ratio = (sigma / prior) ** 2
    observed = (sigma > 0.0) & (ratio < _OBSERVED)
    dof = int(np.count_nonzero(observed))
    if dof == 0:
        return ""
    information = 1.0 - ratio[observed]
    squared = float((error[observed] ** 2 / information).sum()) / max(prior, _TOLERANCE) ** 2
    limit = float(chdtri(dof, _PROBABILITY))
    if squared <= limit:
        return ""
    factors = ", ".join(f"{1.0 + value:.3f}" for value in error[observed] / information)
    return (
        f"the motion fits {name} readings that are {factors} times too large (prior 1, standard deviation "
        f"{prior:.2g}; chi-square {squared:.0f}, at most {limit:.0f})"
    )


def _compare(
    calibration: Calibration,
    gyroscope: RecordArray,
    observations: RecordArray,
    found: CalibrationEstimate | None,
    least_windows: int = 1,
) -> Gains | None:
    """Gyroscope scale and focal length by tracks alone; None if there are too few tracks or windows."""
    if observations.size == 0 or gyroscope.size < 2:
        return None
    pairs, times = pairs_from_tracks(observations, calibration.camera)
    C_b_c, offset_s = (
        (calibration.T_b_c[:3, :3], 0.0) if found is None else (found.C_b_c, found.time_offset_s)
    )
    body, inside = TurnOf(gyroscope).means(times, offset_s)
    if np.count_nonzero(inside) < least_windows:
        return None
    try:
        return gains_of_tracks(pairs.of(inside), body[inside], C_b_c.T, 1.0)
    except np.linalg.LinAlgError:
        return None


def _cause(gains: Gains | None, least: float) -> list[str]:
    """The cause according to the tracks, if they show one beyond the factor `least`."""
    if gains is None:
        return []
    error, sigma = math.log(gains.gyroscope), gains.gyroscope_sigma
    if gains.gyroscope_observable and abs(error) > max(math.log(least), _SIGMAS * sigma):
        factor = f"{gains.gyroscope:.3g} times what the camera sees (standard deviation {sigma:.1%})"
        return [f"the gyroscope reads {factor}, so its scale or the focal length is wrong"]
    error, sigma = math.log(gains.focal), gains.focal_sigma
    plausible = gains.focal_observable and abs(error) < math.log(_MOST_FOCAL)
    if plausible and abs(error) > max(math.log(least), _SIGMAS * sigma):
        return [
            f"the focal length is {gains.focal:.3g} times the calibrated one (standard deviation {sigma:.1%})"
        ]
    return []
