# SPDX-License-Identifier: Apache-2.0
"""Write an event recording as a folder of the UZH event camera data set (layout: see `folder_reader`)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import CAMCHAIN_FILE, IMU_FILE
from asyneio.io.calibration.kalibr_writer import camchain_text, camera_text, imu_noise_text
from asyneio.io.parsing.atomic import atomic_file, write_text
from asyneio.io.parsing.decimal_seconds import format_seconds
from asyneio.io.recording.event_source import pieces_of
from asyneio.io.recording.tum import tum_text
from asyneio.io.uzh.folder_reader import EVENTS_FILE, GROUND_TRUTH_FILE, INTRINSICS_FILE, SAMPLES_FILE
from asyneio.jit import njit
from asyneio.types import NS_PER_S, CameraIntrinsics, Distortion, EventRecording, IntArray, RecordArray

_PIECE = 2**15
#: Upper bound: sign, ten digits, point, nine digits, three times a blank and five digits, line feed.
_LONGEST_LINE = 48
_BLANK, _NEWLINE, _POINT, _MINUS, _ZERO = (ord(c) for c in " \n.-0")


def write_uzh_folder(
    recording: EventRecording, folder: Path, events: Iterable[RecordArray] | None = None
) -> None:
    """Write events, samples, ground truth and calibration, each file complete or not at all.

    Reading it back gives identical numbers. Files of an earlier call that the recording lacks are removed.

    Args:
        recording: what to write.
        folder: output; created if it does not exist.
        events: consecutive pieces (EVENT_DTYPE), written instead of `recording.events`.

    Raises:
        RecordingError: a file cannot be written, or gyroscope and accelerometer have different times, which
            `imu.txt` cannot store.
    """
    texts = sidecar_texts(recording)
    with atomic_file(folder / EVENTS_FILE) as stream:
        for piece in pieces_of(recording, _PIECE) if events is None else events:
            for start in range(0, piece.size, _PIECE):
                stream.write(event_lines(piece[start : start + _PIECE]))
    for name, text in texts.items():
        if text is None:
            (folder / name).unlink(missing_ok=True)
        else:
            write_text(folder / name, text)


def sidecar_texts(recording: EventRecording) -> dict[str, str | None]:
    """Texts of all files of a folder except the events; None for what the recording lacks.

    Raises:
        RecordingError: gyroscope and accelerometer have different times.
    """
    gyroscope, accelerometer = recording.gyroscope, recording.accelerometer
    if not np.array_equal(gyroscope["t_ns"], accelerometer["t_ns"]):
        raise RecordingError(
            f"{SAMPLES_FILE} stores both sensors at the same times, but their times differ; write HDF5 "
            "instead"
        )
    truth = recording.ground_truth
    return {
        SAMPLES_FILE: _samples_text(gyroscope, accelerometer) if gyroscope.size else None,
        INTRINSICS_FILE: _calib_text(recording.camera) if recording.camera else None,
        CAMCHAIN_FILE: _camchain_text(recording),
        IMU_FILE: imu_noise_text(recording.calibration.noise) if recording.calibration else None,
        GROUND_TRUTH_FILE: tum_text(truth, header="") if truth is not None else None,
    }


def _samples_text(gyroscope: RecordArray, accelerometer: RecordArray) -> str:
    values = np.hstack([accelerometer["xyz"], gyroscope["xyz"]]).tolist()
    return "".join(
        f"{format_seconds(t_ns)} {' '.join(map(repr, row))}\n"
        for t_ns, row in zip(gyroscope["t_ns"].tolist(), values, strict=True)
    )


def _calib_text(camera: CameraIntrinsics) -> str | None:
    """`calib.txt`, which supports radtan up to k3; None for other models, which only the Kalibr file
    contains."""
    if camera.distortion is Distortion.EQUIDISTANT or any(camera.coefficients[5:]):
        return None
    coefficients = (*camera.coefficients, *(0.0,) * 5)[:5]
    values = (camera.fx, camera.fy, camera.cx, camera.cy, *coefficients)
    return " ".join(repr(float(value)) for value in values) + "\n"


def _camchain_text(recording: EventRecording) -> str | None:
    if recording.calibration is not None:
        return camchain_text(recording.calibration)
    return camera_text(recording.camera) if recording.camera else None


def event_lines(events: RecordArray) -> memoryview:
    """Events as lines of `events.txt`. The text is built in memory: pass some thousands at a time."""
    text = np.empty(events.size * _LONGEST_LINE, dtype=np.uint8)
    length = int(_print_events(events["t_ns"], events["x"], events["y"], events["p"], text))
    return text[:length].data


@njit(cache=True)
def _print_events(t_ns: IntArray, x: np.ndarray, y: np.ndarray, p: np.ndarray, text: np.ndarray) -> np.uint64:
    """Print events as lines into `text` (uint8); returns the number of bytes."""
    one, second = np.uint64(1), np.uint64(NS_PER_S)
    i = np.uint64(0)
    for k in range(t_ns.size):
        event = np.uint64(k)
        time = t_ns[event]
        if time < 0:
            text[i] = _MINUS
            i += one
            time = -time
        seconds = np.uint64(time) // second
        i = _print_number(text, i, seconds, 1)
        text[i] = _POINT
        i = _print_number(text, i + one, np.uint64(time) - seconds * second, 9)
        for value in (np.uint64(x[event]), np.uint64(y[event]), np.uint64(p[event])):
            text[i] = _BLANK
            i = _print_number(text, i + one, value, 1)
        text[i] = _NEWLINE
        i += one
    return i


@njit(cache=True)
def _print_number(text: np.ndarray, i: np.uint64, value: np.uint64, least: int) -> np.uint64:
    """Print an integer with at least `least` digits; returns the position after it."""
    ten = np.uint64(10)
    digits, rest = 1, value // ten
    while rest > 0:
        digits += 1
        rest //= ten
    end = i + np.uint64(max(digits, least))
    position = end
    while position > i:
        position -= np.uint64(1)
        shorter = value // ten
        text[position] = _ZERO + np.int64(value - ten * shorter)
        value = shorter
    return end
