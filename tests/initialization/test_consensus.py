"""Consensus of tracks on one motion: inliers, and the gyroscope bias."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.initialization.alignment import AlignmentData
from asyneio.initialization.consensus import BiasEffect, Consensus, find_consensus
from tests.initialization.ideal import GRAVITY, ideal, styled

Array = NDArray[np.float64]

SIGMA = 1e-3


def without_bias(data: AlignmentData) -> BiasEffect:
    """A gyroscope bias has no effect: rays and offsets are exact."""
    none = np.zeros((len(data.t), 3, 3))
    return BiasEffect(none, none)


def consensus(data: AlignmentData) -> Consensus:
    return find_consensus(data, without_bias(data), GRAVITY, SIGMA, 1e-3)


def on_an_object(data: AlignmentData, tracks: int, velocity: Array, distance_m: float = 2.0) -> AlignmentData:
    """The first tracks see points that move with a velocity [m/s], about so far away."""
    moving = data.track < tracks
    shift = np.outer(data.t - data.t.mean(), velocity) / distance_m
    direction = data.direction + np.where(moving[:, None], shift, 0.0)
    return replace(data, direction=direction / np.linalg.norm(direction, axis=1, keepdims=True))


@pytest.mark.parametrize("style", ["gentle", "moderate", "aggressive"])
def test_a_static_scene_agrees(style: str) -> None:
    for seed in range(4):
        agreeing = consensus(ideal(styled(style, seed), seed, SIGMA, span_s=1.0).data).agreeing
        assert np.count_nonzero(~agreeing) <= 3


@pytest.mark.parametrize("seed", range(4))
def test_a_third_on_an_object_is_found(seed: int) -> None:
    data = ideal(styled("aggressive", seed), seed, SIGMA, span_s=1.0, tracks=45).data
    velocity = np.random.default_rng(seed).normal(size=3)
    agreeing = consensus(on_an_object(data, 15, velocity / np.linalg.norm(velocity))).agreeing
    assert np.count_nonzero(agreeing[:15]) <= 4
    assert np.count_nonzero(~agreeing[15:]) <= 1


def test_no_verdict_on_few_tracks() -> None:
    data = ideal(styled("moderate", 0), 0, SIGMA, tracks=7).data
    found = consensus(on_an_object(data, 3, np.array([1.0, 1.0, 0.0])))
    assert found.agreeing.all()
    assert found.gyroscope_bias is None


def test_no_verdict_without_a_majority() -> None:
    data = ideal(styled("moderate", 0), 0, SIGMA, tracks=30).data
    rng = np.random.default_rng(0)
    velocity = rng.normal(size=(30, 3))
    direction = data.direction + data.t[:, None] * velocity[data.track]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    assert consensus(replace(data, direction=direction)).agreeing.all()


def test_the_same_verdict_every_time() -> None:
    data = on_an_object(ideal(styled("moderate", 3), 3, SIGMA).data, 12, np.array([0.5, 0.8, 0.0]))
    first, second = consensus(data), consensus(data)
    np.testing.assert_array_equal(first.agreeing, second.agreeing)


def test_finds_the_bias_of_the_gyroscope() -> None:
    """Rays of a sensor that rotates little, with a bias: each is rotated by t times the bias."""
    bias = np.array([0.006, -0.004, 0.003])
    for seed in range(3):
        data = ideal(styled("aggressive", seed), seed, 2e-4, tracks=80).data
        # d turned by -t b is d - t b x d; the derivative of what is seen by an assumed bias is the opposite.
        turned = data.direction + data.t[:, None] * np.cross(bias, data.direction)
        effect = BiasEffect(
            np.stack([-data.t[:, None] * np.cross(axis, data.direction) for axis in np.eye(3)], axis=2),
            np.zeros((len(data.t), 3, 3)),
        )
        found = find_consensus(replace(data, direction=turned), effect, GRAVITY, 2e-4, 0.01)
        assert found.gyroscope_bias is not None
        assert found.gyroscope_sigma < 0.005
        np.testing.assert_allclose(found.gyroscope_bias, bias, atol=3.0 * found.gyroscope_sigma)
        assert np.linalg.norm(found.gyroscope_bias - bias) < 0.6 * np.linalg.norm(bias)
