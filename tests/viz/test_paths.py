"""Paths from above, from the side and in space: never cropped, never degenerate."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.types import FloatArray
from asyneio.viz import Series
from asyneio.viz.paths import plot_path
from asyneio.viz.plots import plot_vector
from asyneio.viz.space import ASPECT, plot_space, project, space_json, space_of
from asyneio.viz.style import plotting


@pytest.mark.parametrize(
    "scale", [(1.0, 1.0, 1.0), (1e-6, 5.0, 1e-6), (5.0, 1e-6, 1e-6), (0.1, 0.1, 9.0), (0, 0, 0)]
)
def test_path_is_never_cropped(scale: tuple[float, float, float]) -> None:
    t = np.linspace(0.0, 6.0, 50)
    path: FloatArray = np.stack([np.sin(t), np.cos(t), t], axis=1) * np.array(scale) + 100.0
    with plotting():
        figure = plot_path(path, None)
        figure.canvas.draw()
    assert 2.0 < figure.get_figheight() < 16.0
    for axes, vertical in zip(figure.axes, (1, 2), strict=True):
        for limits, values in ((axes.get_xlim(), path[:, 0]), (axes.get_ylim(), path[:, vertical])):
            assert limits[0] < values.min()
            assert limits[1] > values.max()


@pytest.mark.slow
@given(
    st.tuples(*[st.floats(1e-7, 1e4)] * 3),
    st.tuples(*[st.floats(-1e5, 1e5)] * 3),
    st.integers(1, 5000),
)
def test_floor_carries_any_path(scale: tuple[float, ...], offset: tuple[float, ...], size: int) -> None:
    t = np.linspace(0.0, 6.0, size)
    path = np.stack([np.sin(t), np.cos(t), t], axis=1) * np.array(scale) + np.array(offset)
    space = space_of(path, None)
    assert (space.low <= path[:, :2].min(axis=0) + 1e-9).all()
    assert (space.high >= path[:, :2].max(axis=0) - 1e-9).all()
    assert space.floor == path[:, 2].min()
    assert 4 <= len(space.floor_lines()) <= 60
    assert np.linalg.norm(path - space.centre, axis=1).max() <= space.radius
    plain = json.loads(space_json(space))
    points = np.array(plain["estimate"][0]).reshape(-1, 3)
    assert len(points) <= 3100
    # Rounding moves nothing by more than a thousandth of the picture.
    assert np.abs(points[0] - path[0]).max() <= 1e-3 * space.radius
    assert np.abs(points[-1] - path[-1]).max() <= 1e-3 * space.radius


def test_segments_are_cut_and_truth_is_beside_them() -> None:
    t = np.linspace(0.0, 6.0, 40)
    path = np.stack([np.sin(t), np.cos(t), t], axis=1)
    path[10] = np.nan
    space = space_of(path, path + 1.0)
    assert [len(piece) for piece in space.estimate] == [10, 29]
    assert [len(piece) for piece in space.truth] == [10, 29]
    assert space.high[0] >= np.nanmax(path[:, 0]) + 1.0


def test_still_picture_shows_the_whole_path() -> None:
    t = np.linspace(0.0, 20.0, 300)
    path = np.stack([3.0 * np.sin(t), np.cos(0.7 * t), 0.2 * t], axis=1)
    with plotting():
        figure = plot_space(space_of(path, None))
    axes = figure.axes[0]
    seen = project(path)
    for values, limits in ((seen[:, 0], axes.get_xlim()), (seen[:, 1], axes.get_ylim())):
        assert limits[0] < values.min() < values.max() < limits[1]
    assert figure.get_figheight() / figure.get_figwidth() == pytest.approx(ASPECT)


def test_seen_from_the_eye_up_is_up() -> None:
    right, up = project(np.array([0.0, 0.0, 1.0]))
    assert right == pytest.approx(0.0, abs=1e-12)
    assert up > 0.8
    # Scales are equal: the three axes' images make an orthographic frame.
    frame = project(np.eye(3))
    np.testing.assert_allclose(frame.T @ frame, np.eye(2), atol=1e-12)


def test_a_wide_first_band_does_not_flatten_the_curve() -> None:
    t_s = np.linspace(0.0, 10.0, 100)
    sigma = np.full((100, 3), 0.1)
    sigma[:3] = 100.0
    value = np.stack([np.sin(t_s)] * 3, axis=1)
    with plotting():
        figure = plot_vector(Series(t_s, value, sigma), "m/s")
    low, high = figure.axes[0].get_ylim()
    assert -2.0 < low < -1.0
    assert 1.0 < high < 2.0
