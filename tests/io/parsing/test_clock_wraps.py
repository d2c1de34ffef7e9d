"""A 32-bit counter of microseconds that wraps around: time continues, and nothing else is changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io.parsing.clock_wraps import PERIODS_NS, unwrapped, wrap_period
from asyneio.io.parsing.stamp_checks import sort_in_time
from asyneio.io.recording.trajectory_reader import read_trajectory
from asyneio.types import INERTIAL_DTYPE, IntArray, RecordArray
from tests.io.recordings import START_NS


def rows_at(t_ns: IntArray) -> RecordArray:
    rows = np.zeros(t_ns.size, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = t_ns
    return rows


TRUE_NS = PERIODS_NS[0] - 500_000_000 + 5_000_000 * np.arange(200)


@pytest.mark.parametrize("signed", [False, True])
def test_time_continues_after_a_wrap_around(signed: bool) -> None:
    start_ns = TRUE_NS if not signed else TRUE_NS - PERIODS_NS[1]
    stored = (start_ns + signed * PERIODS_NS[1]) % PERIODS_NS[0] - signed * PERIODS_NS[1]
    rows, notes = sort_in_time(rows_at(stored), "imu.txt")
    np.testing.assert_array_equal(rows["t_ns"], start_ns)
    assert notes == (
        "imu.txt: the clock wraps around before row 101 (a counter of microseconds with 32 bits): from there "
        "on, 4294.967296 s are added to the time stamps",
    )


def test_several_wrap_arounds_and_late_rows() -> None:
    true = np.arange(0, 3 * PERIODS_NS[1], 10**9)
    true[[2148, 2149]] = true[[2149, 2148]]
    late = np.array([0, 1, 3, 2, 4]) * 1000 + PERIODS_NS[1] - 2500
    for t_ns, turns in ((true, 2), (late, 1)):
        rows, notes = unwrapped(rows_at(t_ns % PERIODS_NS[1]), "a")
        np.testing.assert_array_equal(rows["t_ns"], t_ns)
        assert "with 31 bits" in notes[0]
        assert turns == t_ns.max() // PERIODS_NS[1]


@pytest.mark.parametrize("back_ns", [PERIODS_NS[0] + 16_000_000, PERIODS_NS[0] - 200_000_000, 10**12])
def test_a_clock_that_was_set_back_is_not_a_wrap_around(back_ns: int) -> None:
    t_ns = TRUE_NS.copy()
    t_ns[100:] -= back_ns
    rows = rows_at(t_ns)
    assert unwrapped(rows, "a") == (rows, ())
    with pytest.raises(RecordingError, match="time runs backwards"):
        sort_in_time(rows, "a")


def test_a_single_row_is_left_to_the_other_checks() -> None:
    t_ns = TRUE_NS.copy()
    t_ns[100] -= PERIODS_NS[0]
    assert unwrapped(rows_at(t_ns), "a")[1] == ()
    assert "isolated wrong time stamp" in sort_in_time(rows_at(t_ns), "a")[1][0]


def test_the_limits_of_a_wrap_around() -> None:
    assert wrap_period(PERIODS_NS[0] - 1000) == PERIODS_NS[0]
    assert wrap_period(PERIODS_NS[1] + 1000) == PERIODS_NS[1]
    assert wrap_period(PERIODS_NS[0] - 10**9) == wrap_period(0) == 0


def test_poses_continue_after_a_wrap_around(tmp_path: Path) -> None:
    true = START_NS + 10_000_000 * np.arange(100)
    stored = true - PERIODS_NS[0] * (np.arange(100) >= 60)
    lines = (f"{t // 10**9}.{t % 10**9:09d} {k} 0 0 0 0 0 1" for k, t in enumerate(stored.tolist()))
    (tmp_path / "truth.txt").write_text("\n".join(lines) + "\n")
    poses, notes = read_trajectory(tmp_path / "truth.txt")
    np.testing.assert_array_equal(poses.t_ns, true)
    np.testing.assert_array_equal(poses.position[:, 0], np.arange(100))
    assert any("wraps around before row 61" in note for note in notes)
