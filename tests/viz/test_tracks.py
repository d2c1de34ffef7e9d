"""Pictures of tracks: what is drawn when, and files that open."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from asyneio.types import EVENT_DTYPE, OBSERVATION_DTYPE
from asyneio.viz import VisualizationError, style
from asyneio.viz.tracks import TrackScene, render_animation, render_tracks

_START_NS = 1_600_000_000_000_000_000


def make_scene(rng: np.random.Generator) -> TrackScene:
    """Two tracks over two seconds, the second from 1.0 to 1.5 s only; brighter left, darker right."""
    events = np.zeros(4000, dtype=EVENT_DTYPE)
    events["t_ns"] = _START_NS + np.sort(rng.integers(0, 2 * 10**9, events.size))
    events["x"], events["y"] = rng.integers(0, 60, events.size), rng.integers(0, 40, events.size)
    events["p"] = events["x"] < 30
    rows = np.zeros(126, dtype=OBSERVATION_DTYPE)
    rows["t_ns"] = _START_NS + np.r_[np.arange(100) * 20_000_000, 10**9 + np.arange(26) * 20_000_000]
    rows["id"] = np.repeat([7, 3], [100, 26])
    rows["u"] = np.r_[np.linspace(5.0, 55.0, 100), np.linspace(30.0, 20.0, 26)]
    rows["v"] = 20.0
    rng.shuffle(rows)
    return TrackScene(events, 60, 40, rows)


def test_tracks_are_drawn_while_they_live(rng: np.random.Generator) -> None:
    scene = make_scene(rng)
    for at_ms, ids in ((500, [7]), (1000, [3, 7]), (1499, [3, 7]), (1501, [7]), (1990, [])):
        assert [identity for identity, _ in scene.trails(_START_NS + at_ms * 1_000_000)] == ids
    # The trail is what was observed in the last 0.4 s, oldest first.
    ((_, trail),) = scene.trails(_START_NS + 800_000_000)
    assert len(trail) == 21
    assert (np.diff(trail[:, 0]) > 0.0).all()
    assert trail[-1, 0] == pytest.approx(5.0 + 40 * 50.0 / 99.0)


def test_image_shows_the_last_events_by_polarity(rng: np.random.Generator) -> None:
    scene = make_scene(rng)
    image = scene.image(_START_NS + 10**9)
    assert image.shape == (40, 60, 3)
    red, blue = image[..., 0].mean(axis=0), image[..., 2].mean(axis=0)
    assert (red[:30] >= blue[:30]).all()
    assert (red[30:] <= blue[30:]).all()
    shown = np.count_nonzero((image < 1.0).any(axis=2))
    assert shown == pytest.approx(0.12 * 60 * 40, rel=0.1)
    assert (scene.image(_START_NS - 1) == 1.0).all()


@pytest.mark.slow
def test_files_open(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.viz.tracks._FRAMES", 7)
    scene = make_scene(rng)
    with Image.open(io.BytesIO(render_tracks(scene, "desk"))) as picture:
        assert (picture.format, picture.width) == ("PNG", 1100)
    with Image.open(io.BytesIO(render_animation(scene))) as picture:
        assert picture.format == "GIF"
        assert getattr(picture, "n_frames", 1) == 7


@pytest.mark.slow
def test_same_scene_same_picture(rng: np.random.Generator) -> None:
    scene = make_scene(rng)
    assert render_tracks(scene, "desk") == render_tracks(scene, "desk")


def test_without_matplotlib_the_extra_is_named(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(style, "available", lambda: False)
    with pytest.raises(VisualizationError, match=r"pip install 'asyneio\[report\]'"):
        render_tracks(make_scene(rng), "desk")
