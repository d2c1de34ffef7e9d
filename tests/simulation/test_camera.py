"""Projection against closed forms, and the edge of the distortion model."""

import dataclasses

import numpy as np
import pytest

from asyneio.errors import SimulationError
from asyneio.simulation import PinholeCamera
from asyneio.simulation.camera import turning_radius
from asyneio.types import CameraIntrinsics, Distortion

PLAIN = CameraIntrinsics(200.0, 190.0, 120.0, 90.0, 240, 180)
RADTAN = dataclasses.replace(PLAIN, distortion=Distortion.RADTAN, coefficients=(-0.37, 0.15, -0.0003, 0.0008))


def test_plain_pinhole() -> None:
    pixels, valid = PinholeCamera.from_intrinsics(PLAIN).project(np.array([[0.5, -0.25, 2.0]]))
    np.testing.assert_allclose(pixels, [[170.0, 66.25]])
    assert valid.all()


def test_radtan_on_one_point() -> None:
    pixels, _ = PinholeCamera.from_intrinsics(RADTAN).project(np.array([[0.3, 0.4, 1.0]]))
    r2 = 0.25
    radial = 1.0 - 0.37 * r2 + 0.15 * r2**2
    x = 0.3 * radial + 2.0 * -0.0003 * 0.12 + 0.0008 * (r2 + 0.18)
    y = 0.4 * radial - 0.0003 * (r2 + 0.32) + 2.0 * 0.0008 * 0.12
    np.testing.assert_allclose(pixels, [[200.0 * x + 120.0, 190.0 * y + 90.0]], rtol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.3, 1.2])
def test_equidistant_radius_is_the_polynomial_of_the_angle(angle: float) -> None:
    k = (0.01, -0.02, 0.003, -0.0004)
    model = dataclasses.replace(PLAIN, distortion=Distortion.EQUIDISTANT, coefficients=k)
    pixels, valid = PinholeCamera.from_intrinsics(model).project(
        np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    )
    expected = angle + sum(c * angle ** (2 * n + 3) for n, c in enumerate(k))
    np.testing.assert_allclose(pixels[0], [200.0 * expected + 120.0, 90.0], rtol=1e-13)
    assert valid.all()


def test_points_beyond_the_turning_radius_are_not_visible() -> None:
    model = dataclasses.replace(RADTAN, coefficients=(-0.4, 0.0, 0.0, 0.0))
    radius = turning_radius(model)
    np.testing.assert_allclose(radius, np.sqrt(1.0 / 1.2))
    camera = PinholeCamera.from_intrinsics(model)
    pixels, valid = camera.project(np.array([[radius - 1e-6, 0.0, 1.0], [radius + 1e-6, 0.0, 1.0]]))
    np.testing.assert_array_equal(valid, [True, False])
    assert np.isfinite(pixels).all()


def test_the_turning_radius_uses_the_third_radial_coefficient() -> None:
    assert turning_radius(dataclasses.replace(RADTAN, coefficients=(0.1, 0.1, 0.0, 0.0))) == np.inf
    radius = turning_radius(dataclasses.replace(RADTAN, coefficients=(0.1, 0.1, 0.0, 0.0, -0.2)))
    slope = 1.0 + 0.3 * radius**2 + 0.5 * radius**4 - 1.4 * radius**6
    assert abs(slope) < 1e-12


def test_behind_and_outside_are_not_visible() -> None:
    camera = PinholeCamera.from_intrinsics(PLAIN)
    points = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.6, 0.0, 1.0], [0.56, 0.0, 1.0]])
    _, valid = camera.project(points)
    np.testing.assert_array_equal(valid, [False, False, True, True])
    np.testing.assert_array_equal(camera.visible(points, 0.0)[1], [False, False, False, True])
    np.testing.assert_array_equal(camera.visible(points, 8.0)[1], [False, False, False, False])


def test_wrong_number_of_coefficients_is_refused() -> None:
    with pytest.raises(SimulationError, match="3 distortion coefficients for radtan; expected 4 or 5"):
        PinholeCamera.from_intrinsics(dataclasses.replace(RADTAN, coefficients=(0.1, 0.2, 0.3)))
