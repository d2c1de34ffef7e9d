# SPDX-License-Identifier: Apache-2.0
"""The beginning of a recording, for short measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.types import NS_PER_S, EventRecording


def first_seconds(recording: EventRecording, seconds: float) -> EventRecording:
    """The recording up to `seconds` after its first event; the ground truth is not cut."""
    shift_ns = recording.calibration.timeshift_ns if recording.calibration else 0
    end_ns = int(recording.events["t_ns"][0]) + round(seconds * NS_PER_S)
    gyroscope, accelerometer = (
        stream[: np.searchsorted(stream["t_ns"], end_ns + shift_ns, side="right")]
        for stream in (recording.gyroscope, recording.accelerometer)
    )
    events = recording.events[: np.searchsorted(recording.events["t_ns"], end_ns, side="right")]
    return replace(recording, events=events, gyroscope=gyroscope, accelerometer=accelerometer)
