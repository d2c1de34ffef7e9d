"""Files in a zip archive, read where they are: nothing is unpacked to disk."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from asyneio.errors import RecordingError

MAGIC = b"PK\x03\x04"

#: Text of events packs to a fifth; what unpacks to more than this many times its size is hostile.
MAX_RATIO = 200
#: Files other than the events are read whole.
MAX_TEXT_BYTES = 2**30
#: What the zipfile module raises on damaged data.
DAMAGE = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, struct.error)

_ENCRYPTED = 1


@dataclass(frozen=True)
class ZipMember:
    """A file in an archive."""

    archive: Path
    member: str

    def __str__(self) -> str:
        return f"{self.archive}/{self.member}"

    @property
    def name(self) -> str:
        """Its name without folders."""
        return self.member.rsplit("/", 1)[-1]

    def size(self) -> int:
        """Its unpacked size as the archive says [bytes]. Raises RecordingError as `open`."""
        with open_zip(self.archive) as archive:
            return self._info(archive).file_size

    def open(self) -> IO[bytes]:
        """Open for reading.

        Raises:
            RecordingError: it is encrypted, packed in an unknown way, or unpacks to far too much.
        """
        archive = open_zip(self.archive)
        try:
            return archive.open(self._info(archive))
        except DAMAGE as error:
            raise RecordingError(f"{self} cannot be unpacked: {error}; unpack the archive first") from error
        finally:
            # The member keeps the file open until it is closed itself.
            archive.close()

    def is_file(self) -> bool:
        """True where the archive has it."""
        with open_zip(self.archive) as archive:
            return self.member in archive.namelist()

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        """Its text. Raises RecordingError: damaged, or as `open`."""
        try:
            with self.open() as stream:
                data = stream.read(MAX_TEXT_BYTES + 1)
        except DAMAGE as error:
            raise RecordingError(f"{self} is damaged: {error}; get the archive again") from error
        if len(data) > MAX_TEXT_BYTES:
            raise RecordingError(f"{self} is larger than {MAX_TEXT_BYTES // 2**20} MiB")
        return data.decode(encoding or "utf-8", errors or "strict")

    def _info(self, archive: zipfile.ZipFile) -> zipfile.ZipInfo:
        info = archive.getinfo(self.member)
        if info.flag_bits & _ENCRYPTED:
            raise RecordingError(f"{self} is encrypted; unpack the archive first")
        packed = min(info.compress_size, self.archive.stat().st_size)
        if info.file_size > MAX_RATIO * max(packed, 1):
            raise RecordingError(
                f"{self} claims to unpack from {packed} to {info.file_size} bytes, more than {MAX_RATIO} "
                "times as much; no recording does"
            )
        return info


def open_zip(path: Path) -> zipfile.ZipFile:
    """Open an archive. Raises RecordingError: unreadable, or cut off."""
    try:
        return zipfile.ZipFile(path)
    except (*DAMAGE, ValueError) as error:
        raise RecordingError(
            f"{path} is a damaged zip archive: {error}; was it cut off? Its list of files is at its end. Get "
            "the archive again"
        ) from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
