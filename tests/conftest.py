"""Shared fixtures: real data and a browser where they are, one hypothesis profile, printed seeds."""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator
from pathlib import Path

# As the command line does: small matrices, and tests that run side by side. Numpy reads it when imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings

#: Every random draw of the tests starts here; printed in the header so that a failure can be repeated.
SEED = 20_241_121

settings.register_profile("asyneio", derandomize=True, deadline=None)
settings.load_profile("asyneio")

#: Fixtures that skip where something is missing: the marker of tests that use them, and the variable that
#: turns such a skip into a failure.
_REQUIRED = {
    "data_dir": ("data", "ASYNEIO_REQUIRE_DATA"),
    "chromium": ("browser", "ASYNEIO_REQUIRE_BROWSER"),
}
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

_REPOSITORY = Path(__file__).resolve().parent.parent


def find_data() -> Path | None:
    """The folder of real recordings: ASYNEIO_DATA, or `shared/data` beside the checkout; None if absent."""
    named = os.environ.get("ASYNEIO_DATA")
    folder = Path(named) if named else _REPOSITORY.parent / "shared" / "data"
    return folder if folder.is_dir() else None


def pytest_report_header() -> str:
    data = find_data()
    return f"asyneio: seed {SEED}, hypothesis derandomized, real data {data if data else 'absent'}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A test that skips for want of what a variable says must be there has failed."""
    report = yield
    for fixture, (_, variable) in _REQUIRED.items():
        if os.environ.get(variable) and report.skipped and fixture in _fixtures(item):
            reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
            report.outcome = "failed"
            report.longrepr = f"skipped although {variable} is set: {reason}"
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that need something which may be absent, so that a fast subset can leave them out."""
    for item in items:
        for fixture, (marker, _) in _REQUIRED.items():
            if fixture in _fixtures(item):
                item.add_marker(marker)


def _fixtures(item: pytest.Item) -> list[str]:
    return item.fixturenames if isinstance(item, pytest.Function) else []


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings. Tests that need it are skipped where there is none."""
    data = find_data()
    if data is None:
        pytest.skip("real data absent: set ASYNEIO_DATA to the folder that holds tumvi_calib")
    return data


@pytest.fixture(scope="session")
def chromium() -> str:
    """Path of a Chromium. Tests that need it are skipped where there is none."""
    found = next((path for path in map(shutil.which, _BROWSERS) if path), None)
    if found is None:
        pytest.skip(
            f"no browser among {', '.join(_BROWSERS)}: install one (Debian: apt-get install chromium)"
        )
    return found


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator in the same state for every test."""
    return np.random.default_rng(SEED)
