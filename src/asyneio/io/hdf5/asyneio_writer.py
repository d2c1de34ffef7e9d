# SPDX-License-Identifier: Apache-2.0
"""Write an event recording in asyneio's HDF5 layout (see `asyneio_reader`), complete or not at all."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import h5py
import numpy as np

from asyneio.io.calibration.kalibr_writer import camchain_text, camera_text, imu_noise_text
from asyneio.io.hdf5.asyneio_reader import FORMAT, VERSION
from asyneio.io.hdf5.columns import BLOCK_EVENTS
from asyneio.io.parsing.atomic import atomic_path
from asyneio.io.parsing.hdf5_output import new_hdf5
from asyneio.io.recording.event_source import pieces_of
from asyneio.types import EVENT_DTYPE, EventRecording, RecordArray

_COLUMNS = {"t": "t_ns", "x": "x", "y": "y", "p": "p"}


def write_events_hdf5(
    recording: EventRecording, path: Path, events: Iterable[RecordArray] | None = None
) -> None:
    """Write a recording; reading it back gives identical numbers.

    Args:
        recording: what to write.
        path: the file; replaced if it exists.
        events: consecutive pieces (EVENT_DTYPE), written instead of `recording.events`.

    Raises:
        RecordingError: the file cannot be written.
    """
    with atomic_path(path) as temporary:
        fill_hdf5(recording, temporary, pieces_of(recording, BLOCK_EVENTS) if events is None else events)


def fill_hdf5(recording: EventRecording, path: Path, events: Iterable[RecordArray]) -> None:
    """Like `write_events_hdf5`, directly to the file: an interruption leaves an incomplete file.

    Raises:
        OSError: the file cannot be written.
    """
    with new_hdf5(path) as file:
        start_hdf5(file, recording)
        for sensor, rows in (("gyroscope", recording.gyroscope), ("accelerometer", recording.accelerometer)):
            if rows.size:
                section = file.create_group(sensor)
                section["t"], section["xyz"] = rows["t_ns"], rows["xyz"]
        if recording.ground_truth is not None:
            section = file.create_group("ground_truth")
            section["t"] = recording.ground_truth.t_ns
            section["position"] = recording.ground_truth.position
            section["quaternion"] = recording.ground_truth.quaternion
        _write_events(file, events)


def start_hdf5(file: h5py.File, recording: EventRecording) -> None:
    """Write what describes a recording: layout, name, size of the sensor, calibration."""
    file.attrs["format"], file.attrs["version"] = FORMAT, VERSION
    file.attrs["name"] = recording.name
    file.attrs["width"], file.attrs["height"] = recording.width, recording.height
    _write_calibration(file, recording)


def _write_calibration(file: h5py.File, recording: EventRecording) -> None:
    if recording.camera is None:
        return
    section = file.create_group("calibration")
    if recording.calibration is None:
        section.attrs["camchain"] = camera_text(recording.camera)
        return
    section.attrs["camchain"] = camchain_text(recording.calibration)
    section.attrs["imu"] = imu_noise_text(recording.calibration.noise)


def _write_events(file: h5py.File, pieces: Iterable[RecordArray]) -> None:
    section = file.create_group("events")
    columns = {
        name: section.create_dataset(
            name, shape=(0,), maxshape=(None,), chunks=(BLOCK_EVENTS,), dtype=EVENT_DTYPE[field].str
        )
        for name, field in _COLUMNS.items()
    }
    columns["t"].attrs["unit"] = "ns"
    count = 0
    for piece in pieces:
        for name, field in _COLUMNS.items():
            columns[name].resize((count + piece.size,))
            columns[name][count:] = np.ascontiguousarray(piece[field])
        count += piece.size
