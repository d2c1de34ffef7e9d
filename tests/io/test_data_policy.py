"""Tests on real data, or in a browser, skip without them, and fail where they are said to be there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

_CONFTEST = Path(__file__).resolve().parent.parent / "conftest.py"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("required", "present", "outcome"),
    [("", False, "1 skipped"), ("1", False, "1 error"), ("1", True, "1 passed")],
)
def test_outcome(tmp_path: Path, required: str, present: bool, outcome: str) -> None:
    shutil.copy(_CONFTEST, tmp_path)
    (tmp_path / "test_it.py").write_text("def test_it(data_dir):\n    assert data_dir.is_dir()\n")
    data = tmp_path / "data"
    if present:
        data.mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", ".", "."],
        cwd=tmp_path,
        env={**os.environ, "ASYNEIO_DATA": str(data), "ASYNEIO_REQUIRE_DATA": required},
        capture_output=True,
        text=True,
        check=False,
    )
    assert outcome in done.stdout
    assert done.returncode == (outcome == "1 error")


@pytest.mark.slow
@pytest.mark.parametrize(("required", "outcome"), [("", "1 skipped"), ("1", "1 error")])
def test_browser(tmp_path: Path, required: str, outcome: str) -> None:
    shutil.copy(_CONFTEST, tmp_path)
    (tmp_path / "test_it.py").write_text("def test_it(chromium):\n    assert chromium\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", ".", "."],
        cwd=tmp_path,
        env={**os.environ, "PATH": str(tmp_path), "ASYNEIO_REQUIRE_BROWSER": required},
        capture_output=True,
        text=True,
        check=False,
    )
    assert outcome in done.stdout
