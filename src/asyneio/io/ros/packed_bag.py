# SPDX-License-Identifier: Apache-2.0
"""ROS 2 bags compressed with zstd, file by file or message by message.

`ros2 bag record --compression-mode file` compresses each complete file and adds `.zstd` to its name;
`--compression-mode message` compresses the data of each message. `metadata.yaml` contains the mode but may be
missing: both are recognised by the first four bytes of a zstd frame, with which no CDR message begins.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from backports import zstd

from asyneio.errors import RecordingError
from asyneio.io.parsing.unpack import MAX_UNPACKED, unpack
from asyneio.io.parsing.zip_member import MAX_RATIO
from asyneio.io.ros.bag import Bag, Message, Topic

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_PIECE = 2**20
#: Below this size a large ratio does no harm.
_FREE_BYTES = 2**20


class PackedMessages:
    """A Bag whose messages may be compressed individually."""

    def __init__(self, inner: Bag) -> None:
        self._inner = inner
        self.path, self.identity = inner.path, inner.identity

    def topics(self) -> list[Topic]:
        """See Bag."""
        return self._inner.topics()

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag."""
        for message, fraction in self._inner.messages(notes):
            if message.topic.cdr and message.data[:4] == ZSTD_MAGIC:
                data = unpack(message.data, "zstd", MAX_UNPACKED)
                yield Message(message.topic, message.logged_ns, data), fraction
            else:
                yield message, fraction


class PackedFile:
    """A Bag for a compressed file, which is decompressed to a temporary folder when it is first read.

    Args:
        path: the compressed file.
        open_bag: opens the decompressed file.
    """

    identity = ""

    def __init__(self, path: Path, open_bag: Callable[[Path], Bag]) -> None:
        self.path = path
        self._open = open_bag
        self._inner: Bag | None = None
        #: Deleted with this object.
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def topics(self) -> list[Topic]:
        """See Bag."""
        return self._inner.topics() if self._inner else []

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag. Raises RecordingError, also if there is no space for decompression."""
        if self._inner is None:
            self._inner = self._open(self._unpack(notes))
        yield from self._inner.messages(notes)

    def _unpack(self, notes: list[str]) -> Path:
        try:
            self._folder = tempfile.TemporaryDirectory(prefix="asyneio-")
            target = Path(self._folder.name) / unpacked_name(self.path)
            with zstd.open(self.path, "rb") as packed, target.open("wb") as stream:
                try:
                    # Pieces as they are available: everything before a truncation is kept.
                    while piece := packed.read1(_PIECE):
                        stream.write(piece)
                        self._check_ratio(stream.tell())
                except (EOFError, zstd.ZstdError) as error:
                    notes.append(f"{self.path.name} is damaged or truncated ({error}): read up to there")
        except OSError as error:
            raise RecordingError(
                f"cannot decompress {self.path} to {tempfile.gettempdir()}: {error.strerror or error}; "
                f"decompress it in its folder (zstd -d {self.path.name}) and run again, or set TMPDIR"
            ) from error
        return target

    def _check_ratio(self, unpacked: int) -> None:
        """Raises RecordingError: `unpacked` bytes are implausible for the size of the file."""
        packed = self.path.stat().st_size
        if unpacked > MAX_RATIO * packed + _FREE_BYTES:
            raise RecordingError(
                f"{self.path} has {packed} bytes and unpacks to {unpacked} or more, a ratio above "
                f"{MAX_RATIO}: rejected"
            )


def unpacked_name(path: Path) -> str:
    """The name of a compressed file without its compression suffix."""
    return path.name.removesuffix(".zstd").removesuffix(".zst")


def unpacked_head(path: Path, size: int) -> bytes:
    """The first decompressed bytes of a file; empty if it is not compressed with zstd, or damaged."""
    try:
        with zstd.open(path, "rb") as stream:
            return bytes(stream.read(size))
    except (OSError, EOFError, zstd.ZstdError):
        return b""
