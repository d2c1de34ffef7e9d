"""The demonstration with the real estimator in a process of its own: a report, a small error."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from asyneio.evaluation import evaluate, protocol_named
from asyneio.io import open_recording, read_estimates, to_trajectory
from asyneio.types import EventRecording
from tests.viz.chromium import Browser, browser

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    folder = tmp_path_factory.mktemp("demo") / "results"
    code = "from asyneio.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "demo", "-o", str(folder), "--duration", "2.5"],
        capture_output=True,
        text=True,
        check=False,
    )
    return folder, done


def test_it_ends_well_and_says_where_the_report_is(
    demo: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    folder, done = demo
    assert done.returncode == 0, done.stderr
    assert f"Open {(folder / 'report.html').as_uri()}" in done.stderr
    assert "position error, RMSE (ATE)" in done.stdout
    assert (folder / "report.html").stat().st_size > 50_000


def test_its_outputs_agree(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, _ = demo
    summary = json.loads((folder / "summary.json").read_text())
    estimates = read_estimates(folder / "estimates.npz")
    assert summary["failure"] == ""
    assert summary["knots"] == len(estimates) >= 10
    recording = open_recording(folder / "recording")
    assert isinstance(recording, EventRecording)
    assert summary["events"] == recording.events.size > 100_000
    assert recording.ground_truth is not None
    score = evaluate(to_trajectory(estimates), recording.ground_truth, protocol_named("posyaw"))
    # Two and a half seconds: centimetres, where a wrong frame or clock would cause decimetres.
    assert score.position_m.rmse < 0.05
    assert score.orientation_deg.rmse < 2.0


@pytest.fixture(scope="module")
def page(chromium: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(chromium, tmp_path_factory.mktemp("profile")) as opened:
        yield opened


_INK = """(() => {
    const canvas = document.querySelector("canvas"), copy = new OffscreenCanvas(canvas.width, canvas.height);
    const brush = copy.getContext("2d", { willReadFrequently: true });
    brush.drawImage(canvas, 0, 0);
    const data = brush.getImageData(0, 0, canvas.width, canvas.height).data;
    let drawn = 0, sum = 0;
    for (let i = 3; i < data.length; i += 4)
        if (data[i]) { drawn += 1; sum = (sum * 31 + i) % 1000003; }
    return [drawn / (canvas.width * canvas.height), sum];
})()"""


@pytest.mark.parametrize(
    ("width", "height", "dark"), [(360, 800, False), (360, 800, True), (1280, 900, False)]
)
def test_its_report_in_a_browser(
    page: Browser,
    demo: tuple[Path, subprocess.CompletedProcess[str]],
    width: int,
    height: int,
    dark: bool,
) -> None:
    page.open(demo[0] / "report.html", width, height, dark)
    assert page.errors == []
    assert page.requests
    assert {request.partition(":")[0] for request in page.requests} <= {"file", "data"}
    assert page.run("innerWidth") == width
    assert page.run("document.documentElement.scrollWidth") <= width
    # Nothing overflows its card, and no text in a figure is too small to read.
    assert page.run(
        "[...document.querySelectorAll('main *')].filter(e => !e.closest('svg') || e.tagName == 'svg')"
        ".every(e => e.getBoundingClientRect().right <= innerWidth)"
    )
    least = page.run(
        "Math.min(...[...document.querySelectorAll('svg text')].filter(e => e.getClientRects().length)"
        ".map(e => [parseFloat(getComputedStyle(e).fontSize), e.getScreenCTM()])"
        ".map(([size, to]) => size * Math.hypot(to.c, to.d)))"
    )
    assert least > 8.0
    share, before = page.run(_INK)
    assert 0.01 < share < 0.9
    left, top = page.run(
        "(c => { c.scrollIntoView(); const box = c.getBoundingClientRect(); return [box.left, box.top]; })"
        "(document.querySelector('canvas'))"
    )
    turn, scrolled = page.swipe if width < 600 else page.drag, page.run("scrollY")
    turn((left + 150, top + 100), (left + 60, top + 130))
    assert page.run("scrollY") == scrolled
    turned, after = page.run(_INK)
    assert 0.01 < turned < 0.9
    assert after != before
    ground = page.run("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)")
    assert (max(ground) < 60) == dark
    assert page.errors == []


def test_its_report_without_script_and_on_paper(
    page: Browser, demo: tuple[Path, subprocess.CompletedProcess[str]]
) -> None:
    still = "document.querySelector('.space svg').getBoundingClientRect().height"
    page.open(demo[0] / "report.html", 360, 800)
    assert page.run(still) == 0.0
    page.open(demo[0] / "report.html", 800, 1100, dark=True, media="print")
    assert page.run(still) > 100.0
    assert page.run("document.querySelector('canvas').getBoundingClientRect().height") == 0.0
    assert page.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    page.open(demo[0] / "report.html", 360, 800, script=False)
    assert page.run(still) > 100.0
    assert page.run("document.querySelector('canvas') === null")
    assert page.errors == []
