"""The report page: complete, self-contained, safe to show, light, the same for the same run."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from asyneio.viz import (
    HealthChange,
    HealthTimeline,
    ReportData,
    Series,
    VisualizationError,
    render_overview,
    render_pictures,
    render_report,
    style,
)
from asyneio.viz.figures import report_figures
from tests.viz.reports import STATES, make_data


def render(data: ReportData, title: str = "desk") -> str:
    return render_report(title, "A recording.", (("knots", "57"),), data, "0.1.0")


class Outline(HTMLParser):
    """Collects headings, references, policies, and whether the elements close properly."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.references: list[str] = []
        self.scripts: list[str] = []
        self.ids: list[str] = []
        self.policy = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "img"):
            self.open.append(tag)
        self.handle_startendtag(tag, attrs)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {name: value or "" for name, value in attrs}
        self.references += [named[name] for name in ("src", "href", "xlink:href", "action") if name in named]
        self.ids += [named["id"]] if "id" in named else []
        assert not [name for name in named if name.startswith("on")]
        if named.get("http-equiv") == "Content-Security-Policy":
            self.policy = named["content"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)
        if self.open and self.open[-1] == "script":
            self.scripts.append(data)


def outline(page: str) -> Outline:
    parsed = Outline()
    parsed.feed(page)
    assert parsed.open == []
    return parsed


@pytest.fixture(scope="module")
def page() -> str:
    """Drawn once: plots take seconds."""
    return render(make_data(), title="<script>desk</script>")


@pytest.mark.slow
def test_page_with_truth_has_every_part(page: str) -> None:
    assert outline(page).headings == [
        "<script>desk</script>",
        "Path",
        "Figures",
        "Path in space",
        "Position error",
        "Orientation error",
        "Velocity",
        "Gyroscope bias",
        "Accelerometer bias",
        "Health",
        "Changes of health",
        "Features",
        "Event rate",
        "Events and tracks",
        "Processing time",
        "Notes",
        "Settings that differ from the defaults",
    ]
    for wanted in ("speed of 80 m/s", "imu.csv: skipped 1 line", "window.length_s", "2.0 (default: 1.5)"):
        assert wanted in page


def test_what_is_not_known_is_left_out() -> None:
    data = replace(make_data(with_truth=False), notes=(), settings=(), events=None, scene=None)
    titles = [figure.title for figure in report_figures(data)]
    assert titles[:3] == ["Path", "Path in space", "Velocity"]
    assert titles[-3:] == ["Health", "Features", "Processing time"]
    headings = outline(render(replace(data, states=None))).headings
    assert "Notes" not in headings
    assert headings[-1] == "Settings"


@pytest.mark.slow
def test_a_run_that_never_started_has_a_page_that_says_why() -> None:
    data = replace(make_data(with_truth=False), states=None, failure="the estimator never started: no motion")
    page = render(data)
    assert "the estimator never started: no motion" in page
    assert not {"Path", "Velocity"} & set(outline(page).headings)
    assert {"Health", "Changes of health", "Event rate"} <= set(outline(page).headings)
    assert render_overview(data) is None


@pytest.mark.slow
def test_page_needs_nothing_from_outside(page: str) -> None:
    found = outline(page)
    assert found.references
    assert all(reference.startswith(("#", "data:image/png;base64,")) for reference in found.references)
    assert not re.search(r"url\((?!#)|@import|@font-face", page)
    assert "//" not in re.sub(r"http://www\.w3\.org/[\w/]+", "", re.sub(r"base64,[^\"]*", "", page)).replace(
        "// Paths", ""
    )
    assert found.policy.startswith("default-src 'none';")
    assert 'name="viewport"' in page


def test_names_are_escaped(page: str) -> None:
    assert "<script>desk" not in page
    assert "&lt;script&gt;desk" in page
    data, script = outline(page).scripts
    assert json.loads(data)["estimate"]
    assert '"use strict"' in script


def test_ids_are_those_that_are_referred_to(page: str) -> None:
    found = outline(page)
    used = {reference[1:] for reference in found.references if reference.startswith("#")}
    used |= set(re.findall(r"url\(#([^)]+)\)", page))
    assert set(found.ids) == used


