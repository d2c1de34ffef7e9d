"""Bags that leave a choice, that were cut off or damaged, or that mean harm."""

from __future__ import annotations

import re
import sqlite3
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer

from asyneio.errors import AsyneioError, RecordingError
from asyneio.io import ReadOptions, open_recording, write_uzh_folder
from asyneio.io.ros.bag import MAX_UNPACKED, CutError, Message, Topic, unpack
from asyneio.io.ros.event_arrays import EventArrayDecoder, event_fields
from asyneio.io.ros.field_offsets import Locator, locate
from asyneio.io.ros.number_table import NumberTable
from asyneio.io.ros.ros1_writer import write_rosbag
from asyneio.io.ros.schema import parse_schema
from asyneio.types import Distortion, EventRecording
from tests.io.event_recordings import make_event_recording
from tests.io.ros_bags import Record, camera_record, header, recording_records, write_bag

K = [200.0, 0, 120, 0, 201, 90, 0, 0, 1]


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    return make_event_recording(np.random.default_rng(11), 3000)


@pytest.fixture(scope="module")
def records(recording: EventRecording) -> list[Record]:
    return recording_records(recording)


def renamed(records: list[Record], old: str, new: str) -> list[Record]:
    return [replace(record, topic=new) for record in records if record.topic == old]


