"""Headers of Prophesee's files, supported or not."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import RecordingError
from asyneio.io.prophesee.header import parse_header, size_of
from tests.io.prophesee.files import DAT, NEW, OLD, both, event, read, rows, write


@pytest.mark.parametrize(
    ("header", "size"),
    [
        (NEW, (1280, 720)),
        (OLD, (640, 480)),
        (b"% evt 2.0\n% format EVT2;width=346;height=260\n", (346, 260)),
        (b"% evt 2.0\n% plugin_name hal_plugin_imx636_evk4\n% end\n", (1280, 720)),
        (b"% evt 2.0\n% sensor_name GenX320\n% end\r\n", (320, 320)),
        (b"% evt 2.0\n", (240, 180)),
    ],
)
def test_headers(tmp_path: Path, header: bytes, size: tuple[int, int]) -> None:
    found = read(write(tmp_path, both(1000), event(1001, 3, 4, 0), header=header))
    assert rows(found) == [(1_000_000, 1, 2, 1), (1_001_000, 3, 4, 0)]
    assert (found.width, found.height) == size


def test_data_that_look_like_a_header(tmp_path: Path) -> None:
    """Without `% end` the first words may begin with the bytes of a header line."""
    first = struct.pack("<I", 0x80000000 | 0x2025)
    assert first.startswith(b"% ")
    found = read(write(tmp_path, first, event(5), header=b"% evt 2.0\n% geometry 640x480\n"))
    assert rows(found) == [((0x2025 << 6) * 1000 + 5000, 1, 2, 1)]


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"% format EVT4;height=720;width=1280\n% end\n", "EVT 4.0"),
        (b"% evt 4.0\n", "EVT 4.0"),
        (b"% format HISTO3D;height=320;width=320\n% end\n", "histograms"),
        (b"% format EVT9\n% end\n", "in EVT9, which is not supported"),
        (b"% date 2020\n% end\n", "header without an encoding"),
        (b"% Version 1\n% Height 240\n% Width 304\n", "DAT of version 1"),
        (DAT, "contains only a header"),
        (DAT + b"\x0e\x08", "type 0x0e with 8 bytes"),
        (DAT + b"\x0c\x10", "type 0x0c with 16 bytes"),
        (NEW, "contains no events"),
        (b"% ", "header without an encoding"),
    ],
)
def test_refused(tmp_path: Path, header: bytes, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        read(write(tmp_path, header=header))


def test_sizes_that_are_none() -> None:
    for fields in ({"geometry": "0x0"}, {"geometry": "x"}, {"width": "99999", "height": "1"}, {}):
        assert size_of(fields) == (None, ())


@pytest.mark.slow
@given(st.binary(max_size=300))
def test_any_header(data: bytes) -> None:
    header = parse_header(b"% " + data, Path("x"))
    assert 0 <= header.data_start <= len(data) + 2
    size_of(header.fields)
    assert isinstance(header.encoding, str)
