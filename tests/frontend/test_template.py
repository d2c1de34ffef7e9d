"""The gradient template, its registration, and what it says of its own error."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.frontend.gradient.features import TEMPLATE_SIDE, TEMPLATE_SIZE
from asyneio.frontend.gradient.template import learn, match, synthesise
from asyneio.types import FloatArray, RecordArray
from tests.conftest import SEED
from tests.frontend.patches import (
    blobs,
    flatten,
    grid,
    make_feature,
    make_work,
    patch_of,
    template_of,
    unflatten,
)

ITERATIONS = 6
MAX_JUMP = 2.9
MIN_CORNER = 0.01


def registered(picture_patch: FloatArray, template: FloatArray) -> tuple[bool, RecordArray]:
    work = make_work()
    work["blurred"], work["template"] = picture_patch, template
    good = match(work[0], MAX_JUMP, MIN_CORNER, ITERATIONS, work[0]["match"])
    return good, work


def test_two_directions_teach_a_third() -> None:
    rng = np.random.default_rng(SEED)
    G = rng.normal(0, 1, (2, TEMPLATE_SIDE, TEMPLATE_SIDE))
    feature, work = make_feature(), make_work()
    sums = np.zeros((1, 2, TEMPLATE_SIZE), dtype=np.float32)
    for sx, sy in ((2.0, 0.3), (0.2, -1.8)):
        work["shifted"] = flatten(sx * G[0] + sy * G[1])
        learn(feature[0], sums, 0, sx, sy, 0.9, work[0])
    for sx, sy in ((-1.1, 1.4), (2.0, 2.0)):
        synthesise(feature[0], sums, 0, sx, sy, 1e-6, work[0])
        np.testing.assert_allclose(unflatten(work["template"][0]), sx * G[0] + sy * G[1], atol=1e-3)


def test_a_direction_never_seen_gives_next_to_nothing() -> None:
    G = template_of(blobs(SEED))
    feature, work = make_feature(), make_work()
    sums = np.zeros((1, 2, TEMPLATE_SIZE), dtype=np.float32)
    work["shifted"] = 2.0 * G
    learn(feature[0], sums, 0, 2.0, 0.0, 1.0, work[0])
    synthesise(feature[0], sums, 0, 2.0, 0.0, 0.1, work[0])
    np.testing.assert_allclose(work["template"][0], 2.0 * G * 4.0 / 4.1, atol=1e-4)
    synthesise(feature[0], sums, 0, 0.0, 2.0, 0.1, work[0])
    assert not work["template"][0].any()


@settings(max_examples=40)
@given(
    seed=st.integers(0, 1000),
    du=st.floats(-2.4, 2.4),
    dv=st.floats(-2.4, 2.4),
    gain=st.floats(0.2, 5.0),
)
def test_shifts_are_recovered(seed: int, du: float, dv: float, gain: float) -> None:
    picture = blobs(seed)
    # From within a radius of convergence that every picture has.
    du, dv = 0.5 * du, 0.5 * dv
    good, work = registered(gain * patch_of(picture, du, dv), template_of(picture))
    assert good
    assert work["match"]["u"][0] == pytest.approx(du, abs=0.05)
    assert work["match"]["v"][0] == pytest.approx(dv, abs=0.05)
    assert work["match"]["ncc"][0] > 0.99
    assert np.abs(work["match"]["apart_h"]).max() < 0.1
    assert np.abs(work["match"]["apart_v"]).max() < 0.1


def test_hessian_and_residual_are_those_of_the_weighted_patch() -> None:
    rng = np.random.default_rng(SEED)
    template = unflatten(template_of(blobs(SEED)))
    patch = unflatten(patch_of(blobs(SEED))) + 0.05 * rng.normal(0, 1, (29, 29))
    good, work = registered(flatten(patch), flatten(template))
    assert good
    W, T = unflatten(work["shifted"][0]), template
    weight = unflatten(work["weight"][0])
    gain = np.sum(weight * W * T) / np.sum(weight * T * T)
    gy, gx = ((a + gain * b) / 2 for a, b in zip(np.gradient(W), np.gradient(T), strict=True))
    found = work["match"][0]
    assert found["xx"] == pytest.approx(np.sum(weight * gx * gx), rel=1e-3)
    assert found["xy"] == pytest.approx(np.sum(weight * gx * gy), rel=1e-3, abs=0.01 * found["xx"])
    assert found["yy"] == pytest.approx(np.sum(weight * gy * gy), rel=1e-3)
    assert found["residual"] == pytest.approx(np.sum(weight * (W - gain * T) ** 2), rel=1e-3)


def test_scatter_under_noise_follows_the_inverse_hessian() -> None:
    """White noise of sigma in the patch: covariance H^-1 (sum w^2 J J^T) H^-1 sigma^2."""
    rng = np.random.default_rng(SEED)
    sigma, picture = 0.3, blobs(SEED, 6)
    clean, template = patch_of(picture), template_of(picture)
    shifts = []
    for _ in range(300):
        good, work = registered(clean + sigma * rng.normal(0, 1, clean.shape), template)
        assert good
        shifts.append([work["match"]["u"][0], work["match"]["v"][0]])
    gy, gx = np.gradient(unflatten(template))
    weight = unflatten(work["weight"][0])
    J = np.stack([gx, gy])
    H = np.einsum("yx,iyx,jyx->ij", weight, J, J)
    expected = np.linalg.inv(H) @ np.einsum("yx,iyx,jyx->ij", weight**2, J, J) @ np.linalg.inv(H) * sigma**2
    scatter = np.cov(np.array(shifts).T)
    ratio = np.sort(np.linalg.eigvals(np.linalg.solve(expected, scatter)).real)
    # Noise also blurs the patch's own gradient and is interpolated: a factor of two is what theory promises.
    assert 0.4 < ratio[0] <= ratio[1] < 1.6


def test_halves_that_part_are_noticed() -> None:
    picture = blobs(SEED)
    x, _ = grid(29)
    apart = []
    for gap in (0.0, 0.3, 0.6, 0.9):
        near, far = unflatten(patch_of(picture)), unflatten(patch_of(picture, gap, 0.0))
        good, work = registered(flatten(np.where(x < 0, near, far)), template_of(picture))
        assert good
        apart.append(work["match"]["apart_h"][0])
    lengths = np.hypot(*np.array(apart).T)
    assert lengths[0] < 0.02
    assert np.all(np.diff(lengths) > 0.1)
    assert apart[-1][0] == pytest.approx(0.9, rel=0.5)


def test_no_corner_no_signal_and_too_far_a_jump_are_rejected() -> None:
    picture = blobs(SEED)
    template = template_of(picture)
    nothing = np.zeros_like(template_of(picture))
    assert not registered(patch_of(picture), nothing)[0]
    assert not registered(0 * patch_of(picture), template)[0]
    assert not registered(-patch_of(picture), template)[0]
    edge = patch_of(lambda x, y: np.exp(-((x - 0.5) ** 2) / 8) + 0 * y)
    assert not registered(edge, template_of(lambda x, y: np.exp(-(x**2) / 8) + 0 * y))[0]
    slope = patch_of(lambda x, y: np.exp(-((x - 5) ** 2 + (y - 4) ** 2) / 60))
    assert not registered(slope, template_of(lambda x, y: np.exp(-(x**2 + y**2) / 60)))[0]
