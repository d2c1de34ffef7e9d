"""Comparisons drawn: files that open, failures that leave gaps."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from asyneio.viz import VisualizationError, style
from asyneio.viz.curves import Curve, Map, Panel, render_map, render_panels, vertical_scale

_X = np.array([1.0, 2.0, 5.0, 10.0])
_CURVE = Curve("gpp", _X, _X**2, 0.9 * _X**2, 1.1 * _X**2)
_PANEL = Panel(
    "error [m]", "interval", (_CURVE, replace(_CURVE, label="preint", middle=2.0 * _X**2)), log_x=True
)
_MAP = Map(
    "rows",
    "columns",
    ("1", "2"),
    ("a", "b"),
    ("gpp", "preint"),
    ((0, 1), (-1, 0)),
    ((True, True), (False, False)),
    (("x", "y"), ("-", "z")),
)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3])
def test_panels_open_and_repeat(count: int) -> None:
    data = render_panels("title", [_PANEL] * count)
    with Image.open(io.BytesIO(data)) as picture:
        assert picture.format == "PNG"
        assert (picture.width > 800) == (count > 1)
    assert render_panels("title", [_PANEL] * count) == data


@pytest.mark.slow
def test_what_is_not_finite_is_not_drawn() -> None:
    """A failing point and an infinite bound draw the same as a curve without them."""
    failing = Curve(
        "gpp", _X, *(np.where(_X < 5.0, part, np.inf) for part in (_X**2, 0.9 * _X**2, 1.1 * _X**2))
    )
    short = Curve("gpp", _X[:2], _CURVE.middle[:2], _CURVE.low[:2], _CURVE.high[:2])
    ticks = ("a", "b", "c", "d")
    drawn, expected = (
        render_panels("title", [Panel("error", "x", (curve,), ticks)]) for curve in (failing, short)
    )
    assert drawn == expected
    open_ended = replace(_CURVE, high=np.where(_X < 5.0, _CURVE.high, np.inf))
    closed = replace(_CURVE, high=np.where(_X < 5.0, _CURVE.high, _CURVE.middle))
    one, other = (render_panels("title", [Panel("error", "x", (curve,))]) for curve in (open_ended, closed))
    assert one == other


def test_axes_are_logarithmic_where_that_has_labels() -> None:
    flat = replace(_CURVE, middle=np.array([1.0, 1.2, np.inf, 2.9]))
    assert vertical_scale([_CURVE]) == "log"
    assert vertical_scale([flat]) == "linear"
    assert vertical_scale([flat, replace(flat, middle=4.0 * flat.middle)]) == "log"
    assert vertical_scale([replace(flat, middle=np.array([0.0, 1.0, 2.0, 9.0]))]) == "linear"
    assert vertical_scale([replace(flat, middle=np.full(4, np.inf))]) == "linear"


def test_maps_color_winners() -> None:
    with Image.open(io.BytesIO(render_map("title", _MAP))) as picture:
        colors = {color for _, color in picture.convert("RGB").getcolors(1 << 20) or []}
    # The first two colours; where others equal the winner, hardly any.
    for full, opacity in (((0, 114, 178), 0.5), ((213, 94, 0), 0.5), ((0, 114, 178), 0.12)):
        wanted = [round(opacity * part + (1.0 - opacity) * 255) for part in full]
        assert any(max(abs(a - b) for a, b in zip(wanted, color, strict=True)) <= 2 for color in colors)


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "available", lambda: False)
    with pytest.raises(VisualizationError, match=r"pip install 'asyneio\[report\]'"):
        render_panels("title", [_PANEL])