def test_colors_are_left_to_the_page(page: str) -> None:
    svg = "".join(re.findall(r"<svg.*?</svg>", page, re.DOTALL))
    assert re.findall(r"(?:fill|stroke): (#\w+)", svg) == []
    names = set(re.findall(r"var\(--(\w+)\)", svg))
    assert {"ink", "grid", "blue", "red", "green"} <= names
    light, dark = re.search(r":root \{(.*?)\}.*?:root \{(.*?)\}", page, re.DOTALL).groups()  # type: ignore[union-attr]
    for block in (light, dark):
        assert names <= set(re.findall(r"--(\w+):", block))


@pytest.mark.slow
def test_same_data_same_page(page: str) -> None:
    assert render(make_data(), title="<script>desk</script>") == page


@pytest.mark.slow
def test_long_runs_stay_light() -> None:
    """Half an hour at ten knots a second, restless to the last: a page that a phone can load."""
    rng = np.random.default_rng(0)
    data = make_data(18_000)
    assert data.states is not None
    noisy = replace(data.states.velocity, value=rng.standard_normal((18_000, 3)))
    state = rng.integers(0, 4, 18_000)
    changes = tuple(HealthChange(t, "lost", 0, "no features") for t in data.health.t_s.tolist())
    health = HealthTimeline(data.health.t_s, state, data.health.segment, STATES, changes)
    states = replace(data.states, velocity=noisy, bias_gyroscope=noisy, bias_accelerometer=noisy)
    page = render(replace(data, states=states, health=health))
    assert len(page) < 4_000_000
    assert "17900 later changes are in health.csv" in page


@pytest.mark.slow
def test_the_shortest_run_has_a_page() -> None:
    assert "Path in space" in outline(render(make_data(1, with_truth=False))).headings


@pytest.mark.slow
def test_what_diverged_can_be_shown() -> None:
    data = make_data(with_truth=False)
    assert data.states is not None
    path, value, sigma = (np.ones((60, 3)) * np.arange(60)[:, None] for _ in range(3))
    for begin, wrong in ((20, np.nan), (30, np.inf), (40, 1e300), (50, -np.inf)):
        path[begin:], value[begin:], sigma[begin + 3 :] = wrong, wrong, wrong
    data = replace(data, scene=None, events=None)
    broken = Series(data.health.t_s, value, sigma)
    nothing = Series(data.health.t_s, value * np.nan, sigma)
    states = replace(data.states, paths=(path,), velocity=broken, bias_gyroscope=nothing)
    assert "Path in space" in outline(render(replace(data, states=states))).headings
    nowhere = replace(data, states=replace(states, paths=(path * np.nan,)))
    assert "Path in space" not in outline(render(nowhere)).headings
    assert render_overview(nowhere) is None


def test_of_many_segments_the_longest_are_drawn() -> None:
    data = make_data(with_truth=False)
    assert data.states is not None
    paths = tuple(data.states.paths[0][: 5 + n] for n in range(30))
    figures = list(report_figures(replace(data, states=replace(data.states, paths=paths))))
    names = [figure.name for figure in figures if figure.name.startswith(("path", "space"))]
    assert names == [f"{kind}_{n}" for n in (26, 27, 28, 29) for kind in ("path", "space")]
    assert "longest of 30" in figures[0].caption


@pytest.mark.slow
def test_pictures_are_the_figures_of_the_page() -> None:
    data = replace(make_data(), states=None)
    pictures = dict(render_pictures(data))
    assert list(pictures) == [figure.name for figure in report_figures(data)]
    assert list(pictures) == ["health", "features", "events", "tracks", "timing"]
    for picture in pictures.values():
        with Image.open(io.BytesIO(picture)) as image:
            assert image.format == "PNG"
            assert image.width == 800


@pytest.mark.slow
def test_overview_is_a_picture() -> None:
    picture = render_overview(make_data())
    assert picture is not None
    with Image.open(io.BytesIO(picture)) as image:
        assert image.size == (1600, 1280)
        assert len(picture) < 200_000


def test_users_settings_are_left_alone() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    with style.plotting():
        assert dict(matplotlib.rcParams) != before
    assert dict(matplotlib.rcParams) == before


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "available", lambda: False)
    with pytest.raises(VisualizationError, match=r"pip install 'asyneio\[report\]'"):
        render(make_data())
