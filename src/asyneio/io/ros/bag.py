# SPDX-License-Identifier: Apache-2.0
"""The interface of containers of ROS messages: topics, and messages from front to back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Protocol

from asyneio.io.parsing.unpack import MAX_UNPACKED, CutError


@dataclass(frozen=True)
class Topic:
    """A topic: name, message type, message definition (empty: not in the bag), and whether messages are
    encoded as in ROS 2 (CDR)."""

    name: str
    type: str
    definition: str
    cdr: bool


@dataclass(frozen=True)
class Message:
    """A message as stored in the bag, and its recording time [ns]."""

    topic: Topic
    logged_ns: int
    data: bytes | memoryview


class DamageLog:
    """Collects damage found in a container, as messages added to `notes`."""

    def __init__(self, name: str, notes: list[str]) -> None:
        self._name, self._notes = name, notes
        self._records = 0
        self._first = ""

    def record(self, at: int, error: CutError) -> None:
        """A record is damaged, but the next one can be found."""
        self._records += 1
        self._first = self._first or f"the first at byte {at}: {error}"

    def cut(self, at: int, size: int, count: int, error: CutError) -> None:
        """Nothing can be read from byte `at` on, after `count` messages."""
        self._notes.append(
            f"{self._name} is damaged or truncated at byte {at} of {size} ({error}): read up to there, "
            f"{count} message(s)"
        )

    def end(self) -> None:
        """The end of the container."""
        if self._records:
            self._notes.append(
                f"{self._name}: {self._records} damaged record(s), {self._first}; their content from "
                "there on is lost"
            )


class Bag(Protocol):
    """A container of messages that can be read repeatedly from front to back."""

    @property
    def path(self) -> Path:
        """The file, or the first of several."""

    @property
    def identity(self) -> str:
        """Distinguishes recordings with the same `path`; empty for a single file."""

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """All messages, with the fraction read; messages on damage are added to `notes`.

        Raises:
            RecordingError: unreadable, or damaged before the first message.
        """

    def topics(self) -> list[Topic]:
        """The topics found so far, or all if the container lists them; complete after `messages`."""


def read_content(stream: IO[bytes], length: int, size: int, needed: bool) -> tuple[bytes, int]:
    """The content of a record (empty unless needed), and the number of bytes missing in a file of `size`.

    Raises:
        CutError: implausible length.
    """
    left = size - stream.tell()
    if not needed:
        stream.seek(min(length, left), 1)
        return b"", max(length - left, 0)
    if length > MAX_UNPACKED:
        raise CutError(f"a record of {length} bytes")
    return stream.read(min(length, left)), max(length - left, 0)
