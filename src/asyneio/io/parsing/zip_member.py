# SPDX-License-Identifier: Apache-2.0
"""Files in a zip archive, read without unpacking to disk."""

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

#: Event text compresses five times; a larger ratio than this is hostile.
MAX_RATIO = 200
#: Files other than the events are read completely.
MAX_TEXT_BYTES = 2**30
#: Exceptions of the zipfile module for damaged data.
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
        """Its uncompressed size according to the archive [bytes]. Raises RecordingError like `open`."""
        with open_zip(self.archive) as archive:
            return self._info(archive).file_size

    def open(self) -> IO[bytes]:
        """Open for reading.

        Raises:
            RecordingError: encrypted, unknown compression, or implausibly large.
        """
        archive = open_zip(self.archive)
        try:
            return archive.open(self._info(archive))
        except DAMAGE as error:
            raise RecordingError(f"{self} cannot be unpacked: {error}; unpack the archive first") from error
        finally:
            # The member keeps the file open until the member is closed.
            archive.close()

    def is_file(self) -> bool:
        """True if the archive contains it."""
        with open_zip(self.archive) as archive:
            return self.member in archive.namelist()

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        """Its text. Raises RecordingError: damaged, or like `open`."""
        try:
            with self.open() as stream:
                data = stream.read(MAX_TEXT_BYTES + 1)
        except DAMAGE as error:
            raise RecordingError(f"{self} is damaged: {error}; download the archive again") from error
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
                f"{self} declares {info.file_size} bytes for {packed} compressed ones, a ratio above "
                f"{MAX_RATIO}: rejected"
            )
        return info


def open_zip(path: Path) -> zipfile.ZipFile:
    """Open an archive. Raises RecordingError: unreadable or truncated."""
    try:
        return zipfile.ZipFile(path)
    except (*DAMAGE, ValueError) as error:
        raise RecordingError(
            f"{path} is a damaged zip archive: {error}; truncated? The list of files is at its end. Download "
            "the archive again"
        ) from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
