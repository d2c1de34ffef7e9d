"""Files that are either complete or absent: written under a temporary name, then renamed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from asyneio.errors import RecordingError

#: A file that is being written beside its place.
PART_SUFFIX = ".part"


@contextmanager
def atomic_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a temporary neighbour of `path` for writing; it replaces `path` on success, else vanishes.

    Parent directories are made.

    Raises:
        RecordingError: the file cannot be written (permissions, disk full, a directory in its place).
    """
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        yield stream
        stream.flush()


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """As `atomic_file`, for libraries that open files themselves: the path of an empty temporary file."""
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        temporary = Path(name)
        try:
            yield temporary
            os.fsync(handle)
        finally:
            os.close(handle)
        # mkstemp files are private; a result is an ordinary file and follows the user's umask.
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
    """Make a folder that can be written to, so that a long run does not end in a failure to save.

    Raises:
        RecordingError: it cannot be made or written to, or is a file.
    """
    if path.exists() and not path.is_dir():
        raise RecordingError(f"{path} is a file; expected a folder for the results: name another one")
    probe = path / ".writable"
    write_text(probe, "")
    probe.unlink()


def remove_empty(folder: Path) -> None:
    """Remove a folder that was made for results which did not come; one with anything in it stays."""
    with suppress(OSError):
        folder.rmdir()


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8, whole or not at all. Raises RecordingError as `atomic_file` does.

    A name of a file that is no text (bytes of another encoding) is written with escapes.
    """
    with atomic_file(path) as stream:
        stream.write(text.encode("utf-8", errors="backslashreplace"))


def _umask() -> int:
    """The umask of the process; it can only be read by setting it."""
    current = os.umask(0)
    os.umask(current)
    return current
