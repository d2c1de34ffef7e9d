# SPDX-License-Identifier: Apache-2.0
"""Arrays of an untrusted `.npz` archive: no pickled objects, and no more bytes than the file can contain."""

from __future__ import annotations

import tokenize
import zipfile
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.zip_member import DAMAGE as ZIP_DAMAGE
from asyneio.io.parsing.zip_member import MAX_RATIO

#: Small archives may declare this much without a check of the ratio.
_FREE_BYTES = 2**24
#: What NumPy raises for damaged files, and for encrypted members (RuntimeError).
DAMAGE = (
    *ZIP_DAMAGE,
    ValueError,
    KeyError,
    TypeError,
    SyntaxError,
    tokenize.TokenError,
    RuntimeError,
    MemoryError,
)


def read_npz(path: Path, expected: str) -> dict[str, np.ndarray]:
    """Arrays by name, of any shape; members that are pickled or no arrays are left out.

    Args:
        path: the archive.
        expected: what it should contain, for messages.

    Raises:
        RecordingError: unreadable, damaged, or a decompression bomb.
    """
    try:
        return _arrays_of(path)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}; check the path") from error
    except DAMAGE as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordingError(f"{path} is not a readable .npz file: {reason}; expected {expected}") from error


def _arrays_of(path: Path) -> dict[str, np.ndarray]:
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        declared = sum(entry.file_size for entry in archive.infolist())
    if declared > MAX_RATIO * size + _FREE_BYTES:
        raise ValueError(f"its arrays declare {declared} bytes, but the file has {size}")
    arrays: dict[str, np.ndarray] = {}
    with np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            try:
                array = archive[name]
            except ValueError as error:
                if "pickle" in str(error):
                    continue
                raise
            # NumPy returns bytes for members that are not arrays.
            if isinstance(array, np.ndarray):
                arrays[name] = array
    return arrays
