"""What holds for every recording, trajectory and set of samples that a reader returns, whatever the input."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from asyneio.errors import AsyneioError
from asyneio.io.recording.contents import Samples
from asyneio.types import (
    EVENT_DTYPE,
    INERTIAL_DTYPE,
    OBSERVATION_DTYPE,
    Calibration,
    EventRecording,
    PoseTrajectory,
    RecordArray,
    Recording,
)

#: Stamps beyond this could overflow when clocks are shifted against each other.
MAX_STAMP_NS = 2**62

Found = TypeVar("Found")


def valid_or_rejected(read: Callable[[], Found], check: Callable[[Found], None]) -> None:
    """What is read is valid; what is not read gives our own error with a message."""
    try:
        found = read()
    except AsyneioError as error:
        message = str(error)
    else:
        check(found)
        return
    assert message


def assert_valid(found: Recording | EventRecording) -> None:
    """Types, order, bounds and finiteness of a recording."""
    if isinstance(found, EventRecording):
        _assert_valid_events(found.events, found.width, found.height)
        if found.camera is not None:
            assert (found.camera.width, found.camera.height) == (found.width, found.height)
    else:
        assert found.observations.dtype == OBSERVATION_DTYPE
        assert (np.diff(found.observations["t_ns"]) >= 0).all()
        assert np.isfinite(found.observations["u"]).all()
        assert np.isfinite(found.observations["v"]).all()
    for stream in (found.gyroscope, found.accelerometer):
        _assert_valid_stream(stream)
    if found.calibration is not None:
        assert_valid_calibration(found.calibration)
    if found.ground_truth is not None:
        assert_valid_trajectory(found.ground_truth)
    assert all(isinstance(note, str) and note for note in found.notes)


def assert_valid_calibration(found: Calibration) -> None:
    """A rigid transform, positive noise, a plausible time shift."""
    R = found.T_b_c[:3, :3]
    assert np.isfinite(found.T_b_c).all()
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-6)
    np.testing.assert_array_equal(found.T_b_c[3], [0.0, 0.0, 0.0, 1.0])
    noise = found.noise
    densities = (noise.gyroscope_density, noise.accelerometer_density)
    assert 0.0 < min(*densities, noise.gyroscope_walk, noise.accelerometer_walk) < np.inf
    assert abs(found.timeshift_ns) <= 10**9


def assert_valid_trajectory(found: PoseTrajectory) -> None:
    """Ascending times, finite positions, unit quaternions."""
    assert found.t_ns.dtype == np.int64
    assert found.position.shape == (found.t_ns.size, 3)
    assert found.quaternion.shape == (found.t_ns.size, 4)
    assert (found.t_ns[1:] > found.t_ns[:-1]).all()
    assert np.isfinite(found.position).all()
    np.testing.assert_allclose(np.linalg.norm(found.quaternion, axis=1), 1.0, atol=1e-2)


def assert_valid_samples(found: Samples) -> None:
    """Samples as stored in a file: in any order and unit, but of the same number for both sensors."""
    assert found.gyroscope.dtype == found.accelerometer.dtype == INERTIAL_DTYPE
    assert found.gyroscope.size == found.accelerometer.size
    np.testing.assert_array_equal(found.gyroscope["t_ns"], found.accelerometer["t_ns"])


def _assert_valid_events(events: RecordArray, width: int, height: int) -> None:
    assert events.dtype == EVENT_DTYPE
    assert events.size > 0
    assert (events["t_ns"][1:] >= events["t_ns"][:-1]).all()
    assert np.abs(events["t_ns"]).max() < MAX_STAMP_NS
    assert events["x"].max() < width
    assert events["y"].max() < height
    assert events["p"].max() <= 1


def _assert_valid_stream(stream: RecordArray) -> None:
    assert stream.dtype == INERTIAL_DTYPE
    assert (stream["t_ns"][1:] > stream["t_ns"][:-1]).all()
    assert np.isfinite(stream["xyz"]).all()
