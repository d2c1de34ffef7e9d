# SPDX-License-Identifier: Apache-2.0
"""Compare the camera's angular rates with the gyroscope: rotation, time offset and scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.doctor.event_scan import EventFigures
from asyneio.doctor.inspection import Inspection
from asyneio.errors import AsyneioError
from asyneio.inertial.gravity_witness import SAME_SCALE
from asyneio.inertial.stationarity import possible
from asyneio.io.parsing.stamp_checks import MAX_BAD_SHARE
from asyneio.io.recording.assembly import USUAL_SIZES
from asyneio.progress import ProgressCallback
from asyneio.rotation.alignment import RELATED, Alignment, align
from asyneio.rotation.apparent import apparent_rotation
from asyneio.rotation.camera_rates import (
    CameraRates,
    pairs_from_tracks,
    rates_from_events,
    rates_from_tracks,
)
from asyneio.rotation.clock_rate import ClockRate, find_clock_rate, slowed
from asyneio.rotation.epipolar import gains_of_tracks
from asyneio.rotation.focal import RateModel
from asyneio.rotation.gains import Gains, gains_of
from asyneio.rotation.time_offset import TurnOf, gaps_of
from asyneio.rotation.velocity import velocity_basis
from asyneio.types import NS_PER_S, CameraIntrinsics, FloatArray, RecordArray

#: Focal length over width without intrinsics: 60 degrees field of view. Rates about x and y have its error.
_GUESSED_FOCAL = 0.87
_FOUND = tuple[CameraRates, Alignment | None, Gains | None, ClockRate | None]
#: Offset [s] to the calibrated one from which the rates of the clocks are compared.
_DOUBTFUL_S = 0.02


def with_alignment(
    inspection: Inspection, excerpts: list[RecordArray], progress: ProgressCallback | None
) -> Inspection:
    """Inspection with the comparison added, if there are enough data.

    A large scale error of the gyroscope would hide all other errors. Its readings are therefore divided by
    the scale estimated from gravity or, if gravity gives none, by the scale estimated from the image roll,
    and the comparison is repeated.

    Args:
        inspection: without the comparison.
        excerpts: parts of the events (EVENT_DTYPE).
        progress: called with the fraction done, 0 to 1.
    """
    streams = inspection.streams
    if not inspection.sees or streams is None or streams.gyroscope.size < 2:
        return inspection
    camera, guessed = inspection.camera, False
    if camera is None:
        assert inspection.events is not None
        camera, guessed = _guessed_intrinsics(*(inspection.size or guess_size(inspection.events))), True
    inspection = replace(inspection, camera=camera, intrinsics_guessed=guessed)
    scale = (
        inspection.gravity.scale if inspection.gravity and inspection.gravity.gyroscope_complaint() else 1.0
    )
    try:
        rates, alignment, gains, clock_rate = _compared(inspection, excerpts, scale, progress)
        if scale == 1.0 and gains is not None and gains.gyroscope_observable and _far_off(gains.gyroscope):
            scale = gains.gyroscope
            rates, alignment, gains, clock_rate = _compared(inspection, excerpts, scale, progress)
    except (AsyneioError, np.linalg.LinAlgError):
        # Impossible intrinsics and impossible readings are reported by their own checks.
        return replace(inspection, camera=None if guessed else camera, intrinsics_guessed=False)
    return replace(
        inspection,
        rates=rates,
        alignment=alignment,
        gains=gains,
        gyroscope_scale=scale,
        clock_rate=clock_rate,
    )


def guess_size(figures: EventFigures) -> tuple[int, int]:
    """Smallest common sensor size that contains the events, as a run would choose it; else their extent."""
    for width, height in USUAL_SIZES:
        if figures.count - figures.counts[:height, :width].sum() <= MAX_BAD_SHARE * figures.count:
            return width, height
    return max(figures.counts.shape[1], 1), max(figures.counts.shape[0], 1)


def _far_off(scale: float) -> bool:
    return not 1.0 / SAME_SCALE < scale < SAME_SCALE


def _compared(
    inspection: Inspection, excerpts: list[RecordArray], scale: float, progress: ProgressCallback | None
) -> _FOUND:
    """Rates, alignment and gains, with the gyroscope readings divided by `scale`.

    The last element is the rate of the camera's clock, if it differs from that of the gyroscope. Then the
    rates are those of a clock of the same rate, and there are no gains.
    """
    streams, calibration, camera = inspection.streams, inspection.calibration, inspection.camera
    assert streams is not None
    assert camera is not None
    readings = streams.gyroscope[possible(streams.gyroscope["xyz"])].copy()
    readings["xyz"] /= scale
    shift_ns = calibration.timeshift_ns if calibration else 0
    if inspection.tracks is not None:
        rates = rates_from_tracks(inspection.tracks, camera)
    else:
        gyroscope = readings.copy()
        gyroscope["t_ns"] -= shift_ns
        rates = rates_from_events(excerpts, camera, gyroscope, progress)
    claimed: FloatArray = calibration.T_b_c[:3, :3].T if calibration else np.eye(3)
    shift_s = shift_ns * 1e-9
    alignment = align(rates, readings, claimed, shift_s)
    if _doubtful(alignment, shift_s):
        clock_rate = find_clock_rate(rates, readings, claimed, shift_s)
        if clock_rate is not None:
            rates = slowed(rates, clock_rate.rate)
            return rates, align(rates, readings, claimed, clock_rate.start_s), None, clock_rate
    return rates, alignment, _gains(inspection, rates, alignment, TurnOf(readings)), None


def _doubtful(alignment: Alignment | None, shift_s: float) -> bool:
    """Whether clocks of different rates may explain more than a constant offset."""
    if alignment is None or alignment.explained < RELATED:
        return True
    return abs(alignment.offset_s - shift_s) > _DOUBTFUL_S


def _gains(
    inspection: Inspection, rates: CameraRates, alignment: Alignment | None, turn: TurnOf
) -> Gains | None:
    """Ratios of the camera's motion to the gyroscope readings."""
    camera, streams = inspection.camera, inspection.streams
    assert camera is not None
    assert streams is not None
    if alignment is None:
        return None
    body, inside = turn.means(rates, alignment.offset_s)
    middle_ns = (rates.start_ns + rates.end_ns)[inside] // 2 + round(alignment.offset_s * NS_PER_S)
    force = streams.accelerometer[possible(streams.accelerometer["xyz"])]
    velocity, sigma = np.zeros((len(middle_ns), 3, 0)), np.zeros(0)
    if force.size > 1:
        velocity, sigma = velocity_basis(middle_ns, turn, TurnOf(force), alignment.C_c_b)
    found = gains_of(
        RateModel(
            camera=rates.omega[inside],
            body=body[inside],
            gaps=gaps_of(rates, inside),
            values=alignment.values,
            C_c_b=alignment.C_c_b,
            apparent=apparent_rotation(camera),
            velocity=velocity,
            velocity_sigma=sigma,
        )
    )
    if inspection.tracks is None:
        return replace(found, focal_sigma=np.inf) if inspection.intrinsics_guessed else found
    pairs, times = pairs_from_tracks(inspection.tracks, camera)
    body, inside = turn.means(times, alignment.offset_s)
    start = found.gyroscope if found.gyroscope_observable else 1.0
    return gains_of_tracks(pairs.of(inside), body[inside], alignment.C_c_b, start)


def _guessed_intrinsics(width: int, height: int) -> CameraIntrinsics:
    focal = _GUESSED_FOCAL * width
    return CameraIntrinsics(focal, focal, 0.5 * (width - 1), 0.5 * (height - 1), width, height)
