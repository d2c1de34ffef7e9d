"""TUM trajectories and decimal seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import RecordingError
from asyneio.io import read_trajectory, write_tum
from asyneio.io.parsing.decimal_seconds import format_seconds, parse_seconds
from tests.io.recordings import straight_path


@given(t_ns=st.integers(-(2**63) + 1, 2**63 - 1))
def test_seconds_are_exact(t_ns: int) -> None:
    assert parse_seconds(format_seconds(t_ns)) == t_ns


@pytest.mark.parametrize(
    ("text", "t_ns"),
    [
        ("1520527960.237865414", 1_520_527_960_237_865_414),
        ("1.520527960237865414e9", 1_520_527_960_237_865_414),
        ("-0.000000001", -1),
        ("5", 5_000_000_000),
        ("nan", None),
        ("inf", None),
        ("1e400", None),
        ("1e99999999999", None),
        ("9300000000.0", None),
        ("12:30", None),
    ],
)
def test_seconds_as_people_write_them(text: str, t_ns: int | None) -> None:
    assert parse_seconds(text) == t_ns


def test_tum_round_trip(tmp_path: Path) -> None:
    path = straight_path(1.0)
    write_tum(tmp_path / "t.tum", path)
    found, notes = read_trajectory(tmp_path / "t.tum")
    assert notes == ()
    for name in ("t_ns", "position", "quaternion"):
        np.testing.assert_array_equal(getattr(found, name), getattr(path, name))
    assert (tmp_path / "t.tum").read_text().splitlines()[1].startswith("1600000000.123456789 ")


def test_tum_skips_sorts_and_normalises(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text(
        "# header\n1.002, 0 0 0 0 0 0 1\n1.001 1 0 0 0 0 0 1.001\n\n"
        "broken\n1.003 0 0 0 0 0 0 0\n1.002 5 0 0 0 0 0 1\n"
    )
    found, notes = read_trajectory(tmp_path / "t.tum")
    np.testing.assert_array_equal(found.t_ns, [1_001_000_000, 1_002_000_000])
    np.testing.assert_array_equal(found.position[:, 0], [1.0, 0.0])
    np.testing.assert_allclose(np.linalg.norm(found.quaternion, axis=1), 1.0, atol=1e-15)
    starts = [note.split(": ")[1][:8] for note in notes]
    assert starts == ["skipped ", "skipped ", "sorted b", "dropped "]


@pytest.mark.parametrize("text", ["", "# only a comment\n", "1 2 3\n" * 30])
def test_useless_tum_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "t.tum").write_text(text)
    with pytest.raises(RecordingError, match=r"t\.tum"):
        read_trajectory(tmp_path / "t.tum")
