"""Focal length from rates: what a fit over the view sees of it, and translation from the accelerometer."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.geometry.camera import CameraModel
from asyneio.rotation.apparent import apparent_rotation
from asyneio.rotation.focal import RateModel
from asyneio.rotation.gains import gains_of
from asyneio.rotation.time_offset import TurnOf
from asyneio.rotation.velocity import velocity_basis
from asyneio.types import (
    INERTIAL_DTYPE,
    CameraIntrinsics,
    Distortion,
    FloatArray,
    IntArray,
    RecordArray,
)

#: The lens of a DAVIS240C, and one without distortion that sees 90 degrees.
DAVIS = CameraIntrinsics(
    199.0, 199.0, 132.0, 110.0, 240, 180, Distortion.RADTAN, (-0.368, 0.151, -0.0003, -0.0008)
)
WIDE = CameraIntrinsics(120.0, 120.0, 120.0, 90.0, 240, 180)
C_C_B = Rotation.from_euler("xyz", [80.0, 10.0, -100.0], degrees=True).as_matrix()
DEPTH_M = 3.0


def seen_rate(true: CameraIntrinsics, calibrated: CameraIntrinsics, axis: int) -> FloatArray:
    """Rotation (3,) that fits the image motion over the whole view best, for a unit rotation about `axis`."""
    u, v = np.meshgrid(np.arange(2.0, 239.0, 5.0), np.arange(2.0, 179.0, 5.0))
    xy, _, _ = CameraModel(true).undistort(np.stack([u.ravel(), v.ravel()], axis=1))
    rays = np.column_stack([xy, np.ones(len(xy))])
    ends, seen = [], np.ones(len(rays), dtype=bool)
    for turn in (-5e-4, 5e-4):
        # A point that does not move, in the frame of the rotated camera.
        uv, inside = CameraModel(true).project(Rotation.from_rotvec(-turn * np.eye(3)[axis]).apply(rays))
        end, _, valid = CameraModel(calibrated).undistort(uv)
        ends.append(end)
        seen &= inside & valid
    x, y = (0.5 * (ends[0] + ends[1]))[seen].T
    by_axis = [[x * y, 1.0 + y * y], [-(1.0 + x * x), -x * y], [y, -x]]
    rows = np.array(by_axis).reshape(3, -1).T
    return np.asarray(np.linalg.lstsq(rows, 1e3 * (ends[1] - ends[0])[seen].T.ravel(), rcond=None)[0])


@pytest.mark.parametrize("camera", [DAVIS, WIDE])
def test_the_part_of_a_focal_length_that_a_fit_sees(camera: CameraIntrinsics) -> None:
    calibrated = dataclasses.replace(camera, fx=camera.fx / 1.03, fy=camera.fy / 1.03)
    expected = np.eye(3) + np.log(1.03) * apparent_rotation(calibrated).of_focal
    for axis in range(3):
        np.testing.assert_allclose(seen_rate(camera, calibrated, axis), expected[:, axis], atol=0.002)


def test_a_narrow_view_sees_all_of_it_and_nothing_in_a_roll() -> None:
    narrow = apparent_rotation(CameraIntrinsics(5000.0, 5000.0, 120.0, 90.0, 240, 180))
    np.testing.assert_allclose(narrow.of_focal, np.diag([1.0, 1.0, 0.0]), atol=1e-3)
    np.testing.assert_allclose(
        narrow.of_translation[:2, :2], [[0.0, -1.0], [1.0, 0.0]], atol=1e-3
    )  # A motion to the right looks like a rotation to the right.
    # Two fifths at 90 degrees.
    assert apparent_rotation(WIDE).of_focal[1, 1] == pytest.approx(0.38, abs=0.02)


def motion(seconds: float, rng: np.random.Generator) -> tuple[RecordArray, RecordArray, IntArray, FloatArray]:
    """Readings of a hand-held IMU at 500 Hz, middles of 20 windows per second, and velocities (N,3) of the
    camera at these in its own frame [m/s]."""
    t = np.arange(0.0, seconds, 0.002)
    hertz, phase = rng.uniform(0.3, 1.2, (2, 4, 3)), rng.uniform(0.0, 6.28, (2, 4, 3))
    angle = 6.28 * hertz[:, :, None, :] * t[:, None] + phase[:, :, None, :]
    rate = 0.6 * np.sin(angle[0]).sum(axis=0)
    C = Rotation.identity()
    attitude = [C := C * Rotation.from_rotvec(0.002 * step) for step in 0.5 * (rate[1:] + rate[:-1])]
    C_w_b = Rotation.concatenate([Rotation.identity(), *attitude])
    # Velocity and its derivative, in the world.
    velocity = np.array([0.3, -0.2, 0.1]) + 0.2 * np.sin(angle[1]).sum(axis=0)
    acceleration = 0.2 * (6.28 * hertz[1][:, None, :] * np.cos(angle[1])).sum(axis=0)
    gyroscope, accelerometer = (np.zeros(t.size, dtype=INERTIAL_DTYPE) for _ in range(2))
    gyroscope["t_ns"] = accelerometer["t_ns"] = np.round(1e9 * t).astype(np.int64)
    gyroscope["xyz"] = rate + 0.01 + 0.01 * rng.standard_normal(rate.shape)
    accelerometer["xyz"] = C_w_b.inv().apply(acceleration + np.array([0.0, 5.0, 8.44])) + 0.1
    windows = np.arange(10, t.size - 10, 25)
    return (
        gyroscope,
        accelerometer,
        gyroscope["t_ns"][windows],
        C_w_b[windows].inv().apply(velocity[windows]) @ C_C_B.T,
    )


def model_of(seconds: float, focal: float, scale: float, rng: np.random.Generator) -> RateModel:
    """Rates that a camera with this error of its focal length sees, while it translates."""
    gyroscope, accelerometer, middle_ns, velocity = motion(seconds, rng)
    apparent = apparent_rotation(DAVIS)
    turn = TurnOf(gyroscope)
    basis, sigma = velocity_basis(middle_ns, turn, TurnOf(accelerometer), C_C_B)
    body = np.stack([np.interp(middle_ns, gyroscope["t_ns"], axis) for axis in gyroscope["xyz"].T], axis=1)
    camera = (body - 0.01) @ C_C_B.T @ (np.eye(3) + np.log(focal) * apparent.of_focal).T
    camera += velocity / DEPTH_M @ apparent.of_translation.T + 0.02 * rng.standard_normal(camera.shape)
    count = len(middle_ns)
    return RateModel(camera, scale * body, np.ones(count - 1), 4.0 * seconds, C_C_B, apparent, basis, sigma)


@pytest.mark.parametrize("focal", [1.0, 1.05, 0.9])
@pytest.mark.parametrize("seconds", [3.0, 7.0])
def test_the_focal_length_is_found_while_the_camera_translates(
    focal: float, seconds: float, rng: np.random.Generator
) -> None:
    found = gains_of(model_of(seconds, focal, 1.0, rng))
    assert found.focal_observable
    assert found.focal_sigma < 0.015
    assert found.focal == pytest.approx(focal, rel=0.025)


def test_without_the_accelerometer_translation_hides_it(rng: np.random.Generator) -> None:
    model = model_of(3.0, 1.0, 1.0, rng)
    without = dataclasses.replace(
        model, velocity=model.velocity[:, :, :0], velocity_sigma=model.velocity_sigma[:0]
    )
    assert gains_of(without).focal_sigma > 1.5 * gains_of(model).focal_sigma


def test_a_wrong_scale_of_the_gyroscope_is_separate(rng: np.random.Generator) -> None:
    found = gains_of(model_of(5.0, 1.05, 1.1, rng))
    assert found.gyroscope == pytest.approx(1.1, rel=0.025)
    assert found.focal == pytest.approx(1.05, rel=0.03)


def test_too_few_windows_have_no_velocity(rng: np.random.Generator) -> None:
    gyroscope, accelerometer, middle_ns, _ = motion(3.0, rng)
    turn, force = TurnOf(gyroscope), TurnOf(accelerometer)
    assert velocity_basis(middle_ns[::10], turn, force, C_C_B)[0].shape == (6, 3, 0)
    assert velocity_basis(middle_ns, turn, force, C_C_B)[0].shape == (len(middle_ns), 3, 7)
    long = motion(7.0, rng)
    assert velocity_basis(long[2], TurnOf(long[0]), TurnOf(long[1]), C_C_B)[0].shape[2] == 14