def test_several_topics(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    more = renamed(records, "/dvs/events", "/right/events")[:2] + renamed(records, "/dvs/imu", "/right/imu")
    path = write_bag(tmp_path / "run", 1, records + more)
    with pytest.raises(
        RecordingError, match=r"2 topics of events: /dvs/events .*6 messages.*/right.*--events"
    ):
        open_recording(path)
    with pytest.raises(RecordingError, match=r"2 topics of samples: /dvs/imu .*--samples TOPIC"):
        open_recording(path, ReadOptions(events="/dvs/events"))
    with pytest.raises(RecordingError, match=r"no events in a topic /dvs/imu; it has /dvs/events"):
        open_recording(path, ReadOptions(events="/dvs/imu"))
    for name, count in (("/dvs/events", 3000), ("/right/events", 1000)):
        found = open_recording(path, ReadOptions(events=name, samples="/right/imu"), cache_from=0)
        assert found.events.size == count
        np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
        assert any(f"events from {name} (dvs_msgs/EventArray" in note for note in found.notes)


def test_no_events(tmp_path: Path, records: list[Record]) -> None:
    path = write_bag(tmp_path / "run", 2, [record for record in records if record.topic != "/dvs/events"])
    with pytest.raises(RecordingError, match=r"no topic of events; .*/dvs/imu \(sensor_msgs/msg/Imu"):
        open_recording(path)


def test_samples_without_stamps(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    """Then the times of recording count; and stamps that run twice as fast are told."""
    for factor, said in ((0, "have no stamps; the times of recording"), (2, "go by 2.0[0-9]* times as fast")):
        changed = []
        start = records[0].logged_ns
        for record in records:
            if record.topic == "/dvs/imu":
                t_ns = start + factor * (record.logged_ns - start) if factor else 0
                record = replace(record, values=record.values | {"header": header(t_ns)})
            changed.append(record)
        found = open_recording(write_bag(tmp_path / f"run{factor}", 1, changed))
        assert re.search(said, " ".join(found.notes))
        if factor == 0:
            np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)


def test_files_beside(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    """What the bag lacks may stand in files: samples and true poses."""
    only = [record for record in records if record.topic == "/dvs/events"]
    write_uzh_folder(recording, tmp_path / "files")
    path = write_bag(tmp_path / "run.bag", 1, only)
    assert open_recording(path).gyroscope.size == 0
    found = open_recording(path, ReadOptions(samples=str(tmp_path / "files" / "imu.txt")))
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    path.rename(tmp_path / "files" / "run.bag")
    (tmp_path / "files" / "events.txt").unlink()
    found = open_recording(tmp_path / "files" / "run.bag")
    np.testing.assert_array_equal(found.accelerometer, recording.accelerometer)
    assert found.ground_truth is not None
    assert found.calibration is not None


def test_several_truths(tmp_path: Path, records: list[Record]) -> None:
    more = renamed(records, "/optitrack/davis", "/vicon/board")
    found = open_recording(write_bag(tmp_path / "run", 1, records + more))
    assert found.ground_truth is None
    assert any("several topics of poses, none taken" in note for note in found.notes)


@pytest.mark.parametrize(
    ("model", "d", "distortion", "coefficients"),
    [
        ("plumb_bob", [-0.3, 0.1, 0.0, 0.0, 0.0], Distortion.RADTAN, (-0.3, 0.1, 0.0, 0.0)),
        ("plumb_bob", [-0.3, 0.1, 0.0, 0.0, 0.2], Distortion.RADTAN, (-0.3, 0.1, 0.0, 0.0, 0.2)),
        ("plumb_bob", [0.0] * 5, Distortion.NONE, ()),
        ("equidistant", [0.1, 0.0, 0.0, 0.02], Distortion.EQUIDISTANT, (0.1, 0.0, 0.0, 0.02)),
        ("rational_polynomial", [-0.3, 0.1, 0, 0, 0, 0, 0, 0], Distortion.RADTAN, (-0.3, 0.1, 0.0, 0.0)),
        ("rational_polynomial", [0.1] * 8, Distortion.RADTAN, (0.1,) * 8),
        ("rational_polynomial", [0.0] * 8, Distortion.NONE, ()),
        ("rational_polynomial", [0.0] * 11 + [0.01], Distortion.RADTAN, (*(0.0,) * 11, 0.01)),
        ("rational_polynomial", [*(0.1,) * 8, *(0.0,) * 6], Distortion.RADTAN, (0.1,) * 8),
    ],
)
@pytest.mark.parametrize("ros", [1, 2])
def test_lens(
    tmp_path: Path,
    records: list[Record],
    ros: int,
    model: str,
    d: list[float],
    distortion: Distortion,
    coefficients: tuple[float, ...],
) -> None:
    start = records[0].logged_ns
    path = write_bag(tmp_path / "run", ros, [camera_record(start, ros, K, d, model), *records[:200]])
    lens = open_recording(path).camera
    assert lens is not None
    assert (lens.fx, lens.fy, lens.cx, lens.cy, lens.width) == (200.0, 201.0, 120.0, 90.0, 240)
    assert (lens.distortion, lens.coefficients) == (distortion, coefficients)


@pytest.mark.parametrize(
    ("k", "d", "model", "said"),
    [
        ([0.0] * 9, [], "", ""),
        (K, [0.1] * 14, "rational_polynomial", "a tilted sensor"),
        (K, [0.1] * 3, "plumb_bob", "found 3 coefficients"),
        (K, [0.1] * 4, "ftheta", "'ftheta'; expected one of"),
        ([-5.0, *K[1:]], [], "", "not taken for the lens"),
    ],
)
def test_no_lens(
    tmp_path: Path, records: list[Record], k: list[float], d: list[float], model: str, said: str
) -> None:
    start = records[0].logged_ns
    found = open_recording(
        write_bag(tmp_path / "run", 1, [camera_record(start, 1, k, d, model), *records[:200]])
    )
    assert found.camera is None
    assert said in " ".join(found.notes)


@pytest.mark.parametrize(
    ("ros", "packing", "storage"),
    [(1, "", ""), (1, "lz4", ""), (1, "bz2", ""), (2, "", "mcap"), (2, "storage", "mcap")],
)
def test_cut_off(
    tmp_path: Path,
    recording: EventRecording,
    records: list[Record],
    ros: int,
    packing: str,
    storage: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Wherever a recording was cut off, what stands before is read, and how much is said."""
    monkeypatch.setattr(Writer, "__init__", small_chunks(Writer.__init__))
    path = write_bag(tmp_path / "run", ros, records, packing, storage)
    path = path if ros == 1 else path / "run.mcap"
    data = path.read_bytes()
    sizes = []
    # A block of zstd is 128 KiB unpacked: almost half of this bag.
    for share in (0.6, 0.9, 0.999) if packing == "storage" else (0.3, 0.5, 0.7, 0.9, 0.999):
        cut = tmp_path / "cut"
        cut.write_bytes(data[: int(share * len(data))])
        found = open_recording(cut)
        sizes.append(found.events.size)
        np.testing.assert_array_equal(found.events, recording.events[: sizes[-1]])
        if share < 0.9:
            assert any("cut off at byte" in note for note in found.notes)
    assert sizes == sorted(sizes)
    assert 0 < sizes[0] < sizes[-1] == 3000


@pytest.mark.parametrize("packing", ["", "lz4", "bz2"])
def test_damaged_in_the_middle(
    tmp_path: Path,
    recording: EventRecording,
    records: list[Record],
    packing: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A chunk is spoilt; those before and after it are read."""
    monkeypatch.setattr(Writer, "__init__", small_chunks(Writer.__init__))
    path = write_bag(tmp_path / "run.bag", 1, records, packing)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    # Where nothing is packed, the length of a message's header is what tells.
    at = middle if packing else data.index(b"op=\2", data.index(b"op=\2", middle) + 4) - 8
    data[at : at + 8] = b"\xff" * 8
    path.write_bytes(data)
    found = open_recording(path)
    assert 2500 + 250 < found.events.size + found.gyroscope.size < 3000 + recording.gyroscope.size
    assert found.events["t_ns"][-1] == recording.events["t_ns"][-1]
    assert any("damaged record(s), the first at byte" in note for note in found.notes)


def small_chunks(make: Callable[..., None]) -> Callable[..., None]:
    def init(self: Writer, path: Path) -> None:
        make(self, path)
        self.chunk_threshold = 5000

    return init


def test_cut_off_in_a_database(tmp_path: Path, records: list[Record]) -> None:
    """SQLite itself refuses a file that is shorter than it should be."""
    path = write_bag(tmp_path / "run", 2, records, storage="sqlite3") / "run.db3"
    data = path.read_bytes()
    cut = tmp_path / "cut.db3"
    cut.write_bytes(data[: len(data) * 2 // 3])
    with pytest.raises(RecordingError, match=r"malformed; if it was cut off, try sqlite3 cut.db3 .recover"):
        open_recording(cut)


def test_split(tmp_path: Path, recording: EventRecording, records: list[Record]) -> None:
    """A recording in two files, as its metadata says."""
    half = len(records) // 2
    first = write_bag(tmp_path / "run", 2, records[:half])
    second = write_bag(tmp_path / "second", 2, records[half:])
    (second / "second.mcap").rename(first / "second.mcap")
    text = (first / "metadata.yaml").read_text()
    (first / "metadata.yaml").write_text(text.replace("- run.mcap\n", "- run.mcap\n  - ../second.mcap\n", 1))
    found = open_recording(first)
    np.testing.assert_array_equal(found.events, recording.events)
    (first / "second.mcap").unlink()
    with pytest.raises(RecordingError, match=r"lists second.mcap, which is not there"):
        open_recording(first)


def test_database_without_definitions(
    tmp_path: Path, recording: EventRecording, records: list[Record]
) -> None:
    """Before Iron a bag did not hold them; types known by name are read."""
    path = write_bag(tmp_path / "run", 2, records, storage="sqlite3")
    database = sqlite3.connect(path / "run.db3")
    with database:
        database.execute("DROP TABLE message_definitions")
    database.close()
    np.testing.assert_array_equal(open_recording(path).events, recording.events)


def test_no_message_can_be_decoded(tmp_path: Path, records: list[Record]) -> None:
    """The definition in the bag promises more than the messages hold."""
    path = write_bag(tmp_path / "run.bag", 1, records)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"uint16 x\n", b"uint64 x\n"))
    with pytest.raises(RecordingError, match=r"none of 6 message.* can be decoded: .*claims"):
        open_recording(path)


@pytest.mark.parametrize("kind", ["bag", "bz2", "lz4", "mcap", "zstd", "db3"])
@given(st.integers(0, 10**6), st.binary(min_size=1, max_size=6))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_changed(kind: str, tmp_path: Path, position: int, junk: bytes) -> None:
    """Wherever a bag is damaged: a recording or a sentence."""
    path = intact(tmp_path, kind)
    data = bytearray(path.read_bytes())
    start = position % len(data)
    data[start : start + len(junk)] = junk
    damaged = tmp_path / "damaged"
    damaged.write_bytes(data)
    try:
        assert open_recording(damaged).events.size
    except AsyneioError:
        return


def intact(folder: Path, kind: str) -> Path:
    """A small bag of a kind, made once."""
    packing = {"bag": "", "bz2": "bz2", "lz4": "lz4", "zstd": "storage"}.get(kind, "")
    ros = 1 if kind in ("bag", "bz2", "lz4") else 2
    storage = "sqlite3" if kind == "db3" else "mcap"
    path = folder / "whole"
    if not path.exists():
        small = replace(make_event_recording(np.random.default_rng(1), 40), ground_truth=None)
        small = replace(small, gyroscope=small.gyroscope[:5], accelerometer=small.accelerometer[:5])
        write_bag(path, ros, recording_records(small, length=10), packing, storage)
    return path if ros == 1 else path / f"whole.{storage[:4] if storage == 'mcap' else 'db3'}"


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
    locator = Locator(schema, cdr)
    plain = (
        (b"\0\1\0\0" if cdr else b"") + bytes([3, 0, 0, 0]) + b"ab\0" + bytes(9) + bytes([1, 0, 0, 0]) * 12
    )
    for position, content in changes:
        data = plain[: 4 * position] + content + plain[4 * position :] if position % 3 else plain + content
        try:
            wanted = locate(schema, data, cdr)
        except ValueError:
            with pytest.raises(ValueError, match=r"."):
                locator.locate(data)
            continue
        assert locator.locate(data) == wanted


def test_absurd_count() -> None:
    """A message of 100 bytes that claims four billion events takes no memory."""
    schema = parse_schema("p/EventArray", ARRAY.format(EVENT).replace("std_msgs/Header header\n", ""))
    fields = event_fields(schema)
    assert fields is not None
    data = struct.pack("<III", 180, 240, 2**32 - 1) + bytes(100)
    with pytest.raises(ValueError, match="more than it can hold"):
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
        with pytest.raises(ValueError, match=r"not defined|ends early"):
            locate(schema, bytes(50), False)


def test_definitions_that_are_none() -> None:
    with pytest.raises(RecordingError, match="no field: 'uint16'"):
        parse_schema("p/A", "uint16\n")
    schema = parse_schema(
        "p/A", "# a comment\nuint8 ON=1\nstring TEXT=a # b\nint32[<=5] x # c\nfloat32 y 0.5\n"
    )
    assert [(field.name, field.count) for field in schema.types["p/A"]] == [("x", -1), ("y", None)]


def test_unpack_is_bounded() -> None:
    with pytest.raises(CutError, match="claims to hold"):
        unpack(b"", "lz4", MAX_UNPACKED + 1)
    with pytest.raises(CutError, match="'gzip'"):
        unpack(b"", "gzip", 10)


def test_texts_of_other_length(recording: EventRecording, records: list[Record], tmp_path: Path) -> None:
    """Messages of one topic with frames of different names, the same total length or not."""
    changed = []
    for k, record in enumerate(records):
        values = dict(record.values)
        values["header"] = dict(values["header"], frame_id="imu_link"[: k % 7])
        changed.append(replace(record, values=values))
    for ros in (1, 2):
        found = open_recording(write_bag(tmp_path / f"run{ros}", ros, changed))
        np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
        np.testing.assert_array_equal(found.events, recording.events)


def test_writer_refuses(tmp_path: Path, recording: EventRecording) -> None:
    apart = replace(recording, accelerometer=recording.accelerometer[1:])
    with pytest.raises(RecordingError, match="their times differ"):
        write_rosbag(apart, tmp_path / "run.bag")
    early = recording.events.copy()
    early["t_ns"] -= 2 * 10**18
    with pytest.raises(RecordingError, match="a bag holds 0 to"):
        write_rosbag(replace(recording, events=early), tmp_path / "run.bag")
    assert list(tmp_path.iterdir()) == []
