"""Linear alignment: velocity and gravity from tracks and an ideal IMU, with noise and without parallax."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asyneio.errors import EstimationError
from asyneio.initialization.alignment import Alignment, align
from asyneio.simulation import AnalyticMotion, MotionStyle
from tests.initialization.ideal import GRAVITY, Aligned, ideal, sinusoidal, styled

SEEDS = range(6)


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def aligned(motion: AnalyticMotion, seed: int, **options: object) -> tuple[Alignment, Aligned]:
    truth = ideal(motion, seed, **options)  # type: ignore[arg-type]
    return align(truth.data, GRAVITY), truth


@pytest.mark.parametrize("style", [MotionStyle.MODERATE, MotionStyle.AGGRESSIVE])
@pytest.mark.parametrize("seed", range(4))
def test_velocity_and_gravity_are_recovered_without_noise(style: str, seed: int) -> None:
    found, truth = aligned(styled(style, seed), seed)
    speed = np.linalg.norm(truth.velocity)
    assert np.linalg.norm(found.velocity - truth.velocity) < 5e-4 * speed
    assert angle_deg(found.gravity, truth.gravity) < 2e-3
    assert found.residual_rad < 2e-6


@pytest.mark.parametrize("gravity", [9.78, GRAVITY, 9.83])
def test_gravity_has_the_magnitude_it_was_told(gravity: float) -> None:
    truth = ideal(styled(MotionStyle.MODERATE, 1), seed=1, sigma_rad=2e-3)
    assert np.linalg.norm(align(truth.data, gravity).gravity) == pytest.approx(gravity, rel=1e-12)


@pytest.mark.parametrize("style", [MotionStyle.MODERATE, MotionStyle.AGGRESSIVE])
def test_noise_costs_accuracy_gradually(style: str) -> None:
    """Median over draws, noise doubled three times: 0.04 to 0.32 pixels of a 200 pixel lens."""
    velocity, gravity = [], []
    for sigma in (2e-4, 4e-4, 8e-4, 1.6e-3):
        runs = [aligned(styled(style, 0), seed, sigma_rad=sigma) for seed in SEEDS]
        velocity.append(np.median([np.linalg.norm(f.velocity - t.velocity) for f, t in runs]))
        gravity.append(np.median([angle_deg(f.gravity, t.gravity) for f, t in runs]))
        for found, _ in runs:
            # Two components of a ray are measured, and the landmarks take some of the noise.
            assert 1.2 * sigma < found.residual_rad < 1.45 * sigma
    assert np.all(np.diff(velocity) > 0.0)
    assert np.all(np.diff(gravity) > 0.0)
    assert velocity[-1] < 0.1
    assert gravity[-1] < 1.5


def test_samples_that_disagree_with_the_tracks_show_in_the_residual() -> None:
    """A drift of 5 cm after a second that no velocity and no gravity explains."""
    data = ideal(styled(MotionStyle.AGGRESSIVE, 2), seed=2).data
    drift = np.array([0.05, 0.0, 0.0]) * data.t[:, None] ** 3
    assert align(data, GRAVITY).residual_rad < 1e-6
    assert align(replace(data, offset=data.offset + drift), GRAVITY).residual_rad > 1e-4


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("angle", [0.0, 0.3], ids=["no motion", "pure rotation"])
@pytest.mark.parametrize("sigma", [0.0, 1e-3])
def test_without_parallax_it_refuses(seed: int, angle: float, sigma: float) -> None:
    truth = ideal(sinusoidal(0.0, angle), seed, sigma_rad=sigma, T_b_c=np.eye(4))
    with pytest.raises(EstimationError, match="show parallax"):
        align(truth.data, GRAVITY, sigma)


@pytest.mark.parametrize(("sigma", "tolerance"), [(1e-3, 0.01), (2.5e-3, 0.03)])
def test_noise_does_not_shrink_the_velocity(sigma: float, tolerance: float) -> None:
    """Half a pixel at f = 200 px took a tenth of the scale before the projector was compensated."""
    ratios = []
    for seed in range(4):
        truth = ideal(styled(MotionStyle.MODERATE, seed), seed, sigma_rad=sigma)
        velocity = align(truth.data, GRAVITY, sigma).velocity
        ratios.append(velocity @ truth.velocity / (truth.velocity @ truth.velocity))
    assert abs(np.mean(ratios) - 1.0) < tolerance


def test_a_track_without_observations_is_refused() -> None:
    data = ideal(styled(MotionStyle.MODERATE, 1), 0).data
    with pytest.raises(EstimationError, match="without observations"):
        align(replace(data, tracks=data.tracks + 1), GRAVITY)


def test_a_single_instant_is_refused() -> None:
    truth = ideal(styled(MotionStyle.MODERATE, 0), seed=0)
    instant = replace(truth.data, t=np.zeros_like(truth.data.t))
    with pytest.raises(EstimationError, match="expected translation with parallax"):
        align(instant, GRAVITY)


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.0, "found no gravity"), (np.nan, "not finite")],
    ids=["free fall", "corrupt"],
)
def test_no_gravity_in_the_samples_is_refused(value: float, words: str) -> None:
    truth = ideal(styled(MotionStyle.MODERATE, 0), seed=0)
    with pytest.raises(EstimationError, match=words):
        align(replace(truth.data, offset=np.full_like(truth.data.offset, value)), GRAVITY)
