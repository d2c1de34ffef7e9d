"""Bags of ROS 2 that are packed with zstd: as whole files, or message by message.

`ros2 bag record --compression-mode file` packs each file when it is complete and adds `.zstd` to its name;
`--compression-mode message` packs the data of each message. `metadata.yaml` tells which, but may be lost:
both are recognised by the four bytes that a frame of zstd begins with, and no message in CDR does.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from backports import zstd

from asyneio.errors import RecordingError
from asyneio.io.parsing.unpack import MAX_UNPACKED, unpack
from asyneio.io.ros.bag import Bag, Message, Topic

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_PIECE = 2**20


class PackedMessages:
    """A Bag whose messages may be packed one by one."""

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
    """A Bag on a file that is packed as a whole: unpacked into a temporary folder when it is first read.

    Args:
        path: the packed file.
        open_bag: opens what it unpacks to.
    """

    identity = ""

    def __init__(self, path: Path, open_bag: Callable[[Path], Bag]) -> None:
        self.path = path
        self._open = open_bag
        self._inner: Bag | None = None
        #: Removed with this object.
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def topics(self) -> list[Topic]:
        """See Bag."""
        return self._inner.topics() if self._inner else []

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag. Raises RecordingError: also where there is no room to unpack."""
        if self._inner is None:
            self._inner = self._open(self._unpack(notes))
        yield from self._inner.messages(notes)

    def _unpack(self, notes: list[str]) -> Path:
        try:
            self._folder = tempfile.TemporaryDirectory(prefix="asyneio-")
            target = Path(self._folder.name) / unpacked_name(self.path)
            with zstd.open(self.path, "rb") as packed, target.open("wb") as stream:
                try:
                    # Pieces as they come: what stands before a cut is kept.
                    while piece := packed.read1(_PIECE):
                        stream.write(piece)
                except (EOFError, zstd.ZstdError) as error:
                    notes.append(f"{self.path.name} is damaged or cut off ({error}): read up to there")
        except OSError as error:
            raise RecordingError(
                f"cannot unpack {self.path} into {tempfile.gettempdir()}: {error.strerror or error}; "
                "unpack it "
                f"where there is room (zstd -d {self.path.name}) and give the same folder again, or set "
                "TMPDIR"
            ) from error
        return target


def unpacked_name(path: Path) -> str:
    """The name of a packed file without the ending that says so."""
    return path.name.removesuffix(".zstd").removesuffix(".zst")


def unpacked_head(path: Path, size: int) -> bytes:
    """The first bytes of what a file unpacks to; none where it is not packed with zstd, or damaged there."""
    try:
        with zstd.open(path, "rb") as stream:
            return bytes(stream.read(size))
    except (OSError, EOFError, zstd.ZstdError):
        return b""
