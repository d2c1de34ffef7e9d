# SPDX-License-Identifier: Apache-2.0
"""A lock on a folder of results: two runs must not write into it at once."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from asyneio.errors import RecordingError

try:
    import fcntl
except ImportError:  # not on this platform: folders are not locked
    fcntl = None  # type: ignore[assignment]

LOCK_FILE = ".asyneio.lock"


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which exists, inside the block.

    The operating system releases the lock of a process that ends in any way, so that a lock file which a
    killed run left behind does not lock the folder. The file contains the process id, for the message. A file
    system without locks does not lock.

    Raises:
        RecordingError: another process holds the lock, or the lock file cannot be written.
    """
    if fcntl is None:
        yield
        return
    path = folder / LOCK_FILE
    handle = _locked(path)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _locked(path: Path) -> int:
    """Handle of the lock file, which this process has locked."""
    try:
        while True:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            if not _lock(handle):
                owner = os.pread(handle, 20, 0).decode(errors="replace").strip()
                os.close(handle)
                raise RecordingError(
                    f"another run (process {owner or 'unknown'}) is writing into {path.parent}; wait until "
                    "it ends, or choose another folder with --output"
                )
            # The previous owner may have removed the file between opening and locking: then it locks nothing.
            if _is_open(path, handle):
                os.ftruncate(handle, 0)
                os.write(handle, f"{os.getpid()}\n".encode())
                return handle
            os.close(handle)
    except OSError as error:
        raise RecordingError(
            f"cannot write {path}: {error.strerror or error}; check the folder's permissions and free space"
        ) from error


def _lock(handle: int) -> bool:
    """Lock an open file; False if another process has locked it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _is_open(path: Path, handle: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(handle))
    except FileNotFoundError:
        return False
