"""Small synthetic event recordings for tests of files."""

from __future__ import annotations

import numpy as np

from asyneio.types import EVENT_DTYPE, NS_PER_S, EventRecording, RecordArray
from tests.io.recordings import START_NS, make_calibration, make_stream, straight_path


def make_events(rng: np.random.Generator, count: int, seconds: float = 2.0) -> RecordArray:
    """Ascending events all over a 240 x 180 sensor, some at equal times."""
    events = np.zeros(count, dtype=EVENT_DTYPE)
    events["t_ns"] = START_NS + np.sort(rng.integers(0, round(seconds * NS_PER_S), count))
    events["t_ns"][1::7] = events["t_ns"][: count - 1 : 7]
    events["x"] = rng.integers(0, 240, count)
    events["y"] = rng.integers(0, 180, count)
    events["p"] = rng.integers(0, 2, count)
    return events


def make_event_recording(rng: np.random.Generator, count: int = 5000) -> EventRecording:
    """Events, both inertial sensors at 200 Hz, calibration and a straight true path."""
    calibration = make_calibration()
    return EventRecording(
        name="synthetic",
        events=make_events(rng, count),
        width=240,
        height=180,
        gyroscope=make_stream(rng, 200.0, 2.0, [0.1, 0.0, -0.2]),
        accelerometer=make_stream(rng, 200.0, 2.0, [0.0, 0.0, 9.81]),
        camera=calibration.camera,
        calibration=calibration,
        ground_truth=straight_path(2.0),
    )


def assert_same(found: EventRecording, wanted: EventRecording) -> None:
    """Every number of two recordings is identical (calibrations with extrinsics, bit for bit)."""
    for name in ("t_ns", "x", "y", "p"):
        np.testing.assert_array_equal(found.events[name], wanted.events[name])
    for sensor in ("gyroscope", "accelerometer"):
        np.testing.assert_array_equal(getattr(found, sensor), getattr(wanted, sensor))
    assert (found.width, found.height) == (wanted.width, wanted.height)
    assert found.camera == wanted.camera
    assert (found.calibration is None) == (wanted.calibration is None)
    if found.calibration is not None and wanted.calibration is not None:
        np.testing.assert_array_equal(found.calibration.T_b_c, wanted.calibration.T_b_c)
        assert found.calibration.timeshift_ns == wanted.calibration.timeshift_ns
        assert found.calibration.noise == wanted.calibration.noise
    assert (found.ground_truth is None) == (wanted.ground_truth is None)
    if found.ground_truth is not None and wanted.ground_truth is not None:
        for name in ("t_ns", "position", "quaternion"):
            np.testing.assert_array_equal(
                getattr(found.ground_truth, name), getattr(wanted.ground_truth, name)
            )
