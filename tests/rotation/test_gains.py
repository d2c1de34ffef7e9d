"""Gyroscope scale and focal length from the image motion; offsets of seconds; unrelated motions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.rotation.alignment import align
from asyneio.rotation.apparent import apparent_rotation
from asyneio.rotation.camera_rates import CameraRates, pairs_from_tracks
from asyneio.rotation.epipolar import gains_of_tracks
from asyneio.rotation.focal import RateModel
from asyneio.rotation.gains import gains_of
from asyneio.types import OBSERVATION_DTYPE, CameraIntrinsics, FloatArray
from tests.rotation.test_alignment import SECONDS, camera_rates, gyroscope_of, rate_at

CAMERA = CameraIntrinsics(200.0, 200.0, 160.0, 120.0, 320, 240)


def model_of(camera: FloatArray, body: FloatArray) -> RateModel:
    """Rates of a camera with a narrow view and the axes of the body, which hardly translates."""
    narrow = apparent_rotation(dataclasses.replace(CAMERA, fx=5000.0, fy=5000.0))
    still = np.full((len(body), 3, 1), 1e-6)
    return RateModel(camera, body, np.ones(len(body) - 1), 40.0, np.eye(3), narrow, still, np.ones(1))


@pytest.mark.parametrize(("scale", "focal"), [(1.0, 1.0), (2.0, 1.0), (1.0, 1.05), (0.5, 0.9)])
def test_roll_gives_the_gyroscope_scale_and_other_rotations_the_focal_length(
    scale: float, focal: float, rng: np.random.Generator
) -> None:
    true = 0.7 * rng.standard_normal((64, 3))
    seen = true * [focal, focal, 1.0] + 0.02 * rng.standard_normal((64, 3))
    found = gains_of(model_of(seen, scale * true))
    assert found.gyroscope == pytest.approx(scale, rel=0.02)
    assert found.focal == pytest.approx(focal, rel=0.025)
    assert found.gyroscope_observable
    assert found.focal_observable


def test_the_focal_length_is_not_observable_under_translation(rng: np.random.Generator) -> None:
    true = 0.7 * rng.standard_normal((64, 3))
    leak = np.column_stack([0.3 * rng.standard_normal((64, 2)), np.zeros(64)])
    found = gains_of(model_of(true + leak + 0.02 * rng.standard_normal((64, 3)), true))
    assert found.gyroscope_observable
    assert not found.focal_observable
    assert not gains_of(model_of(true * 0.0, true * 0.01)).gyroscope_observable


@pytest.mark.parametrize("bias", [0.08, -0.08])
def test_a_bias_of_the_gyroscope_is_no_scale(bias: float, rng: np.random.Generator) -> None:
    """As in EuRoC: a slow roll to one side, with a bias as large as the roll."""
    true = np.column_stack([np.zeros((64, 2)), 0.1 + 0.1 * rng.standard_normal(64)])
    found = gains_of(model_of(true + 0.02 * rng.standard_normal((64, 3)), true + np.array([0.0, 0.0, bias])))
    assert found.gyroscope_observable
    assert abs(np.log(found.gyroscope)) < 2.5 * found.gyroscope_sigma


def tracks(rng: np.random.Generator) -> tuple[np.ndarray, FloatArray]:
    """Observations at 50 Hz of points at 1 to 4 m by a camera that moves around them, and its angular rates
    (20,3), each constant for 0.25 s."""
    rates = 0.9 * rng.standard_normal((20, 3))
    points = np.column_stack([rng.uniform(-2, 2, (500, 2)), rng.uniform(1.0, 4.0, 500)])
    C, r = Rotation.identity(), np.zeros(3)
    rows = []
    for k in range(250):
        t = 0.02 * k
        rate = rates[min(int(t / 0.25 + 1e-9), 19)]
        seen = C.inv().apply(points - r)
        ahead = seen[:, 2] > 0.3
        uv = 200.0 * seen[:, :2] / np.where(ahead, seen[:, 2], 1.0)[:, None] + [160.0, 120.0]
        inside = np.flatnonzero(ahead & (uv > 0).all(axis=1) & (uv < [320, 240]).all(axis=1))
        noisy = uv[inside] + 0.2 * rng.standard_normal((inside.size, 2))
        rows += [(round(t * 1e9), n, *pixel, (0.0, 0.0, 0.0)) for n, pixel in zip(inside, noisy, strict=True)]
        # It moves to the right while it rotates to the left, as around a table.
        r = r + 0.02 * C.apply([-0.8 * rate[1], 0.8 * rate[0], 0.1])
        C = C * Rotation.from_rotvec(0.02 * rate)
    return np.array(rows, dtype=OBSERVATION_DTYPE), rates


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "focal"), [(1.0, 1.0), (2.0, 1.0), (1.0, 1.05)])
def test_tracks_give_both_while_the_camera_moves_around_the_scene(
    scale: float, focal: float, rng: np.random.Generator
) -> None:
    observations, rates = tracks(rng)
    calibrated = dataclasses.replace(CAMERA, fx=200.0 / focal, fy=200.0 / focal)
    pairs, times = pairs_from_tracks(observations, calibrated)
    body = scale * rates[np.round(times.start_ns / 0.25e9).astype(int)] + 0.01
    found = gains_of_tracks(pairs, body, Rotation.from_rotvec([0.03, -0.02, 0.04]).as_matrix(), 1.1 * scale)
    assert found is not None
    assert found.gyroscope == pytest.approx(scale, rel=0.01)
    assert found.focal == pytest.approx(focal, rel=0.02)
    assert found.focal_observable
    assert gains_of_tracks(pairs.of(times.start_ns < 1e9), body[times.start_ns < 1e9], np.eye(3), 1.0) is None


@pytest.mark.slow
@pytest.mark.parametrize("offset_s", [-3.0, 0.25, 6.0])
def test_an_offset_of_seconds_is_found(offset_s: float, rng: np.random.Generator) -> None:
    t = np.arange(0.0, 30.0, 0.002)
    start = np.linspace(11.0, 19.0, 64)
    t_ns = np.round(start * 1e9).astype(np.int64)
    seen = irregular(start + 0.015 + offset_s) + 0.05 * rng.standard_normal((64, 3))
    found = align(
        CameraRates(t_ns, t_ns + 30_000_000, seen), gyroscope_of(irregular(t), t, rng), np.eye(3), 0.0
    )
    assert found is not None
    assert found.offset_s == pytest.approx(offset_s, abs=0.01)


def irregular(t: FloatArray) -> FloatArray:
    """Angular rates (N,3) that do not repeat."""
    rng = np.random.default_rng(5)
    hertz, phase = rng.uniform(0.2, 1.5, (9, 3)), rng.uniform(0.0, 6.28, (9, 3))
    return np.asarray(0.4 * np.sin(6.28 * hertz * t[:, None, None] + phase).sum(axis=1))


@pytest.mark.slow
def test_rolls_with_nothing_in_common_are_unrelated(rng: np.random.Generator) -> None:
    t = np.arange(0.0, SECONDS, 0.002)
    gyroscope = gyroscope_of(rate_at(t), t, rng)
    other = camera_rates(np.eye(3), 0.0, rng)
    other = dataclasses.replace(other, omega=0.6 * rng.standard_normal(other.omega.shape))
    found = align(other, gyroscope, np.eye(3), 0.0)
    assert found is not None
    assert found.explained < 0.3
    assert found.unrelated
    same = align(camera_rates(np.eye(3), 0.0, rng), gyroscope, np.eye(3), 0.0)
    assert same is not None
    assert not same.unrelated
