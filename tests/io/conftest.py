"""Conversions made by these tests are kept in a folder of their own."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    before = os.environ.get("ASYNEIO_CACHE")
    os.environ["ASYNEIO_CACHE"] = str(tmp_path_factory.mktemp("cache"))
    yield
    if before is None:
        del os.environ["ASYNEIO_CACHE"]
    else:
        os.environ["ASYNEIO_CACHE"] = before


@pytest.fixture
def events(rng: np.random.Generator) -> np.ndarray:
    """Columns t [us], x, y, p of 3000 events, int64."""
    t = np.sort(rng.integers(0, 300_000, 3000))
    return np.stack([t, rng.integers(0, 240, 3000), rng.integers(0, 180, 3000), rng.integers(0, 2, 3000)], 1)
