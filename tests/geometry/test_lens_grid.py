"""A grid of lenses of every kind: no crash, correct inverse in the valid disc, folds are found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from asyneio.geometry import distortion
from asyneio.geometry.camera import CameraModel
from asyneio.types import CameraIntrinsics, Distortion, FloatArray

RADTAN, EQUIDISTANT = Distortion.RADTAN, Distortion.EQUIDISTANT
#: Sizes of one coefficient: below what squares can hold, negligible, real, folding, absurd.
SIZES = (5e-324, 1e-200, 1e-17, 1e-9, 1e-3, 0.03, 0.3, 2.0, 100.0, 1e6)
COUNTS = ((RADTAN, 4), (RADTAN, 5), (RADTAN, 8), (RADTAN, 12), (RADTAN, 14), (EQUIDISTANT, 4))

Coefficients = tuple[float, ...]


def single(count: int) -> list[Coefficients]:
    """All zero, and each coefficient alone in all sizes; the tilt of a sensor stays zero."""
    found: list[Coefficients] = [(0.0,) * count]
    for index in range(min(count, 12)):
        for size in SIZES:
            for sign in (-1.0, 1.0):
                found.append(tuple(sign * size if i == index else 0.0 for i in range(count)))
    return found


def drawn(count: int) -> list[Coefficients]:
    """Several at once: tangential alone, of one size, and at random."""
    rng = np.random.default_rng(count)
    found = [tuple(0.05 if i in (2, 3) else 0.0 for i in range(count))]
    for size in SIZES[:-1]:
        for _ in range(4):
            values = size * rng.uniform(-1.0, 1.0, count)
            values[12:] = 0.0
            found.append(tuple(values.tolist()))
    return found


def disc(lens: distortion.Lens) -> FloatArray:
    """Points (N,2) of the valid disc, its middle and its rim included, up to 80 degrees from the axis."""
    radius = min(lens.max_radius, math.tan(1.4))
    radii = radius * np.array([0.0, 1e-8, 1e-3, 0.1, 0.3, 0.5, 0.7, 0.9, 0.999])
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False) + 0.1
    return np.array([[r * math.cos(t), r * math.sin(t)] for r in radii for t in angles])


def smallest_eigenvalue(jacobian: tuple[float, ...]) -> float:
    """Of the symmetric part: positive where the criterion of `Lens.max_radius` holds."""
    a, b, c, d = jacobian
    return 0.5 * (a + d) - math.hypot(0.5 * (a - d), 0.5 * (b + c))


@pytest.mark.slow
@pytest.mark.parametrize(("model", "count"), COUNTS)
def test_each_lens_is_inverted_in_its_valid_disc(model: Distortion, count: int) -> None:
    wrong = []
    for coefficients in single(count) + drawn(count):
        lens = distortion.make_lens(model, coefficients)
        assert lens.max_radius > 0.0
        for x, y in disc(lens):
            x_d, y_d, *jacobian = distortion.distort(lens, x, y)
            assert np.isfinite([x_d, y_d, *jacobian]).all()
            found = distortion.undistort(lens, x_d, y_d, *distortion.cold_start(lens, x_d, y_d))
            off = math.hypot(found[0] - x, found[1] - y)
            if found[-1] != distortion.SOLVED or not off < 1e-8 * (1.0 + math.hypot(x, y)):
                wrong.append((coefficients, lens.max_radius, (float(x), float(y)), found))
    assert wrong == []


@pytest.mark.slow
@pytest.mark.parametrize(("model", "count"), COUNTS)
def test_the_disc_ends_at_the_fold_and_only_there(model: Distortion, count: int) -> None:
    for coefficients in single(count) + drawn(count):
        lens = distortion.make_lens(model, coefficients)
        inside, outside = (
            [
                smallest_eigenvalue(distortion.distort(lens, r * math.cos(t), r * math.sin(t))[2:])
                for t in np.arange(72) * 2.0 * np.pi / 72
            ]
            for r in (0.999 * min(lens.max_radius, 14.0), beyond(lens))
        )
        assert min(inside) > 0.0, coefficients
        whole = math.atan(lens.max_radius) > distortion.MAX_ANGLE - 1e-3
        assert whole or not min(outside) > 0.0, coefficients


def beyond(lens: distortion.Lens) -> float:
    """A radius just past the fold of a lens that has one."""
    if lens.model == distortion.EQUIDISTANT:
        return math.tan(min(math.atan(lens.max_radius) / distortion.FOLD_MARGIN * 1.00001, 1.55))
    return min(lens.max_radius, 1e3) / distortion.FOLD_MARGIN * 1.00001


@pytest.mark.slow
@pytest.mark.parametrize(("model", "count"), COUNTS)
def test_no_camera_crashes_and_none_gives_nan_for_valid(model: Distortion, count: int) -> None:
    u, v = np.meshgrid(np.linspace(-0.5, 59.5, 13), np.linspace(-0.5, 44.5, 11))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    for coefficients in single(count)[::3] + drawn(count)[::3]:
        camera = CameraModel(CameraIntrinsics(50.0, 50.0, 33.0, 27.0, 60, 45, model, coefficients))
        xy, jac, valid = camera.undistort(uv)
        assert np.isfinite(xy[valid]).all()
        assert np.isfinite(jac[valid]).all()
        assert np.isnan(xy[~valid]).all()
        back, seen = camera.project(np.column_stack([xy[valid], np.ones(int(valid.sum()))]))
        np.testing.assert_allclose(back[seen], uv[valid][seen], atol=1e-6)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_radtan_of_zeros_is_no_distortion(count: int) -> None:
    plain = CameraIntrinsics(199.0, 198.0, 132.0, 110.0, 240, 180)
    zeros = CameraIntrinsics(199.0, 198.0, 132.0, 110.0, 240, 180, RADTAN, (0.0,) * count)
    uv = np.random.default_rng(0).uniform(0.0, 179.0, (100, 2))
    for ours, theirs in zip(CameraModel(zeros).undistort(uv), CameraModel(plain).undistort(uv), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_more_coefficients_that_are_zero_change_nothing() -> None:
    short = (-0.3, 0.1, 1e-3, -5e-4)
    few = distortion.make_lens(RADTAN, short)
    for count in (5, 8, 12, 14):
        many = distortion.make_lens(RADTAN, (*short, *(0.0,) * (count - 4)))
        assert many.max_radius == few.max_radius
        assert distortion.distort(many, 0.4, -0.3) == distortion.distort(few, 0.4, -0.3)


@pytest.mark.parametrize(
    ("coefficients", "fold"),
    [
        ((-1 / 3, 0.0, 0.0, 0.0), 1.0),  # 1 + 3 k1 r² = 0
        ((-1e6, 0.0, 0.0, 0.0), math.sqrt(1 / 3e6)),
        ((0.0, -0.2, 0.0, 0.0), 1.0),  # 1 + 5 k2 r⁴ = 0
        ((0.0, 0.0, 0.0, 0.0, -1 / 7), 1.0),  # 1 + 7 k3 r⁶ = 0
        ((0.0, 0.0, 0.1, 0.0), 1 / 0.6),  # the decentring alone folds where 6 p1 r = 1
        ((0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0), 1.0),  # r / (1 + r²) turns at 1
        ((0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0), 2.0),  # pole of 1 / (1 - r²/4)
    ],
)
def test_known_folds(coefficients: Coefficients, fold: float) -> None:
    lens = distortion.make_lens(RADTAN, coefficients)
    assert lens.max_radius == pytest.approx(distortion.FOLD_MARGIN * fold, rel=1e-6)
