"""Gravity determines the scale of both sensors if it rotates in the body, and does not otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.inertial.gravity_witness import GRAVITY, GravityWitness, ask_gravity, gyroscope_cause
from asyneio.types import INERTIAL_DTYPE, FloatArray, RecordArray

T = np.arange(0.0, 9.0, 0.005)


def streams(
    angles: FloatArray, acceleration: FloatArray, rate_scale: float = 1.0, force_scale: float = 1.0
) -> tuple[RecordArray, RecordArray]:
    """Readings of a body rotated by angles (N,3) about x, y, z, and accelerated in the world."""
    C = Rotation.from_euler("xyz", angles)
    middle = (C[:-1].inv() * C[1:]).as_rotvec() / np.diff(T)[:, None]
    rate = np.concatenate([middle[:1], 0.5 * (middle[1:] + middle[:-1]), middle[-1:]])
    rng = np.random.default_rng(1)
    force = C.inv().apply(acceleration + np.array([0.0, 0.0, GRAVITY]))
    both = []
    for values, sigma, scale in ((rate, 0.01, rate_scale), (force, 0.05, force_scale)):
        rows = np.zeros(T.size, dtype=INERTIAL_DTYPE)
        rows["t_ns"] = np.round(T * 1e9).astype(np.int64)
        rows["xyz"] = scale * (values + 0.01 + sigma * rng.standard_normal(values.shape))
        both.append(rows)
    return both[0], both[1]


def hand(rate_scale: float = 1.0, force_scale: float = 1.0) -> GravityWitness:
    """Hand-held motion: half a radian and decimetres."""
    angles = 0.5 * np.stack([np.sin(1.3 * T), np.sin(1.9 * T + 1.0), np.sin(0.8 * T)], axis=1)
    acceleration = 0.8 * np.stack([np.sin(2.9 * T), np.cos(3.7 * T), np.sin(4.1 * T + 2.0)], axis=1)
    witness = ask_gravity(*streams(angles, acceleration, rate_scale, force_scale))
    assert witness is not None
    return witness


@pytest.mark.parametrize("scale", [1.0, 2.0, 0.125, 180.0 / np.pi])
def test_the_scale_of_the_gyroscope_is_found(scale: float) -> None:
    witness = hand(rate_scale=scale)
    assert witness.observable
    assert witness.scale == pytest.approx(scale, rel=0.1)
    assert abs(np.log(witness.scale / scale)) < 4.0 * witness.log_sigma
    assert bool(witness.gyroscope_complaint()) == (scale != 1.0)
    assert ("degrees instead of radians" in witness.gyroscope_complaint()) == (scale > 50.0)
    assert witness.force_complaint() == ""


@pytest.mark.parametrize("scale", [0.5, 0.85, 2.0])
def test_the_scale_of_the_accelerometer_is_found(scale: float) -> None:
    witness = hand(force_scale=scale)
    assert witness.force == pytest.approx(scale * GRAVITY, rel=0.05)
    assert "times its true value" in witness.force_complaint()


@pytest.mark.parametrize("scale", [0.95, 1.1])
def test_tolerances_of_the_accelerometer_are_accepted(scale: float) -> None:
    assert hand(force_scale=scale).force_complaint() == ""


def test_a_body_whose_tilt_and_acceleration_cancel_tells_nothing() -> None:
    """A drone accelerates by tilting, so that its specific force stays along an axis of its own."""
    tilt = 0.2 * np.stack([np.sin(1.3 * T), np.sin(1.9 * T + 1.0), 0.0 * T], axis=1)
    up = Rotation.from_euler("xyz", tilt).apply([0.0, 0.0, GRAVITY])
    witness = ask_gravity(*streams(tilt, up - [0.0, 0.0, GRAVITY]))
    assert witness is not None
    assert not witness.observable
    assert witness.gyroscope_complaint() == ""
    assert witness.force_complaint() == ""


def test_rest_and_short_recordings_tell_nothing_of_the_gyroscope() -> None:
    gyroscope, accelerometer = streams(np.zeros((T.size, 3)), np.zeros((T.size, 3)))
    witness = ask_gravity(gyroscope, accelerometer)
    assert witness is not None
    assert not witness.observable
    assert ask_gravity(gyroscope[:50], accelerometer[:50]) is None
    assert ask_gravity(gyroscope[:1], accelerometer) is None


def test_a_push_in_a_short_recording_is_no_fault_of_the_sensor() -> None:
    gyroscope, accelerometer = streams(np.zeros((T.size, 3)), np.tile([0.0, 0.0, 3.0], (T.size, 1)))
    witness = ask_gravity(gyroscope[:110], accelerometer[:110])
    assert witness is not None
    assert witness.force > 1.25 * GRAVITY
    assert witness.force_complaint() == ""


@pytest.mark.parametrize(
    ("scale", "said"),
    [
        (0.5, "a power of 2): multiply its readings by 2"),
        (3.9, "a power of 2): multiply its readings by 0.25"),
        (17.3, "milliradians per second"),
        (57.0, "degrees instead of radians"),
        (1000.0, "thousandths of a unit"),
        (1.45, "no usual factor of units or ranges"),
    ],
)
def test_the_cause_of_a_scale_is_the_nearest_usual_one(scale: float, said: str) -> None:
    assert said in gyroscope_cause(scale)


def test_an_accelerometer_that_is_a_tenth_off_is_doubtful() -> None:
    assert hand(force_scale=0.91).force_doubt()
    assert not hand().force_doubt()
