"""Conversions made by these tests are kept in a folder of their own."""

from __future__ import annotations

import os
from collections.abc import Iterator

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
