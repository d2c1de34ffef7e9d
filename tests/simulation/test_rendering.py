"""Rendering and the truth for points: rays, textures without aliasing, occlusion, steps below a pixel."""

import dataclasses
import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import uniform_filter

from asyneio.errors import SimulationError
from asyneio.simulation import PinholeCamera, PointTruth
from asyneio.simulation.events.rays import lens_row, pixel_grid, pixel_rays
from asyneio.simulation.events.render import empty_frame, render
from asyneio.simulation.events.schedule import plan_block
from asyneio.simulation.events.source import Seeds, Stage, set_stage
from asyneio.simulation.events.view import view_of
from asyneio.types import CameraIntrinsics, Distortion, FloatArray
from tests.simulation.event_worlds import SMALL, STRAIGHT, drifting, small_scenario, stage_of, walls

FISHEYE = CameraIntrinsics(
    60.0, 61.0, 50.0, 36.0, 100, 72, Distortion.EQUIDISTANT, (-0.01, 0.02, -0.01, 0.002)
)
STILL = drifting((0.0, 0.0, 0.0))


def truth_of(stage: Stage) -> PointTruth:
    scenario = stage.scenario
    return PointTruth(stage.motion, stage.world, scenario.camera, scenario.T_b_c, 0)


def picture(stage: Stage, t_us: int = 0) -> FloatArray:
    frame = empty_frame(stage.view)
    render(stage.world, stage.view, stage.T_w_c(np.array([t_us]))[0], frame)
    return frame.intensity.astype(np.float64)


@functools.cache
def near() -> Stage:
    return set_stage(small_scenario(), Seeds.of(4))


@pytest.mark.parametrize("camera", [SMALL, STRAIGHT, FISHEYE])
def test_rays_invert_the_projection(camera: CameraIntrinsics) -> None:
    pixels = pixel_grid(camera)
    rays = pixel_rays(lens_row(camera), pixels)
    found, valid = PinholeCamera.from_intrinsics(camera).project(np.column_stack([rays, np.ones(len(rays))]))
    assert valid.all()
    np.testing.assert_allclose(found, pixels, atol=1e-9)


def test_pixels_that_the_lens_cannot_image_have_no_ray() -> None:
    folding = dataclasses.replace(SMALL, coefficients=(-0.5, 0.0, 0.0, 0.0))
    assert np.isnan(pixel_rays(lens_row(folding), np.array([[200.0, 200.0]]))).all()


@pytest.mark.slow
@given(st.integers(0, 250_000_000), st.floats(1.0, 98.0), st.floats(1.0, 70.0))
def test_a_point_is_projected_where_it_was_hit(t_ns: int, u: float, v: float) -> None:
    stage = near()
    truth = truth_of(stage)
    points, surface, valid = truth.hit([t_ns], [[u, v]])
    assert valid[0]
    world, r = stage.world, surface[0]
    normal = np.cross(world.edge_u[r], world.edge_v[r])
    assert abs((points[0] - world.corner[r]) @ normal) < 1e-9 * np.linalg.norm(normal)
    uv, visible = truth.project([t_ns], points)
    np.testing.assert_allclose(uv, [[u, v]], atol=1e-6)
    assert visible[0]


