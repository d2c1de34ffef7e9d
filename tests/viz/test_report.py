"""The report page: complete, self-contained, safe to show, the same for the same run."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from asyneio.types import FloatArray
from asyneio.viz import (
    Comparison,
    Features,
    HealthTimeline,
    ReportData,
    Series,
    Timing,
    VisualizationError,
    render_report,
    style,
)
from asyneio.viz.plots import MAX_POINTS, plot_path, plot_vector
from asyneio.viz.style import plotting, to_svg

STATES = ("initializing", "tracking", "degraded", "lost")


def make_data(size: int = 60, with_truth: bool = True) -> ReportData:
    t_s = np.linspace(0.5, 3.0, size)
    path = np.stack([np.cos(t_s), 2.0 * np.sin(t_s), 0.1 * t_s], axis=1)
    series = Series(t_s, path, np.full((size, 3), 0.1), path if with_truth else None)
    error = Series(t_s, 0.01 * path, np.full((size, 3), 0.02))
    return ReportData(
        paths=(path,),
        health=HealthTimeline(t_s, np.arange(size) * 4 // size, np.arange(size) * 2 // size, STATES),
        velocity=series,
        bias_gyroscope=series,
        bias_accelerometer=series,
        features=Features(t_s, np.arange(size), np.tile([0.1, 0.2, 0.4], (size, 1))),
        timing=Timing(t_s, np.full(size, 0.004), 0.05),
        notes=("imu.csv: skipped 1 line",),
        comparison=Comparison(path, path, error, error) if with_truth else None,
    )


def render(data: ReportData, title: str = "desk") -> str:
    return render_report(title, "A recording.", (("knots", "57"),), data, "0.1.0")


class Outline(HTMLParser):
    """Collects headings, references, and whether the elements close properly."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta",):
            self.open.append(tag)
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)


def outline(page: str) -> Outline:
    parsed = Outline()
    parsed.feed(page)
    assert parsed.open == []
    return parsed


@pytest.fixture(scope="module")
def page() -> str:
    """Drawn once: plots take seconds."""
    return render(make_data(), title="<script>desk</script>")


def test_page_with_truth_has_every_part(page: str) -> None:
    found = outline(page)
    assert found.headings == [
        "<script>desk</script>",
        "Path",
        "Figures",
        "Position error",
        "Orientation error",
        "Velocity",
        "Gyroscope bias",
        "Accelerometer bias",
        "Health",
        "Features",
        "Processing time",
        "Notes",
    ]


def test_page_without_truth_leaves_the_errors_out() -> None:
    found = outline(render(replace(make_data(with_truth=False), notes=())))
    assert "Position error" not in found.headings
    assert "Notes" not in found.headings
    assert "Path" in found.headings


def test_page_needs_nothing_from_outside(page: str) -> None:
    assert all(reference.startswith(("#", "data:")) for reference in outline(page).references)
    assert "<script" not in page
    assert not re.search(r"url\((?!#)", page)
    assert 'name="viewport"' in page


def test_names_are_escaped(page: str) -> None:
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_same_data_same_page(page: str) -> None:
    assert render(make_data(), title="<script>desk</script>") == page


def test_long_runs_stay_light() -> None:
    with plotting():
        long, short = (
            plot_vector(make_data(size).velocity, "m/s", ("x", "y", "z")) for size in (50_000, MAX_POINTS)
        )
        assert len(to_svg(long)) < 1.5 * len(to_svg(short))


def test_users_settings_are_left_alone() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    with plotting():
        assert dict(matplotlib.rcParams) != before
    assert dict(matplotlib.rcParams) == before


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "available", lambda: False)
    with pytest.raises(VisualizationError, match=r"pip install 'asyneio\[report\]'"):
        render(make_data())


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


def test_a_wide_first_band_does_not_flatten_the_curve() -> None:
    t_s = np.linspace(0.0, 10.0, 100)
    sigma = np.full((100, 3), 0.1)
    sigma[:3] = 100.0
    value = np.stack([np.sin(t_s)] * 3, axis=1)
    with plotting():
        figure = plot_vector(Series(t_s, value, sigma), "m/s", ("x", "y", "z"))
    low, high = figure.axes[0].get_ylim()
    assert -2.0 < low < -1.0
    assert 1.0 < high < 2.0
