"""Prophesee's DAT."""

from __future__ import annotations

from pathlib import Path

from tests.io.prophesee.files import DAT, read, record, rows, write


def test_dat(tmp_path: Path) -> None:
    turn = 2**32
    times = [turn - 5, turn - 1, turn, turn + 7]
    for kind in (b"\x0c\x08", b"\x00\x08"):
        words = [record(t, 639 - k, 479 - k, k % 2) for k, t in enumerate(times)]
        found = read(write(tmp_path, kind, *words, b"\1\2", header=DAT))
        assert (found.width, found.height) == (640, 480)
        assert rows(found) == [(1000 * t, 639 - k, 479 - k, k % 2) for k, t in enumerate(times)]
        assert any("2 byte(s) at the end are not a complete event" in note for note in found.notes)