def test_what_is_behind_something_is_not_visible() -> None:
    """A square of 0.5 m at 1 m covers 40 px of the image of a wall at 2 m."""
    grey = [np.full((32, 32), value) for value in (0.2, 0.8)]
    stage = stage_of(walls(grey, [2.0, 1.0], [8.0, 0.5]), STILL, small_scenario(camera=STRAIGHT))
    truth = truth_of(stage)
    centre = [49.5, 35.5]
    wall = np.array([[2.0, 0.0, 0.0], [2.0, 0.45, 0.0], [2.0, 0.55, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    uv, visible = truth.project(np.zeros(5, int), wall)
    np.testing.assert_array_equal(visible, [False, False, True, True, False])
    np.testing.assert_allclose(uv[2], [49.5 - 80.0 * 0.55 / 2.0, 35.5])
    around = np.array([centre, [49.5 + 11.0, 35.5], [49.5 + 13.0, 35.5], [49.5 + 29.0, 35.5]])
    np.testing.assert_array_equal(truth.hit(np.zeros(4, int), around)[1], [1, 1, 1, 0])
    np.testing.assert_array_equal(truth.single_surface(np.zeros(4, int), around), [True, True, False, True])
    image = picture(stage)
    assert image[35, 49] == pytest.approx(0.8)
    assert image[35, 90] == pytest.approx(0.2)
    # The border lies 20 px from the middle, between two pixels' centres.
    np.testing.assert_allclose(image[35, [68, 69, 70, 71]], [0.8, 0.5, 0.2, 0.2], atol=0.31)


def test_a_surface_shows_its_texture_where_rays_meet_it() -> None:
    ramp = np.tile((np.arange(128) + 0.5) / 128, (128, 1))
    stage = stage_of(walls([ramp], [2.0], [8.0]), STILL, small_scenario(camera=SMALL))
    rays = pixel_rays(lens_row(SMALL), pixel_grid(SMALL))
    expected = ((4.0 + 2.0 * rays[:, 0]) / 8.0).reshape(SMALL.height, SMALL.width)
    np.testing.assert_allclose(picture(stage), expected, atol=2e-3)


def test_fine_texture_far_away_is_smooth_not_noise(rng: np.random.Generator) -> None:
    noise = rng.uniform(0.1, 0.9, (512, 512))
    # Eight metres away a pixel spans 4 x 4 texels; the two pictures are 0.3 px, more than a texel, apart.
    world, motion = walls([noise], [8.0], [12.8]), drifting((0.0, 0.03, 0.0))
    stage = stage_of(world, motion, small_scenario(camera=STRAIGHT))
    first, second = picture(stage, 0)[:, 40:60], picture(stage, 1_000_000)[:, 40:60]
    averaged = uniform_filter(noise, 4).std()
    assert 0.5 * averaged < first.std() < 1.5 * averaged
    # Without levels of detail, nothing would remain of a pixel's value.
    assert (second - first).std() < 0.15 * np.sqrt(2.0) * noise.std()
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] > 0.8


def test_no_step_moves_the_image_by_more_than_the_limit() -> None:
    stage, scenario = near(), near().scenario
    truth, frame = truth_of(stage), empty_frame(stage.view)
    rows, columns = np.mgrid[4 : SMALL.height : 8, 4 : SMALL.width : 8]
    centres = np.column_stack([np.minimum(columns.ravel(), 99), rows.ravel()]).astype(float)
    for begin in (0, 100_000, 200_000):
        render(stage.world, stage.view, stage.T_w_c(np.array([begin]))[0], frame)
        plan = plan_block(
            stage.motion,
            scenario.T_b_c,
            stage.world,
            stage.view,
            frame.inverse_depth,
            (begin, begin + 16_000),
            0.1,
            10_000,
        )
        times = np.concatenate([[begin], plan.t_us])
        assert times[-1] == begin + 16_000
        assert len(times) > 3
        for tile, centre in enumerate(centres):
            own = np.unique([*range(0, len(times), plan.stride[tile]), len(times) - 1])
            points, _, _ = truth.hit(1000 * times[own[:-1]], np.tile(centre, (len(own) - 1, 1)))
            moved, _ = truth.project(1000 * times[own[1:]], points)
            # Of gentle motion: where a near edge enters a tile, fast motion exceeds it by half.
            assert np.hypot(*(moved - centre).T).max() < 0.1
            assert np.diff(times[own]).max() <= 10_000


def test_a_lens_that_cannot_be_inverted_is_refused() -> None:
    with pytest.raises(SimulationError, match="pixels have no viewing ray"):
        view_of(dataclasses.replace(SMALL, coefficients=(-0.9, 0.0, 0.0, 0.0)))
