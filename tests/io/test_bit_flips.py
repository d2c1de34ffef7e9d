"""Files of every format with one to twenty bits inverted: a valid recording, or an error with a message.

Events are inside the sensor and in order; time and memory are bounded.
"""

from __future__ import annotations

import time
import tracemalloc
from pathlib import Path

import pytest

from asyneio.io import open_recording
from tests.io.damage import damaged_copies, intact_file, with_flipped_bits
from tests.io.small_files import FILES
from tests.io.validity import assert_valid, valid_or_rejected

_COUNT = 8
_LIMIT_S = 20.0
#: Decoders have buffers of a few MiB; the files have at most two.
_LIMIT_BYTES = 256 * 2**20


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_flipped_bits(tmp_path: Path, kind: str) -> None:
    intact = intact_file(kind, tmp_path)
    (tmp_path / "flipped").mkdir()
    path = tmp_path / "flipped" / "recording"
    tracemalloc.start()
    try:
        for data in damaged_copies(kind, intact, _COUNT, with_flipped_bits):
            path.write_bytes(data)
            start = time.monotonic()
            valid_or_rejected(lambda: open_recording(path), assert_valid)
            assert time.monotonic() - start < _LIMIT_S
        assert tracemalloc.get_traced_memory()[1] < _LIMIT_BYTES
    finally:
        tracemalloc.stop()
