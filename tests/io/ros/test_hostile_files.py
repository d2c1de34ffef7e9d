"""Messages and definitions from hostile files, and recordings that cannot be written."""

from __future__ import annotations

import sqlite3
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import RecordingError
from asyneio.io.parsing.unpack import MAX_UNPACKED, CutError, unpack
from asyneio.io.ros.bag import Message, Topic
from asyneio.io.ros.event_arrays import EventArrayDecoder, event_fields
from asyneio.io.ros.field_offsets import LayoutFinder, find_layout
from asyneio.io.ros.number_table import NumberTable
from asyneio.io.ros.ros1_writer import write_rosbag
from asyneio.io.ros.rosbag2 import SqliteBag
from asyneio.io.ros.schema import parse_schema
from asyneio.types import EventRecording

ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\nEvent[] events\nMSG: p/Event\n{}"

EVENT = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"


@given(st.binary(max_size=120), st.booleans())
def test_any_message(data: bytes, cdr: bool) -> None:
    """Noise as a message: a list of events that fits into it, or a ValueError."""
    schema = parse_schema("p/EventArray", ARRAY.format(EVENT))
    fields = event_fields(schema)
    assert fields is not None
    start = b"\0\1\0\0" if cdr else b""
    decoder = EventArrayDecoder(schema, cdr, fields)
    try:
        found = decoder.decode(start + data)
    except ValueError:
        return
    assert 13 * found.events.size <= len(data)


@given(st.booleans(), st.lists(st.tuples(st.integers(0, 9), st.binary(max_size=30)), max_size=12))
def test_places_are_those_of_the_message(cdr: bool, changes: list[tuple[int, bytes]]) -> None:
    """Messages that resemble the one before, and others: never another answer than a fresh look gives."""
    schema = parse_schema("p/A", "string a\nfloat64 b\nuint16[] c\nstring d\nuint32[] e\n")
    finder = LayoutFinder(schema, cdr)
    plain = (
        (b"\0\1\0\0" if cdr else b"") + bytes([3, 0, 0, 0]) + b"ab\0" + bytes(9) + bytes([1, 0, 0, 0]) * 12
    )
    for position, content in changes:
        data = plain[: 4 * position] + content + plain[4 * position :] if position % 3 else plain + content
        try:
            wanted = find_layout(schema, data, cdr)
        except ValueError:
            with pytest.raises(ValueError, match=r"."):
                finder.find_layout(data)
            continue
        assert finder.find_layout(data) == wanted


def test_absurd_count() -> None:
    """A message of 100 bytes that claims four billion events takes no memory."""
    schema = parse_schema("p/EventArray", ARRAY.format(EVENT).replace("std_msgs/Header header\n", ""))
    fields = event_fields(schema)
    assert fields is not None
    data = struct.pack("<III", 180, 240, 2**32 - 1) + bytes(100)
    with pytest.raises(ValueError, match="more than fit into it"):
        EventArrayDecoder(schema, False, fields).decode(data)


@pytest.mark.parametrize(
    "definition",
    [
        "p/A a\nMSG: p/A\np/A a\n",
        "p/A[1000000000] a\nMSG: p/A\n",
        "p/Missing a\n",
        "string a\nuint8[4000000000] b\n",
        "\n".join(f"p/A a{k}" for k in range(100))
        + "\nMSG: p/A\n"
        + "\n".join(f"p/B a{k}" for k in range(100)),
    ],
)
def test_hostile_definitions(definition: str) -> None:
    schema = parse_schema("p/Message", definition)
    schema.paths()
    assert event_fields(schema) is None
    table = NumberTable(schema, False, ("a",))
    table.add(Message(Topic("/a", "p/Message", definition, False), 0, bytes(50)))
    table.columns()
    if "Missing" in definition or "4000" in definition:
        with pytest.raises(ValueError, match=r"undefined type|too short"):
            find_layout(schema, bytes(50), False)


def test_definitions_that_are_none() -> None:
    with pytest.raises(RecordingError, match="invalid line: 'uint16'"):
        parse_schema("p/A", "uint16\n")
    schema = parse_schema(
        "p/A", "# a comment\nuint8 ON=1\nstring TEXT=a # b\nint32[<=5] x # c\nfloat32 y 0.5\n"
    )
    assert [(field.name, field.count) for field in schema.types["p/A"]] == [("x", -1), ("y", None)]


def test_unpack_is_bounded() -> None:
    with pytest.raises(CutError, match="a chunk declares"):
        unpack(b"", "lz4", MAX_UNPACKED + 1)
    with pytest.raises(CutError, match="'gzip'"):
        unpack(b"", "gzip", 10)


def test_writer_refuses(tmp_path: Path, recording: EventRecording) -> None:
    apart = replace(recording, accelerometer=recording.accelerometer[1:])
    with pytest.raises(RecordingError, match="their times differ"):
        write_rosbag(apart, tmp_path / "run.bag")
    early = recording.events.copy()
    early["t_ns"] -= 2 * 10**18
    with pytest.raises(RecordingError, match="a bag stores 0 to"):
        write_rosbag(replace(recording, events=early), tmp_path / "run.bag")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", ["NULL", "'a'", "x'00ff'", "-5", "1e300"])
def test_sqlite_rows_with_any_number(tmp_path: Path, number: str) -> None:
    """A damaged schema makes the id of a message an ordinary column."""
    database = sqlite3.connect(tmp_path / "run.db3")
    database.execute("CREATE TABLE topics(id, name, type, serialization_format)")
    database.execute("CREATE TABLE messages(id, topic_id, timestamp, data)")
    database.execute("INSERT INTO topics VALUES(1, '/a', 'std_msgs/msg/Empty', 'cdr')")
    database.execute(f"INSERT INTO messages VALUES({number}, 1, 5, x'00010000')")
    database.commit()
    database.close()
    found = list(SqliteBag(tmp_path / "run.db3").messages([]))
    assert [message.logged_ns for message, _ in found] == [5]
    assert 0.0 <= found[0][1] <= 1.0
