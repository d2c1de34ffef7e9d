"""Camera and lens: round trips, Jacobians by central differences, folding, validation of inputs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.errors import GeometryError
from asyneio.geometry import distortion
from asyneio.geometry.camera import CameraModel, look_up
from asyneio.types import CameraIntrinsics, Distortion, FloatArray

DAVIS = CameraIntrinsics(
    199.0924,
    198.8288,
    132.1921,
    110.7127,
    240,
    180,
    Distortion.RADTAN,
    (-0.368436, 0.150947, -0.00029613, -0.00075943),
)
FISHEYE = CameraIntrinsics(
    190.978,
    190.973,
    254.931,
    256.897,
    512,
    512,
    Distortion.EQUIDISTANT,
    (0.00348238, 0.000715034, -0.00205324, 0.000202937),
)
PLAIN = CameraIntrinsics(156.5, 156.5, 192.0, 192.0, 384, 384)
LARGE = dataclasses.replace(
    DAVIS,
    fx=800.0,
    fy=810.0,
    cx=640.5,
    cy=350.2,
    width=1280,
    height=720,
    coefficients=(-0.2, 0.1, 1e-3, -2e-3, -0.02),
)
RATIONAL = dataclasses.replace(DAVIS, coefficients=(0.9, 0.3, 1e-3, -5e-4, 0.02, 1.3, 0.6, 0.1))
PRISM = dataclasses.replace(LARGE, coefficients=(*RATIONAL.coefficients, 2e-3, -1e-3, -3e-3, 5e-4))
CAMERAS = {
    "davis": DAVIS,
    "fisheye": FISHEYE,
    "plain": PLAIN,
    "large": LARGE,
    "rational": RATIONAL,
    "prism": PRISM,
}
MODELS = {name: CameraModel(intrinsics) for name, intrinsics in CAMERAS.items()}

each_camera = pytest.mark.parametrize("name", CAMERAS)
unit = st.floats(0.0, 1.0)


def sensor_grid(intrinsics: CameraIntrinsics, step: float) -> FloatArray:
    """Sub-pixel positions over the whole sensor, outer corners included."""
    u = np.append(np.arange(-0.5, intrinsics.width - 0.5, step), intrinsics.width - 0.5)
    v = np.append(np.arange(-0.5, intrinsics.height - 0.5, step), intrinsics.height - 0.5)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def textbook_distort(intrinsics: CameraIntrinsics, xy: FloatArray) -> FloatArray:
    """The models once more, written as in textbooks, as an oracle: xy (N,2) to distorted (N,2)."""
    x, y = xy.T
    r = np.hypot(x, y)
    if intrinsics.distortion is Distortion.RADTAN:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (*intrinsics.coefficients, *(0.0,) * 8)[:12]
        radial = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
        tangential = np.stack(
            [2 * p1 * x * y + p2 * (r**2 + 2 * x**2), p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y], axis=-1
        )
        prism = np.stack([s1 * r**2 + s2 * r**4, s3 * r**2 + s4 * r**4], axis=-1)
        return xy * radial[:, None] + tangential + prism
    if intrinsics.distortion is Distortion.EQUIDISTANT:
        theta = np.arctan(r)
        theta_d = theta + sum(k * theta ** (2 * i + 3) for i, k in enumerate(intrinsics.coefficients))
        return xy * np.divide(theta_d, r, out=np.ones_like(r), where=r > 0)[:, None]
    return xy


def to_pixels(intrinsics: CameraIntrinsics, xy: FloatArray) -> FloatArray:
    focal, centre = (intrinsics.fx, intrinsics.fy), (intrinsics.cx, intrinsics.cy)
    return textbook_distort(intrinsics, xy) * focal + centre


@pytest.mark.parametrize(
    ("name", "step"), [("davis", 0.61), ("plain", 2.7), ("large", 7.3), ("rational", 2.7), ("prism", 7.3)]
)
def test_every_pixel_of_an_ordinary_lens_round_trips(name: str, step: float) -> None:
    uv = sensor_grid(CAMERAS[name], step)
    xy, _, valid = MODELS[name].undistort(uv)
    assert valid.all()
    focal = (CAMERAS[name].fx, CAMERAS[name].fy)
    assert np.abs((to_pixels(CAMERAS[name], xy) - uv) / focal).max() < 1e-9


def test_fisheye_round_trips_wherever_the_normalised_plane_reaches() -> None:
    uv = sensor_grid(FISHEYE, 3.1)
    xy, _, valid = MODELS["fisheye"].undistort(uv)
    angle = np.hypot(*((uv - (FISHEYE.cx, FISHEYE.cy)) / (FISHEYE.fx, FISHEYE.fy)).T)
    assert valid[angle < 1.45].all()
    assert not valid[angle > 1.55].any()
    assert np.isnan(xy[~valid]).all()
    assert np.abs(to_pixels(FISHEYE, xy[valid]) - uv[valid]).max() < 1e-9 * FISHEYE.fx


@pytest.mark.slow
@each_camera
@settings(derandomize=True, deadline=None, max_examples=200)
@given(s=unit, t=unit, depth=st.floats(0.05, 1e3))
def test_project_inverts_undistort_and_back(name: str, s: float, t: float, depth: float) -> None:
    model, intrinsics = MODELS[name], CAMERAS[name]
    uv = np.array([[s * intrinsics.width - 0.5, t * intrinsics.height - 0.5]])
    xy, _, valid = model.undistort(uv)
    if not valid[0]:
        return
    p_c = depth * np.append(xy, [[1.0]], axis=1)
    uv_again, seen = model.project(p_c)
    inside = (uv >= -0.499).all() and (uv <= (intrinsics.width - 0.501, intrinsics.height - 0.501)).all()
    assert seen[0] or not inside or np.hypot(*xy[0]) > 0.999 * model.pinhole.lens.max_radius
    if seen[0]:
        np.testing.assert_allclose(uv_again, uv, atol=1e-9 * intrinsics.fx, rtol=0)
        xy_again, _, valid_again = model.undistort(uv_again)
        assert valid_again[0]
        np.testing.assert_allclose(xy_again, xy, atol=1e-9, rtol=1e-9)


@each_camera
def test_undistortion_jacobian_is_the_central_difference(name: str) -> None:
    model, h = MODELS[name], 1e-4
    uv = sensor_grid(CAMERAS[name], 17.3)
    uv = uv[(uv > 0).all(axis=1) & (uv < (CAMERAS[name].width - 1, CAMERAS[name].height - 1)).all(axis=1)]
    xy, jac, valid = model.undistort(uv)
    good = valid & (np.hypot(*xy.T) < 3.0)  # the step is too coarse at the rim of a fisheye
    assert good.sum() > 50
    for axis in range(2):
        step = h * np.eye(2)[axis]
        numeric = (model.undistort(uv + step)[0] - model.undistort(uv - step)[0]) / (2 * h)
        np.testing.assert_allclose(jac[good, :, axis], numeric[good], rtol=1e-6, atol=1e-6 / CAMERAS[name].fx)


@each_camera
def test_distortion_jacobian_is_the_central_difference(name: str) -> None:
    lens, h = MODELS[name].pinhole.lens, 1e-6
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-0.8, 0.8, (50, 2)):
        _, _, a, b, c, d = distortion.distort(lens, x, y)
        d_x = np.subtract(distortion.distort(lens, x + h, y)[:2], distortion.distort(lens, x - h, y)[:2])
        d_y = np.subtract(distortion.distort(lens, x, y + h)[:2], distortion.distort(lens, x, y - h)[:2])
        np.testing.assert_allclose([[a, b], [c, d]], np.stack([d_x, d_y], axis=1) / (2 * h), atol=1e-8)


@each_camera
def test_distort_is_the_textbook_model(name: str) -> None:
    lens = MODELS[name].pinhole.lens
    xy = np.random.default_rng(1).uniform(-1, 1, (100, 2)) * np.logspace(-16, 0, 100)[:, None]
    ours = np.array([distortion.distort(lens, x, y)[:2] for x, y in xy])
    np.testing.assert_allclose(ours, textbook_distort(CAMERAS[name], xy), rtol=1e-14)


@pytest.mark.slow
def test_one_newton_step_from_the_table_reaches_the_tolerance_on_davis() -> None:
    """The table makes arbitrary positions cheap: its start is so near that one step squares to 1e-9."""
    model = MODELS["davis"]
    uv = sensor_grid(DAVIS, 1.91)
    xy, _, _ = model.undistort(uv)
    xy_d = (uv - (DAVIS.cx, DAVIS.cy)) / (DAVIS.fx, DAVIS.fy)
    for (u, v), target, distorted in zip(uv, xy, xy_d, strict=True):
        x, y = look_up(model.table, u, v)
        x_d, y_d, a, b, c, d = distortion.distort(model.pinhole.lens, x, y)
        step = np.linalg.solve([[a, b], [c, d]], distorted - (x_d, y_d))
        assert np.abs(np.array([x, y]) + step - target).max() < 1e-9


# --- valid set ---------------------------------------------------------------------------------------------


def test_radtan_fold_is_where_the_radial_polynomial_turns() -> None:
    lens = distortion.make_lens(Distortion.RADTAN, (-0.5, 0.0, 0.0, 0.0))
    assert lens.max_radius == pytest.approx(distortion.FOLD_MARGIN * math.sqrt(1 / 1.5), rel=1e-12)
    assert math.atan(MODELS["davis"].pinhole.lens.max_radius) == pytest.approx(distortion.MAX_ANGLE)
    assert math.isinf(MODELS["plain"].pinhole.lens.max_radius)


def test_equidistant_fold_is_where_the_angle_polynomial_turns() -> None:
    lens = distortion.make_lens(Distortion.EQUIDISTANT, (-0.4, 0.0, 0.0, 0.0))
    assert math.atan(lens.max_radius) == pytest.approx(distortion.FOLD_MARGIN * math.sqrt(1 / 1.2), rel=1e-12)
    assert math.atan(MODELS["fisheye"].pinhole.lens.max_radius) == pytest.approx(distortion.MAX_ANGLE)


@pytest.mark.parametrize("coefficients", [(-0.5, 0.05, 0.03, -0.02), (-0.3, 0.02, -0.01, 0.04, -0.01)])
def test_determinant_is_positive_in_the_valid_disc_and_vanishes_just_outside(
    coefficients: tuple[float, ...],
) -> None:
    lens = distortion.make_lens(Distortion.RADTAN, coefficients)
    angles = np.linspace(0, 2 * np.pi, 721)

    def smallest_determinant(radius: float) -> float:
        jacobians = [distortion.distort(lens, radius * math.cos(t), radius * math.sin(t))[2:] for t in angles]
        return min(a * d - b * c for a, b, c, d in jacobians)

    assert min(map(smallest_determinant, np.linspace(0, lens.max_radius, 50))) > 0
    assert smallest_determinant(lens.max_radius / distortion.FOLD_MARGIN * 1.001) < 0


def test_folding_is_detected_not_inverted() -> None:
    folding = dataclasses.replace(DAVIS, coefficients=(-0.9, 0.0, 0.0, 0.0))
    model = CameraModel(folding)
    fold = math.sqrt(1 / 2.7)
    beyond = np.array([[1.3 * fold, 0.0, 1.0]])  # lands on the sensor, on top of a nearer point
    landing = to_pixels(folding, beyond[:, :2])
    assert (landing > 0).all()
    assert (landing < (folding.width, folding.height)).all()
    uv, valid = model.project(beyond)
    assert not valid[0]
    assert np.isnan(uv).all()
    xy, _, valid = model.undistort(landing)  # the result is the nearer preimage
    assert valid[0]
    assert np.hypot(*xy[0]) < fold
    np.testing.assert_allclose(to_pixels(folding, xy), landing, atol=1e-7)
    xy, jac, valid = model.undistort(
        [[folding.cx + 1.001 * folding.fx * fold * (1 - 0.9 * fold**2), folding.cy]]
    )
    assert not valid[0]
    assert np.isnan(xy).all()
    assert np.isnan(jac).all()


def test_no_preimage_is_lost_near_the_fold() -> None:
    """Everything that the valid disc maps to is found again, from the table or from a cold start."""
    intrinsics = dataclasses.replace(DAVIS, coefficients=(-0.6, 0.05, 0.01, -0.02))
    model = CameraModel(intrinsics)
    rng = np.random.default_rng(2)
    radius, angle = (
        model.pinhole.lens.max_radius * np.sqrt(rng.uniform(0, 0.999, 2000)),
        rng.uniform(0, 7, 2000),
    )
    xy = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    uv, seen = model.project(np.column_stack([xy, np.ones(2000)]))
    assert seen.sum() > 500
    xy_again, _, valid = model.undistort(uv[seen])
    assert valid.all()
    np.testing.assert_allclose(xy_again, xy[seen], atol=1e-9)


# --- invalid inputs ----------------------------------------------------------------------------------------


@each_camera
def test_invalid_points_and_pixels_are_flagged(name: str) -> None:
    model, width = MODELS[name], CAMERAS[name].width
    points = [[0, 0, -1], [0, 0, 0], [np.nan, 0, 1], [0, 0, np.inf], [1e9, 0, 1], [0, 0, 1]]
    assert model.project(points)[1].tolist() == [False, False, False, True, False, True]
    pixels = [
        [-0.51, 10],
        [width - 0.49, 10],
        [np.nan, 10],
        [np.inf, 10],
        [CAMERAS[name].cx, CAMERAS[name].cy],
    ]
    assert model.undistort(pixels)[2].tolist() == [False, False, False, False, True]


def test_empty_input_gives_empty_output() -> None:
    xy, jac, valid = MODELS["davis"].undistort(np.empty((0, 2)))
    assert xy.shape == (0, 2)
    assert jac.shape == (0, 2, 2)
    assert valid.shape == (0,)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fx": 0.0}, "positive focal"),
        ({"cy": math.nan}, "finite"),
        ({"width": 0}, "at least 1 x 1"),
        ({"coefficients": (0.1, 0.2)}, "found 2 coefficients .* expected 4, 5, 8, 12 or 14"),
        ({"coefficients": (0.1, 0.2, math.inf, 0.0)}, "finite"),
        ({"coefficients": (0.1, 0.2, math.nan, 0.0)}, "finite"),
        ({"coefficients": (1e7, 0.0, 0.0, 0.0)}, "up to 1e\\+06"),
        ({"coefficients": (*(0.0,) * 12, 0.01, 0.0)}, "a tilted sensor .* not supported"),
        ({"distortion": Distortion.NONE}, "expected 0"),
        ({"distortion": Distortion.EQUIDISTANT, "coefficients": (0.1,) * 5}, "expected 4;"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(GeometryError, match=words):
        CameraModel(dataclasses.replace(DAVIS, **change))  # type: ignore[arg-type]


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(GeometryError, match=r"uv of shape \(2,\), expected \(N, 2\)"):
        MODELS["davis"].undistort([1.0, 2.0])
    with pytest.raises(GeometryError, match=r"p_c of shape \(1, 2\), expected \(N, 3\)"):
        MODELS["davis"].project([[1.0, 2.0]])
