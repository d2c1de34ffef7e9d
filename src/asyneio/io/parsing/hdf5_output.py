# SPDX-License-Identifier: Apache-2.0
"""HDF5 output to a file that can always be closed, even if the disk is full.

HDF5 retries failed writes when the file is closed and again at exit, where the process then crashes.
Therefore writing goes through a Python file object that stores the first error, discards everything after it,
and never reports an error to HDF5.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py


class _FailSafeFile(io.RawIOBase):
    """A file for reading and writing that stores its first error in `failure` instead of raising it."""

    def __init__(self, path: Path) -> None:
        self._stream = path.open("w+b", buffering=0)
        self.failure: OSError | None = None

    def readable(self) -> bool:
        """True: HDF5 reads back what it wrote."""
        return True

    def writable(self) -> bool:
        """True."""
        return True

    def seekable(self) -> bool:
        """True."""
        return True

    def tell(self) -> int:
        """The position [bytes]."""
        return self._stream.tell()

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a position [bytes]."""
        return self._stream.seek(offset, whence)

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer; what was discarded after a failure reads as zeros."""
        view = memoryview(buffer).cast("B")
        count = self._stream.readinto(view) or 0
        # Discarded bytes read as zeros.
        view[count:] = bytes(len(view) - count)
        return len(view)

    def write(self, data: Any) -> int:
        """Write all bytes, or keep the failure and discard them: an exception inside HDF5 would crash it."""
        view = memoryview(data).cast("B")
        done = 0
        while self.failure is None and done < len(view):
            try:
                done += self._stream.write(view[done:]) or 0
            except OSError as error:
                self.failure = error
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the size [bytes]; a failure is kept."""
        if self.failure is None:
            try:
                return self._stream.truncate(size)
            except OSError as error:
                self.failure = error
        return size or 0

    def close(self) -> None:
        """Close the file."""
        self._stream.close()
        super().close()


@contextmanager
def new_hdf5(path: Path) -> Iterator[h5py.File]:
    """Create an HDF5 file.

    Raises:
        OSError: the file cannot be written; an incomplete file remains.
    """
    with _FailSafeFile(path) as stream:
        with h5py.File(stream, "w") as file:
            yield file
        if stream.failure is not None:
            raise stream.failure
