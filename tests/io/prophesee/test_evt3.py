"""EVT3 words: clean ones against an independent decoder, damaged ones against the rules."""

from __future__ import annotations

import re

import evt3
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.io.prophesee.evt3 import HIGH_NS, WRAP_NS, Evt3Decoder

ROW, EVENT, BASE, TWELVE, EIGHT, LOW, HIGH, TRIGGER = 0, 2, 3, 4, 5, 6, 8, 10


def word(code: int, value: int, bit: int = 0) -> int:
    return code << 12 | bit << 11 | value


def decode(words: list[int], piece: int | None = None) -> tuple[np.ndarray, tuple[str, ...]]:
    """Events of words, given in pieces of that many, and notes."""
    decoder = Evt3Decoder()
    array = np.array(words, dtype=np.uint16)
    starts = range(0, max(array.size, 1), piece) if piece else [0]
    length = piece or array.size
    found = [decoder.feed(array[i : i + length], i + length >= array.size) for i in starts]
    return np.concatenate(found), decoder.notes("run")


def at(high: int, low: int = 0, x: int = 0, times: int = 2) -> list[int]:
    """So many high times, a low time and an event."""
    return [word(HIGH, high & 0xFFF)] * times + [word(LOW, low), word(EVENT, x, 1)]


def high_times(words: list[int], piece: int | None = None) -> list[float]:
    return (decode(words, piece)[0]["t_ns"] / HIGH_NS).tolist()


@pytest.mark.slow
@given(st.lists(st.sampled_from(["event", "row", "vector", "low", "high", "other"]), max_size=120), st.data())
def test_against_another_decoder(kinds: list[str], data: st.DataObject) -> None:
    """Every kind of word in any order, with a clock that behaves, cut anywhere."""
    high, words = data.draw(st.integers(0, 4095)), []
    words += [word(HIGH, high), word(LOW, 0), word(ROW, 1)]
    for kind in kinds:
        value = data.draw(st.integers(0, 0x7FF))
        if kind == "high":
            high = (high + value % 2) % 4096
            words += [word(HIGH, high), word(LOW, value)]
        elif kind == "vector":
            words += [word(BASE, value % 600, value % 2), word(TWELVE, data.draw(st.integers(0, 0xFFF)))]
            words += [word(TWELVE, value), word(EIGHT, value & 0xFF)]
        else:
            code = {"event": EVENT, "row": ROW, "low": LOW, "other": 14}[kind]
            words.append(word(code, value, 0 if kind in ("row", "low") else value & 1))
    found, _ = decode(words, data.draw(st.integers(1, 50)))
    wanted = evt3.decode_bytes(np.array(words, dtype="<u2").tobytes(), 2048, 2048)
    np.testing.assert_array_equal(found["t_ns"], wanted.t.astype(np.int64) * 1000)
    np.testing.assert_array_equal(found["x"], wanted.x)
    np.testing.assert_array_equal(found["y"], wanted.y)
    np.testing.assert_array_equal(found["p"], wanted.p)


@pytest.mark.parametrize("piece", [None, 1, 3])
def test_clock_turns_over(piece: int | None) -> None:
    words = at(4094) + at(4095) + at(0, 7) + at(1)
    found, notes = decode(words, piece)
    assert (found["t_ns"] - 4094 * HIGH_NS).tolist() == [0, HIGH_NS, 2 * HIGH_NS + 7000, 3 * HIGH_NS]
    assert notes == ()


@pytest.mark.parametrize("piece", [None, 1, 5])
@pytest.mark.parametrize("bit", range(12))
def test_wrong_bit_in_a_high_time(bit: int, piece: int | None) -> None:
    """One high time in a run of equal ones is wrong: the events after it are stamped as if it were right."""
    words = at(100) + at(100 ^ 1 << bit, 5, times=1) + at(100, 9) + at(101)
    found, notes = decode(words, piece)
    if bit == 0:
        # 101 goes on by one: nothing tells that it is wrong, until time steps back.
        assert (found["t_ns"] // HIGH_NS).tolist() == [100, 101, 100, 101]
    else:
        assert (found["t_ns"] - 100 * HIGH_NS).tolist() == [0, 5000, 9000, HIGH_NS]
        assert [re.sub(r" \(.*% of the words\)", "", note) for note in notes] == [
            "run: skipped 1 high time(s) that contradict their neighbours"
        ]


def test_wrong_bit_where_time_goes_on() -> None:
    words = at(100) + at(101 ^ 1 << 9, 5, times=1) + at(101, 9)
    assert (decode(words)[0]["t_ns"] - 101 * HIGH_NS).tolist() == [-HIGH_NS, 5000, 9000]


def test_wrong_first_high_time() -> None:
    words = at(100 ^ 1 << 11, times=1) + at(100, 3)
    found, notes = decode(words)
    assert found["t_ns"].tolist() == [100 * HIGH_NS + 3000]
    assert "1 high time(s)" in " ".join(notes)
    assert "1 event(s) before" in " ".join(notes)


def test_pauses_and_steps_back() -> None:
    """Words are missing for a second; later the high time steps back a little, and that is no turn."""
    assert high_times(at(100) + at(344) + at(345), 1) == [100, 344, 345]
    assert high_times(at(100) + at(97) + at(98) + at(101)) == [100, 97, 98, 101]
    assert high_times(at(100, times=1) + at(160, times=1) + at(260)) == [100, 160, 260]
    decoder = Evt3Decoder()
    first = decoder.feed(np.array(at(100), dtype=np.uint16))
    decoder.pass_time(3 * WRAP_NS + 50 * HIGH_NS)
    second = decoder.feed(np.array(at(145), dtype=np.uint16))
    assert second["t_ns"][0] - first["t_ns"][0] == 3 * WRAP_NS + 45 * HIGH_NS


def test_what_is_no_event() -> None:
    words = [word(EVENT, 1), word(TWELVE, 3), *at(5), word(TRIGGER, 1), word(1, 0), word(13, 0)]
    found, notes = decode(words)
    assert found.size == 1
    assert notes == (
        "run: skipped 1 external trigger(s) (11% of the words)",
        "run: skipped 3 event(s) before the first time (33% of the words)",
        "run: skipped 2 word(s) of unknown type (22% of the words): is the file damaged?",
    )


@given(st.lists(st.integers(0, 0xFFFF), max_size=300), st.integers(1, 40))
def test_any_words_in_any_pieces(words: list[int], piece: int) -> None:
    """Noise is decoded alike however it is cut, and nothing lies outside the arrays."""
    whole, notes = decode(words)
    found, other_notes = decode(words, piece)
    np.testing.assert_array_equal(found, whole)
    assert notes == other_notes
    assert (whole["t_ns"] >= 0).all()
    assert (whole["x"] < 0xFFF + 12).all()
    assert (whole["y"] < 2048).all()
