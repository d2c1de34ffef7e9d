"""The page of promises names tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]


def test_every_promise_has_a_test_that_exists() -> None:
    text = (_ROOT / "docs" / "reliability.md").read_text()
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text)
    assert len(named) > 60
    for path, name in named:
        source = (_ROOT / path).read_text()
        assert not name or f"\ndef {name}(" in source, f"{path}::{name}"
    rows = [line for line in text.splitlines() if line.startswith("| ") and not line.startswith("| promise")]
    assert all("tests/" in row or "benchmarks/" in row for row in rows), rows
