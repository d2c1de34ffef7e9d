"""A file packed with gzip, read where it is: nothing is unpacked to disk."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from asyneio.errors import RecordingError

MAGIC = b"\x1f\x8b"


@dataclass(frozen=True)
class GzipFile:
    """What is packed in a file."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    @property
    def name(self) -> str:
        """The file's name."""
        return self.path.name

    def is_file(self) -> bool:
        """True where it is there."""
        return self.path.is_file()

    def open(self) -> IO[bytes]:
        """Open for reading what is packed."""
        return cast(IO[bytes], gzip.open(self.path, "rb"))

    def size(self) -> int:
        """About how many bytes are packed: the end of the file tells it, modulo 4 GiB."""
        packed = self.path.stat().st_size
        with self.path.open("rb") as stream:
            stream.seek(max(packed - 4, 0))
            told = int.from_bytes(stream.read(4), "little")
        return max(told, packed)

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        """All of it. Raises RecordingError: damaged."""
        try:
            with self.open() as stream:
                return stream.read().decode(encoding or "utf-8", errors or "strict")
        except (zlib.error, EOFError) as error:
            raise RecordingError(f"{self.path} is damaged: {error}; get the file again") from error


def unpacked_head(head: bytes, size: int) -> bytes:
    """The first `size` bytes of what is packed in a file that begins with `head`; b"" where it is damaged."""
    try:
        return zlib.decompressobj(wbits=31).decompress(head, size)
    except zlib.error:
        return b""
