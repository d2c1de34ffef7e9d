"""What every container of ROS messages offers: its topics, and its messages from front to back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Protocol

from asyneio.io.parsing.unpack import MAX_UNPACKED, CutError


@dataclass(frozen=True)
class Topic:
    """A topic: its name, the type of its messages, their definition (empty: not in the bag), and whether
    they are encoded as in ROS 2."""

    name: str
    type: str
    definition: str
    cdr: bool


@dataclass(frozen=True)
class Message:
    """A message as it stands in the bag, and when it was recorded [ns]."""

    topic: Topic
    logged_ns: int
    data: bytes | memoryview


class Damage:
    """What a container met that is damaged, as sentences added to `notes`."""

    def __init__(self, name: str, notes: list[str]) -> None:
        self._name, self._notes = name, notes
        self._records = 0
        self._first = ""

    def record(self, at: int, error: CutError) -> None:
        """A record is damaged, but what follows it can be found."""
        self._records += 1
        self._first = self._first or f"the first at byte {at}: {error}"

    def cut(self, at: int, size: int, count: int, error: CutError) -> None:
        """Nothing can be read from byte `at` on, after so many messages."""
        self._notes.append(
            f"{self._name} is damaged or cut off at byte {at} of {size} ({error}): read up to there, "
            f"{count} message(s)"
        )

    def end(self) -> None:
        """No more is read."""
        if self._records:
            self._notes.append(
                f"{self._name}: {self._records} damaged record(s), {self._first}; what stood in them from "
                "there on is missing"
            )


class Bag(Protocol):
    """A container of messages that is read from front to back, as often as wanted."""

    @property
    def path(self) -> Path:
        """The file, or the first of several."""

    @property
    def identity(self) -> str:
        """Tells apart recordings that share `path`: empty for one file."""

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """All messages, with the fraction read; sentences on what is damaged are added to `notes`.

        Raises:
            RecordingError: unreadable, or damaged before the first message.
        """

    def topics(self) -> list[Topic]:
        """The topics met so far, or all of them where the container lists them; complete after `messages`."""


def take(stream: IO[bytes], length: int, size: int, wanted: bool) -> tuple[bytes, int]:
    """The content of a record, or none where it is not wanted, and how much of it a file of `size` lacks.

    Raises:
        CutError: the record is longer than any is.
    """
    left = size - stream.tell()
    if not wanted:
        stream.seek(min(length, left), 1)
        return b"", max(length - left, 0)
    if length > MAX_UNPACKED:
        raise CutError(f"a record of {length} bytes")
    return stream.read(min(length, left)), max(length - left, 0)
