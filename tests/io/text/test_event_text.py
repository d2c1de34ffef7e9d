"""Events as text: exact times, tolerant of a few bad lines, never anything but our own errors."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import AsyneioError, RecordingError
from asyneio.io.recording.event_source import FAR_OUTSIDE, join_events
from asyneio.io.text import reader as event_text
from asyneio.io.text.reader import TextEvents
from asyneio.types import RecordArray


def parse(path: Path, text: bytes | str) -> tuple[RecordArray, tuple[str, ...]]:
    file = path / "events.txt"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    source = TextEvents(file)
    return join_events([np.empty(0, dtype=event_text.EVENT_DTYPE), *(e for e, _ in source.chunks())]), (
        source.notes()
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("text")


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(0, 4 * 10**18), st.integers(0, 400), st.booleans()), max_size=30))
def test_times_are_exact(folder: Path, rows: list[tuple[int, int, bool]]) -> None:
    text = "".join(f"{t // 10**9}.{t % 10**9:09d} {x} 7 {p:d}\n" for t, x, p in rows)
    events, notes = parse(folder, text)
    assert events["t_ns"].tolist() == [row[0] for row in rows]
    assert events["x"].tolist() == [row[1] for row in rows]
    assert events["p"].tolist() == [row[2] for row in rows]
    assert notes == ()


@pytest.mark.parametrize(
    ("line", "event"),
    [
        ("1.5 2 3 1", (1_500_000_000, 2, 3, 1)),
        ("1468940293.123456789 239 179 0", (1468940293123456789, 239, 179, 0)),
        ("0 0 0 0", (0, 0, 0, 0)),
        ("7. 1 2 1", (7_000_000_000, 1, 2, 1)),
        (".25 1 2 1", (250_000_000, 1, 2, 1)),
        ("1.5\t2\t3\t1\r", (1_500_000_000, 2, 3, 1)),
        ("1.5,2,3,1", (1_500_000_000, 2, 3, 1)),
        ("  1.5   2  3 1  ", (1_500_000_000, 2, 3, 1)),
        ("-0.000000001 2 3 1", (-1, 2, 3, 1)),
        ("1.5 2 3 -1", (1_500_000_000, 2, 3, 0)),
        ("1.5 2 3 True", (1_500_000_000, 2, 3, 1)),
        ("1.5 2 3 false", (1_500_000_000, 2, 3, 0)),
        ("1.5e+00 2.0e+00 3.00e+00 1.00e+00", (1_500_000_000, 2, 3, 1)),
        ("0.1234567891 2 3 1", (123_456_789, 2, 3, 1)),
        ("1.5 -2 3 1", (1_500_000_000, FAR_OUTSIDE, 3, 1)),
        ("1.5 70000 3 1", (1_500_000_000, FAR_OUTSIDE, 3, 1)),
        ("1.5 99999999999999999999 3 1", (1_500_000_000, FAR_OUTSIDE, 3, 1)),
        ("1.5 2 3 1 # remark", (1_500_000_000, 2, 3, 1)),
    ],
)
def test_lines(tmp_path: Path, line: str, event: tuple[int, int, int, int]) -> None:
    for text in (line, line + "\n", "# head\n\n" + line + "\n"):
        events, _ = parse(tmp_path, text)
        assert [tuple(row) for row in events.tolist()] == [event]


@pytest.mark.parametrize(
    "line",
    ["1.5 2 3", "1.5 2 3 2", "1.5 2 3 1 4", "nan 2 3 1", "1.5 2.5 3 1", "1.5 inf 3 1", "x y z p", "\0\0",
     "9999999999.0 2 3 1", "1.5 2 3 10", "1.5.1 2 3 1", "1.5 2 3 --1", "1" * 500, "1e99999999 2 3 1"],
)  # fmt: skip
def test_bad_line_is_skipped_and_named(tmp_path: Path, line: str) -> None:
    events, notes = parse(tmp_path, f"1.0 2 3 1\n# x\n{line}\n2.0 2 3 1\n")
    assert events["t_ns"].tolist() == [1_000_000_000, 2_000_000_000]
    assert notes == ("events.txt: skipped 1 unreadable line(s), number 3 (25% of the lines)",)


def test_too_many_bad_lines(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"more than 20 unreadable lines, the last at 22: 'no'"):
        parse(tmp_path, "1.0 2 3 1\n" + "no\n" * 30)


def test_cut_off_in_the_last_line(tmp_path: Path) -> None:
    events, notes = parse(tmp_path, "1.0 2 3 1\n1.5 2")
    assert events.size == 1
    assert "ends inside line 2" in notes[-1]


def test_three_polarities(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="-1, 0 and 1"):
        parse(tmp_path, "1.0 2 3 1\n1.5 2 3 0\n1.5 2 3 -1\n")


def test_pieces_of_the_file_do_not_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "".join(f"{k}.{k:09d} {k % 240} {k % 180} {k % 2}\n" for k in range(200)) + "bad\n" + "9.5 1 1 1"
    whole = parse(tmp_path, text)
    for size in (64, 65, 100, 1000):
        monkeypatch.setattr(event_text, "CHUNK_BYTES", size)
        pieces = parse(tmp_path, text)
        np.testing.assert_array_equal(pieces[0], whole[0])
        assert pieces[1] == whole[1]


@given(
    st.lists(st.sampled_from(["1.5", "2", "-", "1e9", ".", " ", "\n", "\r", "\t", ",", "#", "0", "\0", "é"]))
)
def test_agrees_with_decimal(folder: Path, tokens: list[str]) -> None:
    """What comes out of any mixture is what exact arithmetic makes of its lines."""
    text = "".join(tokens)
    try:
        events, _ = parse(folder, text)
    except AsyneioError:
        return
    lines = [line.split("#")[0].replace(",", " ").split() for line in text.split("\n")]
    times = []
    for line in lines:
        if len(line) == 4 and line[3] in ("0", "-1", "1", "1.0"):
            try:
                values = [Decimal(token) for token in line]
            except ArithmeticError:
                continue
            if all(value == int(value) for value in values[1:3]) and abs(values[0]) < 2**62 / 1e9:
                times.append(int((values[0] * 10**9).to_integral_value()))
    assert events["t_ns"].tolist() == times


def test_binary_without_line_feeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_text, "CHUNK_BYTES", 1000)
    with pytest.raises(RecordingError, match="not a text file"):
        parse(tmp_path, b"\1" * 5000)
