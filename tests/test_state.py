"""Columns of the error state: against the names of the record, the documented table and each other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from asyneio import state
from asyneio.types import STATE_BLOCKS

ROOT = Path(__file__).parent.parent
BLOCKS = ("PHI", "RHO", "OMEGA", "NU", "OMEGA_DOT", "NU_DOT", "B_G", "B_A")
#: Slices and multiples that only a knot's error state or an interval's local coordinates have.
LITERAL = re.compile(r"\b(24 \* \w+|KNOT_DOF|9:12|12:18|18:24|18:21|33:36)\b")


def test_blocks_are_those_of_the_record() -> None:
    """`Estimate.covariance` names its blocks in STATE_BLOCKS."""
    assert [getattr(state, name) for name in BLOCKS] == [3 * i for i in range(len(STATE_BLOCKS))]
    names = {"B_G": "bias_gyroscope", "B_A": "bias_accelerometer"}
    assert tuple(names.get(name, name.lower()) for name in BLOCKS) == STATE_BLOCKS
    assert 3 * len(STATE_BLOCKS) == state.DOF


def test_blocks_are_those_of_the_conventions() -> None:
    text = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+)-(\d+) \| `(\w+)` \|", text, flags=re.MULTILINE)
    expected = [(str(3 * i), str(3 * i + 2), name) for i, name in enumerate(STATE_BLOCKS)]
    assert rows == expected


def test_local_coordinates_begin_as_the_error_state() -> None:
    """The first three blocks of six coincide, and two knots have as many coordinates as an interval."""
    assert (state.EPS_0, state.XI_DOT_0, state.XI_DDOT_0) == (state.EPS, state.VARPI, state.VARPI_DOT)
    assert state.XI == state.KINEMATIC_DOF == state.BIAS
    assert state.BIAS_0 == state.KINEMATIC_LOCAL_DOF == 2 * state.KINEMATIC_DOF
    assert state.BIAS_1 + 6 == state.LOCAL_DOF == 2 * state.DOF


@pytest.mark.parametrize("room", ["trajectory", "factors", "initialization", "estimation", "odometry"])
def test_no_column_is_a_literal(room: str) -> None:
    for path in sorted((ROOT / "src" / "asyneio" / room).rglob("*.py")):
        code = re.sub(r'""".*?"""|#[^\n]*', "", path.read_text(encoding="utf-8"), flags=re.S)
        found = LITERAL.search(code)
        assert found is None, f"{path.relative_to(ROOT)}: {found.group() if found else ''}; use asyneio.state"
