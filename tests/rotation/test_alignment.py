"""Rotation and offset from simulated rates, against the truth; the rate of rotating points."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.doctor.checks.extrinsics import describe_axes, describe_turn, likely_mistake
from asyneio.rotation.alignment import RIGHT_ANGLES, align
from asyneio.rotation.camera_rates import CameraRates, rates_from_tracks
from asyneio.rotation.sharpness import find_rate
from asyneio.types import INERTIAL_DTYPE, OBSERVATION_DTYPE, CameraIntrinsics, FloatArray, RecordArray

SECONDS = 4.0


def rate_at(t: FloatArray) -> FloatArray:
    """Angular rates about changing axes (N,3) [rad/s]."""
    return np.stack([0.8 * np.sin(3.1 * t), 0.6 * np.cos(4.3 * t + 0.3), 0.7 * np.sin(2.2 * t + 1.0)], axis=1)


def gyroscope_of(
    rate: FloatArray, t: FloatArray, rng: np.random.Generator, bias: FloatArray | float = 0.0
) -> RecordArray:
    stream = np.zeros(t.size, dtype=INERTIAL_DTYPE)
    stream["t_ns"] = np.round(t * 1e9)
    stream["xyz"] = rate + bias + 0.005 * rng.standard_normal(rate.shape)
    return stream


def camera_rates(
    C_c_b: FloatArray, offset_s: float, rng: np.random.Generator, axis: bool = False
) -> CameraRates:
    """Rates of a camera in 60 windows of 30 ms, with a clock behind by `offset_s`, noise, and a slow leak of
    its translation about x and y."""
    start = np.linspace(0.2, SECONDS - 0.3, 60)
    middle = start + 0.015 + offset_s
    rate = rate_at(middle) * ([0.0, 0.0, 1.0] if axis else [1.0, 1.0, 1.0])
    leak = 0.06 * np.stack([np.sin(0.9 * start), np.cos(1.1 * start), 0.0 * start], axis=1)
    omega = rate @ C_c_b.T + leak + 0.02 * rng.standard_normal((60, 3))
    t_ns = np.round(start * 1e9).astype(np.int64)
    return CameraRates(t_ns, t_ns + 30_000_000, omega)


@pytest.mark.parametrize("seed", range(4))
def test_rotation_and_offset_are_found_for_any_claimed_rotation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true, claimed = Rotation.random(2, random_state=seed).as_matrix()
    offset_s = rng.uniform(-0.06, 0.06)
    t = np.arange(0.0, SECONDS, 0.002)
    bias = 0.02 * rng.standard_normal(3)
    found = align(camera_rates(true, offset_s, rng), gyroscope_of(rate_at(t), t, rng, bias), claimed, 0.0)
    assert found is not None
    error = np.degrees(Rotation.from_matrix(found.C_c_b @ true.T).magnitude())
    # The leak limits the accuracy more than the noise does.
    assert error < 4.0
    assert error < 4.0 * np.linalg.norm(found.sigma_deg)
    assert found.offset_s == pytest.approx(offset_s, abs=0.004)
    assert found.explained > 0.9
    assert found.error_deg(claimed, 180.0) == pytest.approx(
        np.degrees(Rotation.from_matrix(claimed @ true.T).magnitude()), abs=5.0
    )


def test_two_directions_are_observable_from_a_rotation_about_one_axis(rng: np.random.Generator) -> None:
    true = RIGHT_ANGLES[5]
    t = np.arange(0.0, SECONDS, 0.002)
    gyroscope = gyroscope_of(rate_at(t) * [0.0, 0.0, 1.0], t, rng)
    claimed = true @ Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix()
    found = align(camera_rates(true, 0.0, rng, axis=True), gyroscope, claimed, 0.0)
    assert found is not None
    assert np.count_nonzero(found.sigma_deg <= 12.0) == 2
    # The observable directions agree with any rotation about that axis.
    assert found.error_deg(claimed, 12.0) < 6.0
    tilted = Rotation.from_rotvec(true @ [1.0, 0.0, 0.0]).as_matrix() @ true
    assert found.error_deg(tilted, 12.0) == pytest.approx(57.3, abs=8.0)


@pytest.mark.slow
def test_nothing_is_observable_from_a_stationary_sensor(rng: np.random.Generator) -> None:
    t = np.arange(0.0, SECONDS, 0.002)
    still = camera_rates(np.eye(3), 0.0, rng)
    still = dataclasses.replace(still, omega=0.02 * rng.standard_normal((60, 3)))
    found = align(still, gyroscope_of(np.zeros((t.size, 3)), t, rng), np.eye(3), 0.0)
    assert found is not None
    assert np.count_nonzero(found.sigma_deg <= 12.0) == 0
    few = CameraRates(still.start_ns[:3], still.end_ns[:3], still.omega[:3])
    assert align(few, gyroscope_of(rate_at(t), t, rng), np.eye(3), 0.0) is None


@pytest.mark.slow
def test_degrees_show_in_the_scale(rng: np.random.Generator) -> None:
    t = np.arange(0.0, SECONDS, 0.002)
    found = align(
        camera_rates(np.eye(3), 0.0, rng), gyroscope_of(np.degrees(rate_at(t)), t, rng), np.eye(3), 0.0
    )
    assert found is not None
    assert found.explained < 0.3
    assert 1.0 / found.scale == pytest.approx(57.3, rel=0.2)


@pytest.mark.slow
def test_common_mistakes_are_named(rng: np.random.Generator) -> None:
    claimed = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    t = np.arange(0.0, SECONDS, 0.002)
    for true, words in (
        (claimed.T, "the inverse"),
        (np.diag([1.0, -1.0, -1.0]) @ claimed, "mirrored left to right"),
        (np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ claimed, "x and y of the image exchanged"),
        (Rotation.from_rotvec([0.0, 0.0, 0.6]).as_matrix() @ claimed, ""),
    ):
        found = align(camera_rates(true, 0.0, rng), gyroscope_of(rate_at(t), t, rng), claimed, 0.0)
        assert found is not None
        mistake = likely_mistake(found, claimed)
        assert words in mistake
        assert bool(words) == bool(mistake)


def test_the_24_rotations_by_right_angles_have_distinct_names() -> None:
    assert len(RIGHT_ANGLES) == 24
    assert np.array_equal(RIGHT_ANGLES[0], np.eye(3))
    names = {describe_axes(turn) for turn in RIGHT_ANGLES}
    assert len(names) == 24
    assert all(np.linalg.det(turn) > 0.0 for turn in RIGHT_ANGLES)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert describe_axes(quarter) == "x -> y, y -> -x, z -> z"
    assert "turned by 90 deg" in describe_turn(quarter)
    assert "turned by -90 deg" in describe_turn(quarter.T)
    assert "mirrored top to bottom" in describe_turn(np.diag([-1.0, 1.0, -1.0]))
    assert "upside down" in describe_turn(np.diag([-1.0, -1.0, 1.0]))


@pytest.mark.parametrize("omega", [(0.0, 0.0, 1.5), (1.0, -0.4, 0.3), (-0.2, 0.8, -1.0)])
def test_the_true_rate_gives_the_sharpest_image(
    omega: tuple[float, float, float], rng: np.random.Generator
) -> None:
    """Static points that fire at random times while the camera rotates."""
    true = np.array(omega)
    points = np.column_stack([rng.uniform(-0.6, 0.6, (150, 2)), np.ones(150)])
    t = np.sort(rng.uniform(0.0, 0.05, 6000))
    seen = Rotation.from_rotvec(-(t - 0.025)[:, None] * true).apply(points[rng.integers(0, 150, t.size)])
    xy = seen[:, :2] / seen[:, 2:]
    focal = 200.0
    # Events have integer pixels.
    found, gain = find_rate(np.rint(xy * focal) / focal, t, float(np.linalg.norm(true)), focal)
    np.testing.assert_allclose(found, true, atol=0.04)
    assert gain > 0.3


def test_rates_of_tracks_are_robust_to_outliers_and_translation(rng: np.random.Generator) -> None:
    camera = CameraIntrinsics(200.0, 200.0, 160.0, 120.0, 320, 240)
    true = np.array([0.3, -0.5, 0.8])
    points = np.column_stack([rng.uniform(-0.5, 0.5, (40, 2)), np.ones(40)]) * rng.uniform(3.0, 9.0, (40, 1))
    rows = []
    for k, t in enumerate(np.arange(0.0, 0.4, 0.02)):
        seen = Rotation.from_rotvec(-t * true).apply(points) - t * np.array([0.1, 0.0, 0.05])
        uv = 200.0 * seen[:, :2] / seen[:, 2:] + [160.0, 120.0]
        uv[:5] += 6.0 * k
        rows += [(round(t * 1e9), n, u, v, (0.0, 0.0, 0.0)) for n, (u, v) in enumerate(uv)]
    found = rates_from_tracks(np.array(rows, dtype=OBSERVATION_DTYPE), camera)
    assert found.count == 4
    np.testing.assert_allclose(found.omega, np.broadcast_to(true, (4, 3)), atol=0.06)
