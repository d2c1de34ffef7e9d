"""Faults of events in a file, as `asyneio convert` and `asyneio track` meet them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from asyneio.io import open_recording
from asyneio.types import EventRecording
from tests.cli.conftest import Asyneio

_COUNT = 20_000


def rows() -> np.ndarray:
    """Events t [us], x, y, p of a DAVIS240C, every 50 us."""
    rng = np.random.default_rng(3)
    columns = [50 * np.arange(_COUNT), rng.integers(0, 240, _COUNT), rng.integers(0, 180, _COUNT)]
    return np.stack([*columns, rng.integers(0, 2, _COUNT)], axis=1)


def write(path: Path, events: np.ndarray) -> Path:
    path.write_text("".join(f"{t // 10**6}.{t % 10**6:06d} {x} {y} {p}\n" for t, x, y, p in events.tolist()))
    return path


def write_raw(path: Path, events: np.ndarray) -> Path:
    """EVT 2.0 with a high time before every event."""
    high = 8 << 28 | events[:, 0] >> 6
    word = events[:, 3] << 28 | (events[:, 0] & 63) << 22 | events[:, 1] << 11 | events[:, 2]
    words = np.stack([high, word], axis=1).astype("<u4")
    path.write_bytes(b"% evt 2.0\n% geometry 240x180\n% end\n" + words.tobytes())
    return path


def converted(asyneio: Asyneio, path: Path) -> tuple[int, str, np.ndarray | None]:
    """Exit status, messages, and events of `asyneio convert`."""
    target = path.parent / "out" / "events.h5"
    target.parent.mkdir(exist_ok=True)
    target.unlink(missing_ok=True)
    status, _, said = asyneio("convert", path, target)
    assert target.exists() == (status == 0)
    if status:
        return status, said, None
    recording = open_recording(target)
    assert isinstance(recording, EventRecording)
    return status, said, recording.events


def test_a_little_disorder_is_sorted_and_counted(asyneio: Asyneio, tmp_path: Path) -> None:
    events = rows()
    order = np.arange(_COUNT)
    order[100:150] = order[100:150][::-1]
    status, said, found = converted(asyneio, write(tmp_path / "events.txt", events[order]))
    assert status == 0
    assert "sorted 49 late event(s), by at most 2.45 ms" in said
    assert found is not None
    np.testing.assert_array_equal(found["x"], events[:, 1])


def test_late_events_are_dropped_and_counted(asyneio: Asyneio, tmp_path: Path) -> None:
    events = rows()
    late = np.concatenate([events[:10_000], events[5_000:5_050], events[10_000:]])
    status, said, found = converted(asyneio, write(tmp_path / "events.txt", late))
    assert status == 0
    assert "dropped 50 event(s) that were more than 10 ms late" in said
    assert found is not None
    assert found.size == _COUNT


@pytest.mark.parametrize("write", [write, write_raw])
def test_time_that_jumps_back_is_joined(
    asyneio: Asyneio, tmp_path: Path, write: Callable[[Path, np.ndarray], Path]
) -> None:
    events = rows()
    events[:, 0] *= 2
    looped = np.concatenate([events, events])
    status, said, found = converted(asyneio, write(tmp_path / "events", looped))
    assert status == 0
    assert "time jumps back by 2.000 s before event 20000" in " ".join(said.split())
    assert found is not None
    offset_us = np.repeat([0, 4_000_000], _COUNT)
    np.testing.assert_array_equal(found["t_ns"] // 1000, looped[:, 0] + offset_us)
    np.testing.assert_array_equal(found["x"], looped[:, 1])


def test_rows_without_order_stop(asyneio: Asyneio, tmp_path: Path) -> None:
    events = rows()
    by_pixel = events[np.argsort(events[:, 1], kind="stable")]
    status, said, _ = converted(asyneio, write(tmp_path / "events.txt", by_pixel))
    assert status == 1
    assert "Sort it, in its folder: sort -s -g" in " ".join(said.split())


@pytest.mark.slow
def test_one_wrong_stamp(asyneio: Asyneio, tmp_path: Path) -> None:
    for row in (0, 7_000, _COUNT - 1):
        events = rows()
        events[row, 0] += 10**13
        status, said, found = converted(asyneio, write(tmp_path / "events.txt", events))
        assert status == 0, said
        assert "dropped 1" in said
        assert found is not None
        assert found.size == _COUNT - 1


def test_events_outside_the_sensor(asyneio: Asyneio, tmp_path: Path) -> None:
    """A header names the sensor: 240 x 180."""
    for outside, expected in ((100, 0), (400, 1)):
        events = rows()
        events[:outside, 1] = 300
        status, said, _ = converted(asyneio, write_raw(tmp_path / "events.raw", events))
        assert status == expected
        words_of = " ".join(said.split())
        if expected:
            assert "wrong resolution?" in words_of
            assert "400 of 20000 events are outside the 240 x 180 sensor" in words_of
        else:
            assert "dropped 100 event(s) outside the 240 x 180 sensor" in words_of


@pytest.mark.slow
@pytest.mark.parametrize("names", [("0", "1"), ("-1", "1"), ("false", "true"), ("False", "True")])
def test_polarities(asyneio: Asyneio, tmp_path: Path, names: tuple[str, str]) -> None:
    events = rows()
    path = tmp_path / "events.txt"
    path.write_text(
        "".join(f"{t // 10**6}.{t % 10**6:06d} {x} {y} {names[p]}\n" for t, x, y, p in events.tolist())
    )
    status, _, found = converted(asyneio, path)
    assert status == 0
    assert found is not None
    np.testing.assert_array_equal(found["p"], events[:, 3])


def test_other_polarities_stop(asyneio: Asyneio, tmp_path: Path) -> None:
    events = rows()
    events[:, 3] += 1
    status, said, _ = converted(asyneio, write(tmp_path / "events.txt", events))
    assert status == 1
    assert "column 4 has the values 1 and 2: a polarity is 0 and 1, or -1 and 1" in " ".join(said.split())


def test_garbage_lines(asyneio: Asyneio, tmp_path: Path) -> None:
    path = write(tmp_path / "events.txt", rows())
    lines = path.read_text().splitlines()
    kinds = ["nan 1 2 1", "0.1 inf 5 1", "garbage", "0.1 5 5", "0.1 5 5 0.5", "0.1 5 5 7"]
    path.write_text("\n".join(lines[:50] + kinds + lines[50:]) + "\n")
    status, said, found = converted(asyneio, path)
    assert status == 0
    assert "skipped 6 unreadable line(s), number 51, 52, 53, 54, 55" in " ".join(said.split())
    assert found is not None
    assert found.size == _COUNT
    path.write_text("\n".join(lines[:50] + 4 * kinds + lines[50:]) + "\n")
    status, said, _ = converted(asyneio, path)
    assert status == 1
    assert "more than 20 unreadable lines" in " ".join(said.split())


def test_seconds_that_are_microseconds(asyneio: Asyneio, tmp_path: Path) -> None:
    path = tmp_path / "events.txt"
    np.savetxt(path, rows(), fmt="%d")
    status, said, _ = converted(asyneio, path)
    assert status == 1
    assert "microseconds" in said


def test_no_events_at_all(asyneio: Asyneio, tmp_path: Path) -> None:
    path = tmp_path / "events.txt"
    path.write_text("# t x y p\n")
    status, said, _ = converted(asyneio, path)
    assert status == 1
    assert "events" in said
