# SPDX-License-Identifier: Apache-2.0
"""Atomic writes: a file is written under a temporary name and then renamed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from asyneio.errors import RecordingError

#: Suffix of an output that is being written.
PART_SUFFIX = ".part"
#: Suffix of the temporary files of this module, so that those of a killed process are recognized.
_TEMPORARY_SUFFIX = ".tmp"


@contextmanager
def atomic_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a temporary file next to `path` for writing. It replaces `path` on success, and is removed on
    failure.

    Parent directories are created.

    Raises:
        RecordingError: the file cannot be written (permissions, disk full, `path` is a directory).
    """
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        yield stream
        stream.flush()


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Like `atomic_file`, for libraries that open files themselves: the path of an empty temporary file."""
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=_TEMPORARY_SUFFIX)
        temporary = Path(name)
        try:
            yield temporary
            os.fsync(handle)
        finally:
            os.close(handle)
        # mkstemp creates private files; the result follows the umask of the user.
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
        temporary = None
    except OSError as error:
        raise RecordingError(
            f"cannot write {path}: {error.strerror or error}; check the folder's permissions and free space"
        ) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Create a folder and check that it is writable, before a long run starts.

    Raises:
        RecordingError: it cannot be created or written to, or is a file.
    """
    if path.exists() and not path.is_dir():
        raise RecordingError(f"{path} is a file; expected a folder for the results: choose another one")
    probe = path / ".writable"
    write_text(probe, "")
    probe.unlink()


def remove_temporary(folder: Path) -> None:
    """Remove the temporary files that writers in a folder left behind when their process was killed."""
    for path in folder.glob(f".*.????????{_TEMPORARY_SUFFIX}"):
        path.unlink(missing_ok=True)


def remove_empty(folder: Path) -> None:
    """Remove a folder if it is empty."""
    with suppress(OSError):
        folder.rmdir()


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8, complete or not at all. Raises RecordingError like `atomic_file`.

    File names in it that are not valid text (bytes in another encoding) are escaped.
    """
    with atomic_file(path) as stream:
        stream.write(text.encode("utf-8", errors="backslashreplace"))


def _umask() -> int:
    """The umask of the process, which can only be read by setting it."""
    current = os.umask(0)
    os.umask(current)
    return current
