"""A stamp that is wrong all by itself is dropped and counted; a clock that was set is refused as before."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io.parsing.isolated_stamps import isolated
from asyneio.io.parsing.stamp_checks import sort_in_time
from asyneio.types import INERTIAL_DTYPE, IntArray

S = 1_000_000_000
EPOCH = 1_600_000_000 * S


def stamps(count: int = 400) -> IntArray:
    return EPOCH + np.arange(count, dtype=np.int64) * 1_000_000


@pytest.mark.parametrize("index", [0, 1, 200, 398, 399])
@pytest.mark.parametrize("wrong", [0, -5 * S, EPOCH + 1800 * S, EPOCH - 3600 * S, 2**63 - 1, -(2**63)])
def test_one_wrong_stamp_is_told_apart(index: int, wrong: int) -> None:
    t_ns = stamps()
    t_ns[index] = wrong
    assert np.flatnonzero(isolated(t_ns)).tolist() == [index]


def test_several_are_dropped_and_counted() -> None:
    t_ns = stamps()
    t_ns[[0, 100, 101, 250, 399]] = [0, 7, 8, EPOCH + 100 * S, 0]
    rows = np.zeros(t_ns.size, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = t_ns
    kept, notes = sort_in_time(rows, "imu.txt")
    assert kept.size == 395
    assert np.all(np.diff(kept["t_ns"]) > 0)
    assert notes[0].startswith("imu.txt: dropped 5 row(s) with an isolated wrong time stamp")


@pytest.mark.parametrize("step_ns", [1_000_000, S, 2 * S])
def test_pauses_jitter_and_slow_rows_are_left_alone(step_ns: int) -> None:
    t_ns = EPOCH + np.arange(200, dtype=np.int64) * step_ns
    assert not isolated(t_ns).any()
    t_ns[100:] += 30 * S
    t_ns[50], t_ns[51] = t_ns[51], t_ns[50]
    swapped = isolated(t_ns)
    assert np.count_nonzero(swapped) <= (1 if step_ns > 10_000_000 else 0)
    assert not isolated(t_ns[:5]).any()


def test_a_clock_that_was_set_is_still_refused() -> None:
    t_ns = stamps()
    t_ns[200:] -= 60 * S
    rows = np.zeros(t_ns.size, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = t_ns
    assert not isolated(t_ns).any()
    with pytest.raises(RecordingError, match="time runs backwards"):
        sort_in_time(rows, "imu.txt")


@pytest.mark.parametrize(("count", "dropped"), [(5, 5), (20, 20), (40, 0)])
@pytest.mark.parametrize("end", [False, True])
def test_first_and_last_stamps_of_another_epoch(count: int, dropped: int, end: bool) -> None:
    """A driver that does not know the time yet: up to one row in a hundred."""
    t_ns = stamps(2000)
    part = slice(-count, None) if end else slice(count)
    t_ns[part] = (EPOCH * 2 if end else 0) + np.arange(count) * 1_000_000
    assert int(np.count_nonzero(isolated(t_ns))) == dropped


def test_rows_that_are_not_sorted_are_named(rng: np.random.Generator) -> None:
    rows = np.zeros(400, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = rng.permutation(stamps())
    with pytest.raises(
        RecordingError,
        match=r"not sorted by time.*\(in the folder of the file: sort -s -g imu.txt > sorted.txt\)",
    ):
        sort_in_time(rows, "imu.txt")
