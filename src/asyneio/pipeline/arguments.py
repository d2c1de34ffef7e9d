# SPDX-License-Identifier: Apache-2.0
"""Checks of a recording that a program passes to a run, before anything is computed."""

from __future__ import annotations

import numpy as np

from asyneio.errors import RecordingError
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, OBSERVATION_DTYPE, EventRecording, Recording


def check_recording(recording: object) -> None:
    """Reject what is not a recording, and arrays of another type, shape or order.

    Raises:
        RecordingError: with the part, what was found, and what is expected.
    """
    if not isinstance(recording, (Recording, EventRecording)):
        raise RecordingError(
            f"found a {type(recording).__name__}, expected a Recording, an EventRecording or the path of "
            "one (asyneio.open_recording)"
        )
    for name in ("gyroscope", "accelerometer"):
        rows = getattr(recording, name)
        _check_array(rows, name, INERTIAL_DTYPE, "INERTIAL_DTYPE")
        if rows.size > 1 and bool((np.diff(rows["t_ns"]) < 0).any()):
            raise RecordingError(f"the timestamps of the {name} do not ascend; sort its rows by t_ns")
    if isinstance(recording, EventRecording):
        # Fields in another layout, such as a memory map without padding, are converted packet by packet.
        if getattr(recording.events, "dtype", np.dtype("V")).names != EVENT_DTYPE.names:
            _check_array(recording.events, "events", EVENT_DTYPE, "EVENT_DTYPE")
    else:
        _check_array(recording.observations, "observations", OBSERVATION_DTYPE, "OBSERVATION_DTYPE")


def _check_array(rows: object, name: str, dtype: np.dtype[np.void], dtype_name: str) -> None:
    expected = f"expected an array (N,) of asyneio.types.{dtype_name} in native byte order"
    if not isinstance(rows, np.ndarray) or isinstance(rows, np.ma.MaskedArray):
        raise RecordingError(f"{name}: found a {type(rows).__name__}, {expected}")
    if rows.ndim != 1 or rows.dtype != dtype:
        raise RecordingError(
            f"{name}: found an array of type {rows.dtype} and shape {rows.shape}, {expected}"
        )
