# SPDX-License-Identifier: Apache-2.0
"""Files that grow during a live run: complete rows, and states that become `estimates.npz`."""

from __future__ import annotations

import io
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from asyneio.io.parsing.atomic import atomic_file
from asyneio.state import DOF
from asyneio.types import STATE_BLOCKS, Estimate

#: One estimate; the fields are those of `Estimate`.
_STATE_DTYPE = np.dtype(
    [
        ("t_ns", "<i8"),
        ("segment", "<i8"),
        ("T_w_b", "<f8", (4, 4)),
        ("velocity_w", "<f8", (3,)),
        ("angular_velocity_b", "<f8", (3,)),
        ("generalized_acceleration", "<f8", (6,)),
        ("bias_gyroscope", "<f8", (3,)),
        ("bias_accelerometer", "<f8", (3,)),
        ("covariance", "<f8", (DOF, DOF)),
    ]
)


class RowFile:
    """A file of complete rows: a row that does not fit is removed again.

    Attributes:
        size: of the file [bytes].

    Args:
        path: created, or replaced.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self.size = 0

    def add(self, row: bytes) -> None:
        """Append one row or several. Raises OSError: the disk is full, and nothing is appended."""
        view = memoryview(row)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError:
            with suppress(OSError):
                self._file.truncate(self.size)
            raise
        self.size += len(row)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def state_row(estimate: Estimate) -> bytes:
    """An estimate as a row of the file of states."""
    row = np.zeros(1, dtype=_STATE_DTYPE)
    for name in _STATE_DTYPE.names or ():
        row[0][name] = getattr(estimate, name)
    return row.tobytes()


def write_estimates(path: Path, rows: Path) -> None:
    """Write `estimates.npz` from a file of states, which may be larger than memory.

    Raises:
        RecordingError: the file cannot be written.
    """
    states = np.memmap(rows, dtype=_STATE_DTYPE, mode="r")
    with atomic_file(path) as stream, zipfile.ZipFile(stream, "w", allowZip64=True) as archive:
        for name in states.dtype.names or ():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, states[name], allow_pickle=False)
        blocks = io.BytesIO()
        np.lib.format.write_array(blocks, np.array(STATE_BLOCKS), allow_pickle=False)
        archive.writestr("state_blocks.npy", blocks.getvalue())
