# SPDX-License-Identifier: Apache-2.0
"""ROS 2 recordings: SQLite or MCAP files, single or in a folder with `metadata.yaml`."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.calibration.yaml_json import load_mapping
from asyneio.io.ros.bag import Bag, Message, Topic
from asyneio.io.ros.mcap import MAGIC as MCAP_MAGIC
from asyneio.io.ros.mcap import McapFile
from asyneio.io.ros.packed_bag import ZSTD_MAGIC, PackedFile, PackedMessages, unpacked_head, unpacked_name

SQLITE_MAGIC = b"SQLite format 3\0"
METADATA_FILE = "metadata.yaml"

_INFORMATION = "rosbag2_bagfile_information"
_SUFFIXES = (".db3", ".mcap", ".zstd", ".zst")


class SqliteBag:
    """A Bag for one SQLite file."""

    identity = ""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._topics: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """See Bag: all topics."""
        return list(self._topics.values())

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag. Raises RecordingError: not a database of ROS messages, or damaged before the first."""
        count = 0
        # The log of a killed recorder is read as well; without a log, nothing is written to the folder.
        logs = [self.path.with_name(f"{self.path.name}{end}") for end in ("-wal", "-journal")]
        logged = any(log.is_file() for log in logs)
        uri = f"{self.path.resolve().as_uri()}?mode=ro" + ("" if logged else "&immutable=1")
        try:
            database = sqlite3.connect(uri, uri=True)
        except sqlite3.Error as error:
            raise RecordingError(f"cannot read {self.path}: {error}") from error
        try:
            database.execute("PRAGMA trusted_schema=OFF")
            self._read_topics(database)
            last = database.execute("SELECT max(id) FROM messages").fetchone()[0]
            rows = database.execute("SELECT id, topic_id, timestamp, data FROM messages ORDER BY id")
            for number, topic_id, logged_ns, data in rows:
                topic = self._topics.get(topic_id)
                if topic is None or not isinstance(data, bytes) or not isinstance(logged_ns, int):
                    continue
                count += 1
                yield Message(topic, logged_ns, data), _fraction(number, last)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            if count == 0:
                raise RecordingError(
                    f"{self.path} is not a readable SQLite file of ROS 2: {error}; if it is truncated, try "
                    f"sqlite3 {self.path.name} .recover | sqlite3 repaired.db3"
                ) from error
            notes.append(f"{self.path.name} is damaged ({error}): read up to there, {count} message(s)")
        finally:
            database.close()

    def _read_topics(self, database: sqlite3.Connection) -> None:
        definitions: dict[str, str] = {}
        if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
            definitions = {
                str(name): str(text)
                for name, encoding, text in database.execute(
                    "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
                )
                if encoding == "ros2msg"
            }
        for number, name, kind, encoding in database.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        ):
            if encoding == "cdr":
                self._topics[number] = Topic(str(name), str(kind), definitions.get(kind, ""), cdr=True)


def _fraction(number: object, last: object) -> float:
    """The fraction of the messages up to a row; a damaged table may number its rows with anything."""
    if isinstance(number, int) and isinstance(last, int) and last > 0:
        return min(max(number / last, 0.0), 1.0)
    return 0.0


class SplitBag:
    """A Bag for the consecutive files of one recording."""

    def __init__(self, parts: list[Bag]) -> None:
        self._parts = parts
        self.path = parts[0].path
        stamps = [f"{part.path}:{_size_and_time(part.path)}" for part in parts[1:]]
        self.identity = "|".join(stamps)

    def topics(self) -> list[Topic]:
        """See Bag."""
        return list(dict.fromkeys(topic for part in self._parts for topic in part.topics()))

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag."""
        for number, part in enumerate(self._parts):
            for message, fraction in part.messages(notes):
                yield message, (number + fraction) / len(self._parts)


def is_rosbag2_folder(path: Path) -> bool:
    """True for a folder whose `metadata.yaml` is that of a ROS 2 recording."""
    try:
        with (path / METADATA_FILE).open("rb") as stream:
            return _INFORMATION.encode() in stream.read(4096)
    except OSError:
        return False


def is_rosbag2_sqlite(head: bytes) -> bool:
    """True for the start of a database with a table of topics."""
    return head.startswith(SQLITE_MAGIC) and b"serialization_format" in head


def is_packed_rosbag2(path: Path, head: bytes) -> bool:
    """True for MCAP or SQLite compressed with zstd."""
    if not head.startswith(ZSTD_MAGIC):
        return False
    return unpacked_head(path, len(SQLITE_MAGIC)).startswith((MCAP_MAGIC, SQLITE_MAGIC))


def open_rosbag2(path: Path) -> Bag:
    """The bag in a file, or in the files of a folder that its `metadata.yaml` lists.

    If a listed compressed file also exists uncompressed, the latter is used.

    Raises:
        RecordingError: a listed file does not exist.
    """
    if path.is_file():
        return open_rosbag2_file(path)
    try:
        information = load_mapping(path / METADATA_FILE)[_INFORMATION]
        names = [Path(str(name)).name for name in information["relative_file_paths"]]
    except (KeyError, TypeError, AttributeError) as error:
        raise RecordingError(f"{path / METADATA_FILE} does not list the files of a recording") from error
    # Only the file name is used: a path outside the folder is not part of the recording.
    found = [_present(path / name) for name in names]
    files = [file for file in found if file is not None]
    if len(files) < len(names) or not files:
        missing = [name for name, file in zip(names, found, strict=True) if file is None]
        there = sorted(file.name for file in path.iterdir() if file.suffix in _SUFFIXES)
        raise RecordingError(
            f"{path / METADATA_FILE} lists {', '.join(missing) or 'no file'}, which does not exist; the "
            f"folder contains {', '.join(there) or 'no bag'}; name the file to read, or list it in "
            f"{METADATA_FILE}"
        )
    return SplitBag([open_rosbag2_file(file) for file in files])


def open_rosbag2_file(path: Path) -> Bag:
    """The bag in a file, which may be compressed. Raises RecordingError: not a bag."""
    head = _head(path)
    if is_packed_rosbag2(path, head):
        return PackedFile(path, open_rosbag2_file)
    if head.startswith(MCAP_MAGIC):
        return PackedMessages(McapFile(path))
    if head.startswith(SQLITE_MAGIC):
        return PackedMessages(SqliteBag(path))
    if head.startswith(ZSTD_MAGIC):
        raise RecordingError(f"{path} is damaged or truncated: nothing can be decompressed")
    raise RecordingError(f"{path} is neither MCAP nor SQLite; is it damaged?")


def _present(listed: Path) -> Path | None:
    """The listed file, uncompressed or compressed; None if neither exists."""
    plain = listed.with_name(unpacked_name(listed))
    candidates = (plain, listed, *(plain.with_name(plain.name + end) for end in (".zstd", ".zst")))
    return next((file for file in candidates if file.is_file()), None)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(16)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def _size_and_time(path: Path) -> str:
    status = path.stat()
    return f"{status.st_size}:{status.st_mtime_ns}"
