# SPDX-License-Identifier: Apache-2.0
"""A recording in numbered files of one folder, as written by `rosbag record --split`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.ros.bag import Bag, Message
from asyneio.io.ros.rosbag1 import Rosbag1
from asyneio.io.ros.rosbag2 import METADATA_FILE, SplitBag, open_rosbag2_file
from asyneio.types import NS_PER_S

_SUFFIXES = (".bag", ".db3", ".mcap", ".zstd")
_NUMBERED = re.compile(r"^(.*?)(\d+)$")
#: Longest pause between parts [s]: a recorder opens the next file immediately, separate takes are further
#: apart.
_LONGEST_BREAK_S = 5.0
_LATE_S = 1.0


class JoinedBag(SplitBag):
    """A Bag for parts that must be consecutive in time."""

    def __init__(self, parts: list[Bag]) -> None:
        super().__init__(parts)
        self._names = [part.path.name for part in parts]

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag. Raises RecordingError: a part does not begin where the previous one ends."""
        latest_ns: int | None = None
        for number, part in enumerate(self._parts):
            fresh = True
            for message, fraction in part.messages(notes):
                if fresh and latest_ns is not None:
                    self._check(number, (message.logged_ns - latest_ns) / NS_PER_S)
                fresh = False
                latest_ns = max(message.logged_ns, latest_ns or message.logged_ns)
                yield message, (number + fraction) / len(self._parts)
        notes.append(f"{', '.join(self._names)} are consecutive and were read as one recording")

    def _check(self, number: int, break_s: float) -> None:
        if not -_LATE_S <= break_s <= _LONGEST_BREAK_S:
            raise RecordingError(
                f"{self.path.parent} contains {len(self._names)} recordings ({', '.join(self._names)}): "
                f"{self._names[number]} begins {break_s:+.1f} s after the end of "
                f"{self._names[number - 1]}; name one of them"
            )


def parts_in(folder: Path) -> list[Path]:
    """Two or more bags of one type whose names end in consecutive numbers; else an empty list."""
    if not folder.is_dir() or (folder / METADATA_FILE).is_file():
        return []
    files = [file for file in folder.iterdir() if file.suffix in _SUFFIXES and not file.name.startswith(".")]
    numbered: dict[int, Path] = {}
    series: set[tuple[str, str]] = set()
    for file in files:
        stem, _, ending = file.name.partition(".")
        match = _NUMBERED.match(stem)
        if match is None or not file.is_file():
            return []
        # A recorder may write the time into the name of each part.
        series.add((re.sub(r"\d+", "", match.group(1)), ending))
        numbered[int(match.group(2))] = file
    numbers = sorted(numbered)
    whole = len(series) == 1 and len(numbered) == len(files) > 1
    return [numbered[k] for k in numbers] if whole and numbers[-1] - numbers[0] == len(numbers) - 1 else []


def open_parts(folder: Path) -> Bag:
    """All parts as one bag. Raises RecordingError: one of them is not a bag."""
    parts = parts_in(folder)
    return JoinedBag([Rosbag1(part) if part.suffix == ".bag" else open_rosbag2_file(part) for part in parts])
