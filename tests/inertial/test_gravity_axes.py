"""Exchanged, inverted and wrongly scaled axes of a gyroscope are found by gravity, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.inertial.gravity_axes import axis_complaint
from asyneio.inertial.gravity_witness import GRAVITY, ask_gravity
from asyneio.types import NS_PER_S
from tests.inertial.test_gravity_witness import T, streams

ANGLES = 0.8 * np.stack([np.sin(1.3 * T), np.sin(1.9 * T + 1.0), np.sin(1.1 * T)], axis=1)
ACCELERATION = 0.3 * np.stack([np.sin(2.9 * T), np.cos(3.7 * T), np.sin(4.1 * T + 2.0)], axis=1)


def complaint(of_gyroscope: np.ndarray, of_accelerometer: np.ndarray | None = None) -> str:
    gyroscope, accelerometer = streams(ANGLES, ACCELERATION)
    gyroscope["xyz"] = gyroscope["xyz"] @ of_gyroscope.T
    if of_accelerometer is not None:
        accelerometer["xyz"] = accelerometer["xyz"] @ of_accelerometer.T
    return axis_complaint(gyroscope, accelerometer, ask_gravity(gyroscope, accelerometer))


EXCHANGED = np.eye(3)[[1, 0, 2]]


@pytest.mark.parametrize(
    ("of_gyroscope", "of_accelerometer", "said"),
    [
        (np.eye(3), None, ""),
        (np.eye(3), -np.eye(3), ""),
        (np.eye(3)[[1, 2, 0]], np.eye(3)[[1, 2, 0]], ""),
        (2.0 * np.eye(3), None, ""),
        (-np.eye(3), None, "sign is inverted"),
        (EXCHANGED, EXCHANGED, "left-handed"),
        (np.eye(3), np.eye(3)[[1, 2, 0]], "as if the gyroscope's axes x, y, z were y, z, x"),
        (np.diag([1.0, -1.0, 1.0]), None, "were x, -y, z"),
        (np.diag([1.0, 2.0, 1.0]), None, "the gyroscope's y axis reads 2 times .* multiply y by 0.5"),
    ],
)
def test_axes(of_gyroscope: np.ndarray, of_accelerometer: np.ndarray | None, said: str) -> None:
    found = complaint(of_gyroscope, of_accelerometer)
    if not said:
        assert found == ""
    else:
        first, _, second = said.partition(" .* ")
        assert first in found
        assert second in found


def test_nothing_is_said_where_gravity_tells_nothing() -> None:
    still = np.zeros_like(ANGLES)
    gyroscope, accelerometer = streams(still, still)
    assert axis_complaint(gyroscope, accelerometer, ask_gravity(gyroscope, accelerometer)) == ""
    assert axis_complaint(gyroscope[:3], accelerometer[:3], None) == ""


def test_spans_with_a_pause_are_not_evaluated() -> None:
    gyroscope, accelerometer = streams(ANGLES, ACCELERATION)
    for rows in (gyroscope, accelerometer):
        rows["t_ns"][:5] -= 10**9 * NS_PER_S
    witness = ask_gravity(gyroscope, accelerometer)
    assert witness is None or witness.force == pytest.approx(GRAVITY, rel=0.05)
    late = [rows.copy() for rows in (gyroscope[5:], accelerometer[5:])]
    for rows in late:
        rows["t_ns"][rows.size // 2 :] += 2 * NS_PER_S
    witness = ask_gravity(late[0], late[1])
    assert witness is None or witness.force == pytest.approx(GRAVITY, rel=0.05)
