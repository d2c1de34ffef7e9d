# SPDX-License-Identifier: Apache-2.0
"""A file compressed with gzip, read without unpacking to disk."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from asyneio.errors import RecordingError
from asyneio.io.parsing.zip_member import MAX_RATIO

MAGIC = b"\x1f\x8b"

#: Below this size a large ratio does no harm.
_FREE_BYTES = 2**20


@dataclass(frozen=True)
class GzipFile:
    """The content of a compressed file."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    @property
    def name(self) -> str:
        """The file's name."""
        return self.path.name

    def is_file(self) -> bool:
        """True if the file exists."""
        return self.path.is_file()

    def open(self) -> IO[bytes]:
        """Open the uncompressed content for reading."""
        return cast(IO[bytes], gzip.open(self.path, "rb"))

    def size(self) -> int:
        """Approximate uncompressed size [bytes]; the end of the file stores it modulo 4 GiB."""
        packed = self.path.stat().st_size
        with self.path.open("rb") as stream:
            stream.seek(max(packed - 4, 0))
            stored = int.from_bytes(stream.read(4), "little")
        return max(stored, packed)

    def check_ratio(self, unpacked: int) -> None:
        """Raises RecordingError: `unpacked` bytes are implausible for the size of the file."""
        packed = self.path.stat().st_size
        if unpacked > MAX_RATIO * packed + _FREE_BYTES:
            raise RecordingError(
                f"{self.path} has {packed} bytes and unpacks to {unpacked} or more, a ratio above "
                f"{MAX_RATIO}: rejected"
            )

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        """The whole content as text. Raises RecordingError: damaged."""
        try:
            with self.open() as stream:
                return stream.read().decode(encoding or "utf-8", errors or "strict")
        except (zlib.error, EOFError) as error:
            raise RecordingError(f"{self.path} is damaged: {error}; download the file again") from error


def unpacked_head(head: bytes, size: int) -> bytes:
    """The first `size` uncompressed bytes of a file that begins with `head`; b"" if damaged."""
    try:
        return zlib.decompressobj(wbits=31).decompress(head, size)
    except zlib.error:
        return b""
