"""Functions printed in pages are those of the package."""

from __future__ import annotations

from pathlib import Path

import pytest

from .print_functions import BLOCK, ROOT, pages, refreshed, source_of, without_docstring

PRINTED = [(path, *match.group(2, 3)) for path in pages() for match in BLOCK.finditer(path.read_text())]


@pytest.mark.parametrize(("path", "name", "printed"), PRINTED, ids=[name for _, name, _ in PRINTED])
def test_block_is_the_function(path: Path, name: str, printed: str) -> None:
    assert printed == source_of(name), f"{path.name}: run `python tests/docs/print_functions.py --write`"


def test_the_algorithm_is_printed() -> None:
    names = {name for path, name, _ in PRINTED if path == ROOT / "docs" / "architecture.md"}
    assert names == {
        "asyneio.odometry.odometry.Odometry.process",
        "asyneio.frontend.gradient.kernel.process_events",
    }


def test_the_docstring_is_left_out_and_nothing_else() -> None:
    lines = [
        "def f(x):",
        '    """Two lines',
        '    of documentation."""',
        "    # A comment.",
        '    return "text"',
    ]
    assert without_docstring("\n".join(lines)).splitlines() == [lines[0], *lines[3:]]
    indented = "\n".join(f"    {line}" for line in lines)
    assert without_docstring(indented).splitlines() == [lines[0], *lines[3:]]


def test_a_stale_block_is_refreshed() -> None:
    stale = "<!-- source: asyneio.geometry.se3.bracket -->\n```python\ndef bracket(): ...\n```\n"
    assert "curly(a) b" not in refreshed(stale)
    assert "out[5] = a[3] * b[1]" in refreshed(stale)
    assert refreshed(refreshed(stale)) == refreshed(stale)
