"""EVT 2.0: a real file, words written after the documentation, wrapping clocks, wrong bits, damage."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from asyneio.io.prophesee import high_time
from asyneio.io.prophesee import reader as prophesee
from asyneio.io.prophesee.evt2 import Evt2Decoder
from tests.io.prophesee.files import DAT, both, event, high, read, record, rows, write


def test_real_evt2(data_dir: Path) -> None:
    """Counts and times after the notes that came with the file; every word by the plainest reading."""
    path = data_dir / "formats" / "gen3.evt2.raw"
    found = read(path)
    assert found.events.size == 521_252
    assert (found.width, found.height) == (640, 480)
    assert found.events["t_ns"][0] == 913_716_224_000
    assert found.events["t_ns"][-1] == 913_812_095_000
    data = path.read_bytes()
    while data.startswith(b"% "):
        data = data[data.index(b"\n") + 1 :]
    words = np.frombuffer(data[: len(data) // 4 * 4], dtype="<u4").astype(np.int64)
    is_high = words >> 28 == 8
    base = (words[is_high] & 0xFFFFFFF)[np.maximum(np.cumsum(is_high) - 1, 0)] << 6
    is_event = (words >> 28 <= 1) & (np.cumsum(is_high) > 0)
    t_ns = (base + (words >> 22 & 63))[is_event] * 1000
    order = np.argsort(t_ns, kind="stable")
    np.testing.assert_array_equal(found.events["t_ns"], t_ns[order])
    for name, values in (("x", words >> 11 & 0x7FF), ("y", words & 0x7FF), ("p", words >> 28)):
        np.testing.assert_array_equal(found.events[name], values[is_event][order])


def test_big_endian(tmp_path: Path) -> None:
    swapped = np.frombuffer(both(1000), "<u4").astype(">u4").tobytes()
    header = b"% format EVT2;height=480;width=640;endianness=big\n% end\n"
    assert rows(read(write(tmp_path, swapped, header=header))) == [(1_000_000, 1, 2, 1)]


def test_clock_turns_over(tmp_path: Path) -> None:
    turn = 2**34
    times = [turn - 100, turn - 1, turn, turn + 100_000]
    assert [row[0] for row in rows(read(write(tmp_path, *map(both, times))))] == [1000 * t for t in times]


def test_triggers_and_other_words(tmp_path: Path) -> None:
    trigger, other, strange = (struct.pack("<I", code << 28 | 1) for code in (10, 14, 5))
    found = read(write(tmp_path, event(3), both(1000), trigger, trigger, other, strange, event(1001), b"\1"))
    assert [row[0] for row in rows(found)] == [1_000_000, 1_001_000]
    notes = " ".join(found.notes)
    for text in ("1 event(s) before the first time", "2 external trigger(s)", "1 word(s) of unknown type",
                 "1 byte(s) at the end are not a complete event"):  # fmt: skip
        assert text in notes


def test_wrong_bit_of_the_clock(tmp_path: Path) -> None:
    """A high time that its successor contradicts is not believed; a pause that lasts is."""
    wrong = 1000 | 1 << 33
    found = read(write(tmp_path, both(1000), both(wrong), both(1064)))
    assert [row[0] for row in rows(found)] == [1_000_000, (1000 & ~63 | wrong & 63) * 1000, 1_064_000]
    assert any("1 high time(s) that contradict" in note for note in found.notes)
    pause = 90_000_000
    found = read(write(tmp_path, both(1000), both(pause), both(pause + 64)))
    assert [row[0] for row in rows(found)] == [1_000_000, pause * 1000, (pause + 64) * 1000]


def test_first_time_is_wrong(tmp_path: Path) -> None:
    found = read(write(tmp_path, both(1000 | 1 << 32), both(1064), both(1128)))
    assert [row[0] for row in rows(found)] == [1_064_000, 1_128_000]
    assert any("1 high time(s)" in note for note in found.notes)
    assert any("1 event(s) before the first time" in note for note in found.notes)


def test_clock_set_back(tmp_path: Path) -> None:
    words = [both(5_000_000 + 640 * k) for k in range(2000)] + [both(640 * k) for k in range(2000)]
    found = read(write(tmp_path, *words))
    assert [jump.back_ns for jump in found.clock_jumps] == [1000 * (5_000_000 + 640 * 1999)]
    assert found.events.size == 4000


@given(st.lists(st.integers(0, 2**32 - 1), max_size=200), st.integers(1, 50))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_pieces_do_not_matter(words: list[int], length: int) -> None:
    data = np.array(words, dtype=np.uint32)
    # Mostly words that mean something, with times near each other and far from each other.
    data = np.where(data % 3 == 0, 8 << 28 | data % 50 << (data >> 20) % 24, data).astype(np.uint32)
    whole, cut = Evt2Decoder(), Evt2Decoder()
    wanted = whole.feed(data, last=True)
    pieces = [cut.feed(data[start : start + length]) for start in range(0, data.size, length)]
    pieces.append(cut.feed(data[:0], last=True))
    found = np.concatenate(pieces)
    for name in ("t_ns", "x", "y", "p"):
        np.testing.assert_array_equal(found[name], wanted[name])
    assert cut.notes("x") == whole.notes("x")


def test_search_for_a_high_time_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A doubtful high time is believed after a while: what waits stays bounded."""
    decoder = Evt2Decoder()
    words = np.frombuffer(both(1000) + high(2**33) + event(0) * (high_time.SEARCH_WORDS + 5), "<u4")
    assert decoder.feed(words[:1000]).size == 1
    assert decoder.feed(words[1000:]).size == high_time.SEARCH_WORDS + 5


@pytest.mark.slow
def test_evt3(tmp_path: Path) -> None:
    """The words of the documentation's own kind: row, vector, time."""
    time_high, time_low, row, column = 8 << 12 | 1, 6 << 12 | 5, 7, 2 << 12 | 1 << 11 | 9
    words = struct.pack("<5H", time_high, time_low, row, column, 0x7077)
    header = b"% evt 3.0\n% format EVT3;height=720;width=1280\n% geometry 1280x720\n% end\n"
    assert rows(read(write(tmp_path, words, header=header))) == [((4096 + 5) * 1000, 9, 7, 1)]


def test_blocks_do_not_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = [both(1000 + 70 * k) for k in range(100)]
    wanted = rows(read(write(tmp_path, *words)))
    for size in (1, 7, 64):
        monkeypatch.setattr(prophesee, "CHUNK_BYTES", size)
        assert rows(read(write(tmp_path, *words))) == wanted
        found = read(write(tmp_path, b"\x0c\x08", *(record(70 * k) for k in range(100)), header=DAT))
        assert [row[0] for row in rows(found)] == [70_000 * k for k in range(100)]
