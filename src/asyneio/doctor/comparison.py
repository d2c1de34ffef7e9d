"""The camera's own motion against the gyroscope: rates, rotation, offset, and the sizes of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.doctor.event_scan import EventFigures
from asyneio.doctor.inspection import Inspection
from asyneio.doctor.rotation.alignment import Alignment, align
from asyneio.doctor.rotation.camera_rates import (
    CameraRates,
    pairs_from_tracks,
    rates_from_events,
    rates_from_tracks,
)
from asyneio.doctor.rotation.epipolar import gains_of_tracks
from asyneio.doctor.rotation.gains import Gains, gains_of
from asyneio.doctor.rotation.time_offset import TurnOf, gaps_of
from asyneio.errors import AsyneioError
from asyneio.inertial.gravity_witness import SAME_SCALE
from asyneio.inertial.stationarity import possible
from asyneio.io.parsing.stamp_checks import MAX_BAD_SHARE
from asyneio.io.recording.assembly import USUAL_SIZES
from asyneio.progress import ProgressCallback
from asyneio.types import CameraIntrinsics, FloatArray, RecordArray

#: Without a lens a view of about 60 degrees is taken: the rates about x and y are then off by its error.
_GUESSED_FOCAL = 0.87
_FOUND = tuple[CameraRates, Alignment | None, Gains | None]


def with_alignment(
    evidence: Inspection, excerpts: list[RecordArray], progress: ProgressCallback | None
) -> Inspection:
    """Inspection with the comparison, where there is enough for it.

    A gyroscope whose scale is wrong by far would hide all else. So its readings are divided by the scale that
    gravity tells, or, where gravity tells none, by that which the picture's roll does, and compared again.
    """
    streams = evidence.streams
    if not evidence.sees or streams is None or streams.gyroscope.size < 2:
        return evidence
    camera, guessed = evidence.camera, False
    if camera is None:
        assert evidence.events is not None
        camera, guessed = _guessed_lens(*(evidence.size or guess_size(evidence.events))), True
    evidence = replace(evidence, camera=camera, lens_guessed=guessed)
    scale = evidence.gravity.scale if evidence.gravity and evidence.gravity.gyroscope_complaint() else 1.0
    try:
        rates, alignment, gains = _compared(evidence, excerpts, scale, progress)
        if scale == 1.0 and gains is not None and gains.gyroscope_told and _far_off(gains.gyroscope):
            scale = gains.gyroscope
            rates, alignment, gains = _compared(evidence, excerpts, scale, progress)
    except (AsyneioError, np.linalg.LinAlgError):
        # A lens that is impossible is the business of its own check, absurd readings that of others.
        return replace(evidence, camera=None if guessed else camera, lens_guessed=False)
    return replace(evidence, rates=rates, alignment=alignment, gains=gains, gyroscope_scale=scale)


def guess_size(figures: EventFigures) -> tuple[int, int]:
    """The smallest usual sensor that holds the events, as a run takes it; else what they fill."""
    for width, height in USUAL_SIZES:
        if figures.count - figures.counts[:height, :width].sum() <= MAX_BAD_SHARE * figures.count:
            return width, height
    return max(figures.counts.shape[1], 1), max(figures.counts.shape[0], 1)


def _far_off(scale: float) -> bool:
    return not 1.0 / SAME_SCALE < scale < SAME_SCALE


def _compared(
    evidence: Inspection, excerpts: list[RecordArray], scale: float, progress: ProgressCallback | None
) -> _FOUND:
    """Rates, alignment and gains with the gyroscope's readings divided by `scale`."""
    streams, calibration, camera = evidence.streams, evidence.calibration, evidence.camera
    assert streams is not None
    assert camera is not None
    readings = streams.gyroscope[possible(streams.gyroscope["xyz"])].copy()
    readings["xyz"] /= scale
    shift_ns = calibration.timeshift_ns if calibration else 0
    if evidence.tracks is not None:
        rates = rates_from_tracks(evidence.tracks, camera)
    else:
        gyroscope = readings.copy()
        gyroscope["t_ns"] -= shift_ns
        rates = rates_from_events(excerpts, camera, gyroscope, progress)
    claimed: FloatArray = calibration.T_b_c[:3, :3].T if calibration else np.eye(3)
    alignment = align(rates, readings, claimed, shift_ns * 1e-9)
    return rates, alignment, _gains(evidence, rates, alignment, TurnOf(readings))


def _gains(
    evidence: Inspection, rates: CameraRates, alignment: Alignment | None, turn: TurnOf
) -> Gains | None:
    """How large the camera's motion is of the gyroscope's."""
    assert evidence.camera is not None
    if alignment is None:
        return None
    body, inside = turn.means(rates, alignment.offset_s)
    predicted = body[inside] @ alignment.C_c_b.T
    found = gains_of(rates.omega[inside], predicted, gaps_of(rates, inside), alignment.values)
    if evidence.tracks is None:
        return replace(found, focal_sigma=np.inf) if evidence.lens_guessed else found
    pairs, times = pairs_from_tracks(evidence.tracks, evidence.camera)
    body, inside = turn.means(times, alignment.offset_s)
    start = found.gyroscope if found.gyroscope_told else 1.0
    return gains_of_tracks(pairs.of(inside), body[inside], alignment.C_c_b, start)


def _guessed_lens(width: int, height: int) -> CameraIntrinsics:
    focal = _GUESSED_FOCAL * width
    return CameraIntrinsics(focal, focal, 0.5 * (width - 1), 0.5 * (height - 1), width, height)
