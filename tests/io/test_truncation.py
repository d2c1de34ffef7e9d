"""Files of every format, truncated at random places: what precedes the cut is read and the cut reported.

`benchmarks/fuzz.py damage` does the same with more files, and with real ones.
"""

from __future__ import annotations

import gzip
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import AsyneioError, RecordingError
from asyneio.io import ReadOptions, open_recording, read_inertial_file, read_trajectory
from asyneio.io.recording.damage import damage_notes
from asyneio.types import EventRecording
from tests.io.damage import damaged_copies, intact_file, truncated
from tests.io.small_files import FILES, make_csv, make_numpy, make_text
from tests.io.validity import assert_valid

_COUNT = 8
#: Formats whose libraries need the end of the file: nothing can be read from a truncated one.
_NEEDS_THE_END = {"asyneio hdf5", "columns", "m3ed", "mvsec", "npz", "prophesee hdf5", "v2e hdf5", "zip"}
#: Formats of equal words or lines without a length: a cut between two of them cannot be seen.
_NO_LENGTH = {
    "aedat2", "csv", "dat", "event stream", "event stream, ATIS", "evt2", "evt2.1", "evt3", "text",
}  # fmt: skip
_LIMIT_S = 20.0


@pytest.mark.parametrize("kind", FILES)
def test_truncated(tmp_path: Path, kind: str) -> None:
    """A beginning of the events with a note, or an error with a message; strict mode stops at the note."""
    intact = intact_file(kind, tmp_path)
    whole = intact.recording.events
    (tmp_path / "cut").mkdir()
    path = tmp_path / "cut" / "recording"
    for data in damaged_copies(kind, intact, _COUNT, truncated):
        path.write_bytes(data)
        start = time.monotonic()
        try:
            found = open_recording(path)
        except AsyneioError as error:
            assert str(error)  # noqa: PT017
            continue
        finally:
            assert time.monotonic() - start < _LIMIT_S
        assert kind not in _NEEDS_THE_END
        assert isinstance(found, EventRecording)
        assert_valid(found)
        np.testing.assert_array_equal(found.events, whole[: found.events.size])
        if damage_notes(found.notes):
            with pytest.raises(RecordingError, match="is rejected \\(strict\\)"):
                open_recording(path, ReadOptions(strict=True))
        else:
            assert found.events.size == whole.size or kind in _NO_LENGTH
            open_recording(path, ReadOptions(strict=True))


@pytest.mark.parametrize("kind", sorted(_NO_LENGTH | {"gzip", "npy"}))
def test_everything_before_the_cut_is_read(tmp_path: Path, kind: str) -> None:
    """70 % of the file gives a good part of the events; in AEDAT-2.0, most of the start are samples."""
    share = 0.05 if kind == "aedat2" else 0.3
    intact = intact_file(kind, tmp_path)
    (tmp_path / "cut").mkdir()
    path = tmp_path / "cut" / "recording"
    path.write_bytes(intact.data[: int(0.7 * len(intact.data))])
    assert open_recording(path).events.size > share * intact.recording.events.size


def test_a_truncated_last_number_is_no_event(tmp_path: Path) -> None:
    """x, y, p, t: a time that has lost digits is a wrong time, though the line has four numbers."""
    path = make_csv(tmp_path / "recording")
    whole = open_recording(path)
    path.write_bytes(path.read_bytes()[:-3])
    found = open_recording(path)
    np.testing.assert_array_equal(found.events, whole.events[:-1])
    assert any("ends inside line 61: truncated?" in note for note in found.notes)


def test_the_last_event_of_an_intact_text_is_kept(tmp_path: Path) -> None:
    """t, x, y, p: without a line feed at the end, nothing is missing from a polarity of one digit."""
    path = make_text(tmp_path / "recording")
    count = open_recording(path).events.size
    path.write_bytes(path.read_bytes().rstrip(b"\n"))
    found = open_recording(path, ReadOptions(strict=True))
    assert found.events.size == count


def _samples(count: int, shown: str) -> str:
    rows = ((0.005 * k, 0.1 * np.sin(k)) for k in range(count))
    return "".join(f"{t:.3f} 0.01 0.02 9.81 0.001 0.002 {last:{shown}}\n" for t, last in rows)


def _poses(count: int, shown: str) -> str:
    rows = ((0.1 * k, np.sin(0.01 * k), np.cos(0.01 * k)) for k in range(count))
    return "".join(f"{t:.1f} {t:.1f} 0 0 0 0 {z:.12f} {w:{shown}}\n" for t, z, w in rows)


_READERS: dict[str, tuple[Callable[[int, str], str], Callable[[Path], tuple[int, tuple[str, ...]]]]] = {
    "imu.txt": (_samples, lambda path: (len((found := read_inertial_file(path)).gyroscope), found.notes)),
    "groundtruth.txt": (_poses, lambda path: (len((found := read_trajectory(path))[0].t_ns), found[1])),
}


@pytest.mark.parametrize("name", _READERS)
@pytest.mark.parametrize("shown", [".6f", ".9f", ".6e"])
@pytest.mark.parametrize("cut", range(1, 6))
def test_a_number_that_lost_digits_is_no_sample_or_pose(
    tmp_path: Path, name: str, shown: str, cut: int
) -> None:
    """All numbers have as many decimals: the last one shows the cut."""
    write, read = _READERS[name]
    path = tmp_path / name
    path.write_text(write(30, shown)[: -1 - cut])
    count, notes = read(path)
    assert count == 29
    # An exponent without digits is no number at all.
    expected = f"{name} ends inside line 30: truncated? read up to there"
    unreadable = f"{name}: skipped 1 unreadable line(s), number 30"
    assert damage_notes(notes) in ((expected,), (unreadable,))


@pytest.mark.parametrize("name", _READERS)
def test_a_complete_last_line_needs_no_line_feed(tmp_path: Path, name: str) -> None:
    write, read = _READERS[name]
    path = tmp_path / name
    path.write_text(write(30, ".9f").rstrip("\n"))
    count, notes = read(path)
    assert count == 30
    assert damage_notes(notes) == ()


@pytest.mark.parametrize("name", _READERS)
def test_a_last_number_of_unknown_length_is_not_used(tmp_path: Path, name: str) -> None:
    """Decimals vary: the file may be complete, so it is not damaged."""
    write, read = _READERS[name]
    path = tmp_path / name
    lines = write(30, ".9f").splitlines()
    lines[3] = lines[3][:-6]
    path.write_text("\n".join(lines)[:-4])
    count, notes = read(path)
    assert count == 29
    assert damage_notes(notes) == ()
    assert any(note.startswith(f"{name}: line 30 is not used: no line feed ends it") for note in notes)


def test_truncated_gzip(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    lines = "".join(f"{k}.{rng.integers(10**6):06d} {rng.integers(240)} 5 1\n" for k in range(3000))
    path = tmp_path / "recording"
    path.write_bytes(gzip.compress(lines.encode(), mtime=0)[:-6000])
    found = open_recording(path)
    assert 1500 < found.events.size < 3000
    assert any("truncated?" in note for note in found.notes)


def test_truncated_npy(tmp_path: Path) -> None:
    path = make_numpy(False)(tmp_path / "recording")
    whole = open_recording(path)
    path.write_bytes(path.read_bytes()[:-50])
    found = open_recording(path)
    np.testing.assert_array_equal(found.events, whole.events[:58])
    assert any("has 58 of 60 declared rows: truncated?" in note for note in found.notes)
