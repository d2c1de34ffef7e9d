"""EVT 2.1 in both word orders, and padding in EVT 3.0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from tests.io.event_columns import SIZE, assert_events, read


def evt21(events: np.ndarray, legacy: bool, endianness: str) -> bytes:
    """A RAW file: one pixel a word but for the first, which has the last bit of its mask set as well."""
    words, high = [], -1
    for t, x, y, p in events.tolist():
        if t >> 6 != high:
            high = t >> 6
            words.append(8 << 60 | high << 32)
        words.append(p << 60 | (t & 63) << 54 | (x // 32 * 32) << 43 | y << 32 | 1 << x % 32)
    data = np.array(words, dtype=np.uint64)
    if legacy:
        data = (data >> np.uint64(32)) | (data << np.uint64(32))
    header = f"% evt 2.1\n% format EVT21;height=180;width=240{endianness}\n% end\n"
    return header.encode() + data.astype("<u8").tobytes()


@pytest.mark.parametrize(
    ("legacy", "endianness"),
    [(False, ""), (False, ";endianness=little"), (True, ""), (True, ";endianness=legacy")],
)
def test_evt21_in_both_word_orders(tmp_path: Path, events: np.ndarray, legacy: bool, endianness: str) -> None:
    (tmp_path / "rec.raw").write_bytes(evt21(events, legacy, endianness))
    found = read(tmp_path)
    assert (found.width, found.height) == SIZE
    assert_events(found.events, events)


def test_words_that_are_no_evt21_are_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    garbage = rng.integers(0, 2**62, 5000).astype("<u8").tobytes()
    (tmp_path / "rec.raw").write_bytes(b"% evt 2.1\n% geometry 240x180\n% end\n" + garbage)
    with pytest.raises(RecordingError, match=r"rec.raw: \d+ of 5000 words are of a type unknown in EVT 2.1"):
        open_recording(tmp_path)


def test_padding_of_a_lucid_camera_is_counted(tmp_path: Path) -> None:
    words = [0x8000, 0x6000, 0x0005, 0x2807, 0x9999, 0x6010, 0x2808, 0x9999, 0xB123]
    header = b"% evt 3.0\n% geometry 240x180\n% end\n"
    (tmp_path / "rec.raw").write_bytes(header + np.array(words, "<u2").tobytes())
    found = read(tmp_path)
    assert found.events["x"].tolist() == [7, 8]
    notes = " ".join(found.notes)
    assert "skipped 2 word(s) of padding (code 9) (22% of the words)" in notes
    assert "skipped 1 word(s) of unknown type (11% of the words): is the file damaged?" in notes
