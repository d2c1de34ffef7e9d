"""AEDAT-2.0 and AEDAT4: real recordings against independent decoders, damaged ones against the rules."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import aedat
import lz4.frame
import numpy as np
import pytest
from backports import zstd
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from asyneio.errors import AsyneioError, CalibrationError, RecordingError
from asyneio.io import open_recording
from asyneio.io.aedat import aedat2
from asyneio.io.aedat.aedat2 import Aedat2Events
from asyneio.types import NS_PER_S

HEADER = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
GRAVITY = (0, 0, 4096)


def event(t_us: int, x: int = 0, y: int = 0, p: int = 0) -> bytes:
    return struct.pack(">II", (239 - x) << 12 | (179 - y) << 22 | p << 11, t_us % 2**32)


def sample(t_us: int, accelerometer: tuple[int, int, int], gyroscope: tuple[int, int, int]) -> bytes:
    values = (*accelerometer, 0, *gyroscope)
    return b"".join(
        struct.pack(">II", 1 << 31 | code << 28 | (value & 0xFFFF) << 12 | 0xC00, t_us % 2**32)
        for code, value in enumerate(values)
    )


def write(folder: Path, *words: bytes, header: bytes = HEADER) -> Path:
    path = folder / "run.aedat"
    path.write_bytes(header + b"".join(words))
    return path


@pytest.mark.parametrize(
    ("name", "events", "samples", "force"),
    [("IMU_rotDisk", 374_296, 7384, 9.923), ("IMU_translBoxes", 162_771, 4833, 9.899)],
)
def test_real_davis240(data_dir: Path, name: str, events: int, samples: int, force: float) -> None:
    path = data_dir / "davis240_imu" / f"{name}.aedat"
    found = open_recording(path)
    assert found.events.size == events
    assert found.gyroscope.size == found.accelerometer.size == samples
    assert np.linalg.norm(found.accelerometer["xyz"], axis=1).mean() == pytest.approx(force, abs=1e-3)
    assert NS_PER_S / np.median(np.diff(found.gyroscope["t_ns"])) == pytest.approx(2332, rel=0.1)
    assert found.calibration is not None
    # Every word once more, by the plainest reading of the layout.
    data = path.read_bytes()
    while data.startswith(b"#"):
        data = data[data.index(b"\n") + 1 :]
    words = np.frombuffer(data, dtype=">u4").reshape(-1, 2).astype(np.int64)
    words = words[words[:, 0] < 2**31]
    address = words[:, 0]
    np.testing.assert_array_equal(found.events["t_ns"], words[:, 1] * 1000)
    np.testing.assert_array_equal(found.events["x"], 239 - (address >> 12 & 0x3FF))
    np.testing.assert_array_equal(found.events["y"], 179 - (address >> 22 & 0x1FF))
    np.testing.assert_array_equal(found.events["p"], address >> 11 & 1)


def test_units_and_signs(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        event(1000, 1, 2, 1),
        sample(1000, (-4096, 0, 0), (0, -328, 0)),
        sample(2000, (0, 0, 4096), (0, 0, 328)),
        sample(3000, (0, 4096, 0), (0, 0, 0)),
        event(4000, 239, 179, 0),
    )
    found = open_recording(path)
    assert [tuple(row) for row in found.events.tolist()] == [(1_000_000, 1, 2, 1), (4_000_000, 239, 179, 0)]
    np.testing.assert_allclose(
        found.accelerometer["xyz"], 9.80665 * np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]])
    )
    np.testing.assert_allclose(found.gyroscope["xyz"], np.deg2rad([[0, -10, 0], [0, 0, 10], [0, 0, 0]]))
    assert found.notes == ()


def test_clock_turns_over(tmp_path: Path) -> None:
    times = [2**32 - 10, 2**32 - 1, 2**32, 2**32 - 1, 2**32 + 5]
    samples = [sample(t, GRAVITY, (0, 0, 0)) for t in (2**32 - 500, 2**32 + 500)]
    found = open_recording(write(tmp_path, samples[0], *(event(t) for t in times), samples[1]))
    assert found.events["t_ns"].tolist() == [1000 * t for t in sorted(times)]
    assert found.gyroscope["t_ns"].tolist() == [1000 * (2**32 - 500), 1000 * (2**32 + 500)]


def test_other_words_are_counted(tmp_path: Path) -> None:
    frame = struct.pack(">II", 1 << 31, 5)
    signal = struct.pack(">II", 1 << 10, 5)
    half = sample(5, GRAVITY, (0, 0, 0))[:24]
    found = open_recording(write(tmp_path, event(1), frame, frame, signal, half, event(9), b"\1\2\3"))
    assert found.events["t_ns"].tolist() == [1000, 9000]
    notes = " ".join(found.notes)
    for text in ("2 word(s) of frames", "1 external signal", "3 inertial word(s)", "3 byte(s) at the end"):
        assert text in notes


@given(st.lists(st.integers(0, 9), max_size=40), st.integers(1, 13))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_pieces_do_not_matter(tmp_path: Path, kinds: list[int], length: int) -> None:
    """Samples and events come out alike, however the words are cut."""
    words = b"".join(
        sample(10 * k, GRAVITY, (k, k, k))
        if kind < 5
        else sample(10 * k, GRAVITY, (0, 0, 0))[: 8 * (kind - 4)]
        if kind < 8
        else event(10 * k, k)
        for k, kind in enumerate(kinds)
    )
    path = write(tmp_path, words)
    results = []
    for size in (length, len(words) + 1):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(aedat2, "_CHUNK_WORDS", size)
            source = Aedat2Events(path)
            events = [tuple(row) for piece, _ in source.chunks() for row in piece.tolist()]
            results.append((events, source.samples().tobytes(), source.notes()))
    assert results[0] == results[1]
    assert source.samples().size == sum(kind < 5 for kind in kinds)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"#!AER-DAT3.1\r\n", "another version than 2.0 and 4"),
        (b"#!AER-DAT2.0\r\n# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n", "DVS128; only the DAVIS240"),
        (b"#!AER-DAT2.0\r\n# and so on", "nothing but a header"),
    ],
)
def test_other_headers(tmp_path: Path, header: bytes, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        open_recording(write(tmp_path, header=header))


def test_unnamed_camera(tmp_path: Path) -> None:
    found = open_recording(write(tmp_path, event(1), header=b"#!AER-DAT2.0\n"))
    assert any("taken to be a DAVIS240" in note for note in found.notes)


@given(st.binary(max_size=400))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_garbage(tmp_path: Path, data: bytes) -> None:
    try:
        open_recording(write(tmp_path, data))
    except AsyneioError:
        return


@pytest.mark.parametrize(
    ("name", "size", "events", "samples", "force"),
    [
        ("davis346_static", (346, 260), 6676, 160, 10.083),
        ("dvxplorer_static", (320, 240), 111_954, 475, 10.575),
    ],
)
def test_real_aedat4(
    data_dir: Path, name: str, size: tuple[int, int], events: int, samples: int, force: float
) -> None:
    path = data_dir / "formats" / f"{name}.aedat4"
    found = open_recording(path)
    packets = list(aedat.Decoder(str(path)))
    truth = np.concatenate([packet["events"] for packet in packets if "events" in packet])
    imu = np.concatenate([packet["imus"] for packet in packets if "imus" in packet])
    assert (found.events.size, found.gyroscope.size) == (events, samples) == (truth.size, imu.size)
    assert (found.width, found.height) == size
    for name_here, name_there in (("x", "x"), ("y", "y"), ("p", "on")):
        np.testing.assert_array_equal(found.events[name_here], truth[name_there])
    np.testing.assert_array_equal(found.events["t_ns"], truth["t"].astype(np.int64) * 1000)
    for index, axis in enumerate("xyz"):
        np.testing.assert_allclose(
            found.accelerometer["xyz"][:, index], imu[f"accelerometer_{axis}"] * 9.80665, rtol=1e-6
        )
        np.testing.assert_allclose(
            found.gyroscope["xyz"][:, index], np.deg2rad(imu[f"gyroscope_{axis}"].astype(float)), rtol=1e-6
        )
    # Both stood still: one g and no turning to speak of, which g and deg/s alone explain.
    assert np.linalg.norm(found.accelerometer["xyz"], axis=1).mean() == pytest.approx(force, abs=1e-3)
    assert np.linalg.norm(found.gyroscope["xyz"], axis=1).mean() < 0.1


def test_aedat4_cut_off(data_dir: Path, tmp_path: Path) -> None:
    data = (data_dir / "formats" / "davis346_static.aedat4").read_bytes()
    path = tmp_path / "cut.aedat4"
    path.write_bytes(data[: len(data) // 2])
    found = open_recording(path)
    assert 0 < found.events.size < 6676
    assert any("cut off after" in note for note in found.notes)


def test_aedat4_damaged_header(data_dir: Path, tmp_path: Path) -> None:
    """Bytes of a real header that are wrong end in our own error or in a recording."""
    data = (data_dir / "formats" / "davis346_static.aedat4").read_bytes()
    path = tmp_path / "bad.aedat4"
    generator = np.random.default_rng(5)
    for _ in range(20):
        changed = bytearray(data[:20_000])
        for position in generator.integers(14, 3000, 5):
            changed[position] = generator.integers(128, 256)
        path.write_bytes(changed)
        try:
            open_recording(path)
        except AsyneioError:
            continue


XML = (
    '<dv version="2.0"><node name="outInfo" path="/outInfo/">'
    '<node name="0" path="/outInfo/0/"><attr key="compression" type="string">NONE</attr>'
    '<attr key="typeIdentifier" type="string">EVTS</attr><node name="info" path="/outInfo/0/info/">'
    '<attr key="sizeX" type="int">8</attr><attr key="sizeY" type="int">6</attr></node></node>'
    '<node name="1" path="/outInfo/1/"><attr key="compression" type="string">NONE</attr>'
    '<attr key="typeIdentifier" type="string">IMUS</attr></node>'
    "</node></dv>"
)


def table(fields: dict[int, bytes]) -> tuple[bytes, int]:
    """A FlatBuffers table with its vtable before it, and where in these bytes the table stands."""
    slots, body = [0] * (max(fields) + 1), b""
    for field, value in fields.items():
        slots[field] = 4 + len(body)
        body += value
    vtable = struct.pack(f"<HH{len(slots)}H", 4 + 2 * len(slots), 4 + len(body), *slots)
    return vtable + struct.pack("<i", len(vtable)) + body, len(vtable)


def buffer(kind: bytes, fields: dict[int, bytes], after: bytes) -> bytes:
    """A FlatBuffer with its length; `after` stands right behind the table at its root."""
    content, place = table(fields)
    return struct.pack("<II4s", 8 + len(content) + len(after), 8 + place, kind) + content + after


def event_packet(*rows: tuple[int, int, int, int]) -> bytes:
    structs = b"".join(struct.pack("<qhh?3x", *row) for row in rows)
    return buffer(b"EVTS", {0: struct.pack("<I", 4)}, struct.pack("<I", len(rows)) + structs)


def imu_packet(*rows: tuple[float, ...]) -> bytes:
    """Time, accelerometer, gyroscope; numbers that are zero are left out, as FlatBuffers does."""
    tables, places = b"", []
    for t, *axes in rows:
        fields = {0: struct.pack("<q", int(t))}
        fields |= {k + 2: struct.pack("<f", axis) for k, axis in enumerate(axes) if axis != 0.0}
        content, place = table(fields)
        places.append(len(tables) + place)
        tables += content
    offsets = [4 * (len(rows) - k) + place for k, place in enumerate(places)]
    vector = struct.pack(f"<I{len(rows)}I", len(rows), *offsets) + tables
    return buffer(b"IMUS", {0: struct.pack("<I", 4)}, vector)


def aedat4_file(path: Path, *packets: tuple[int, bytes], packing: int = 0, index: bytes = b"") -> Path:
    """Streams and packets as a file, packed as told; `index` comes after the place that the header names."""
    pack = {0: bytes, 1: lz4.frame.compress, 3: zstd.compress}[packing]
    body = b""
    for number, data in packets:
        packed = pack(data)
        body += struct.pack("<ii", number, len(packed)) + packed
    text = struct.pack("<I", len(XML)) + XML.encode()

    def header(end: int) -> bytes:
        fields = {2: struct.pack("<I", 16), 0: struct.pack("<i", packing), 1: struct.pack("<q", end)}
        return b"#!AER-DAT4.0\r\n" + buffer(b"IOHE", fields, text)

    start = header(len(header(0)) + len(body)) if index else header(-1)
    path.write_bytes(start + body + index)
    return path


EVENTS = ((1000, 1, 2, 1), (2000, 7, 5, 0), (300_000, 0, 0, 1))
IMU = [(1000.0 * k, 0.0, 0.0, 1.0, 10.0, 0.0, 0.0) for k in range(300)]


@pytest.mark.parametrize("packing", [0, 1, 3])
@pytest.mark.parametrize("index", [b"", b"\x10\0\0\0 whatever stands here"])
def test_aedat4_made_by_hand(tmp_path: Path, packing: int, index: bytes) -> None:
    packets = [(0, event_packet(*EVENTS[:2])), (1, imu_packet(*IMU)), (5, b"x"), (0, event_packet(EVENTS[2]))]
    found = open_recording(aedat4_file(tmp_path / "x.aedat4", *packets, packing=packing, index=index))
    assert [tuple(row) for row in found.events.tolist()] == [(1000 * t, *rest) for t, *rest in EVENTS]
    assert (found.width, found.height) == (8, 6)
    np.testing.assert_allclose(found.accelerometer["xyz"], [[0.0, 0.0, 9.80665]] * 300)
    np.testing.assert_allclose(found.gyroscope["xyz"], [[np.deg2rad(10.0), 0.0, 0.0]] * 300)
    np.testing.assert_array_equal(found.gyroscope["t_ns"], 1_000_000 * np.arange(300))
    assert found.notes == ()


def test_aedat4_in_si_units(tmp_path: Path) -> None:
    """A writer that ignores the units of the format is recognised by gravity."""
    rows = [(1000.0 * k, 0.0, 0.0, np.nan if k == 5 else 9.81, 0.5, 0.0, 0.0) for k in range(300)]
    packets = (0, event_packet(*EVENTS)), (1, imu_packet(*rows))
    found = open_recording(aedat4_file(tmp_path / "run.aedat4", *packets))
    np.testing.assert_allclose(found.accelerometer["xyz"][:, 2], 9.81, rtol=1e-6)
    np.testing.assert_allclose(found.gyroscope["xyz"][:, 0], 0.5, rtol=1e-6)
    assert any("m/s^2 already" in note for note in found.notes)
    assert any("dropped 1 sample(s) that are not finite" in note for note in found.notes)


@pytest.mark.parametrize("packing", [0, 1, 3])
def test_aedat4_cut_anywhere(tmp_path: Path, packing: int) -> None:
    """Whole packets before the cut are read; in the header or before the first event nothing is."""
    packets = [(0, event_packet((1000 * k, k % 8, k % 6, 1))) for k in range(20)]
    path = aedat4_file(tmp_path / "x.aedat4", *packets, packing=packing)
    data = path.read_bytes()
    for length in range(len(data) - 300, len(data), 7):
        path.write_bytes(data[:length])
        found = open_recording(path)
        assert 0 < found.events.size < 20
        assert found.events["t_ns"].tolist() == [1_000_000 * k for k in range(found.events.size)]
    for length in range(10, 400, 13):
        path.write_bytes(data[:length])
        with pytest.raises(RecordingError, match=r"AEDAT4|no known format"):
            open_recording(path)


@pytest.mark.parametrize(
    ("packets", "message"),
    [
        ([(1, imu_packet(*IMU))], "holds no event"),
        ([(0, b"short")], "cannot be unpacked"),
        ([(0, struct.pack("<II", 8, 2**31) + b"EVTS")], "outside its packet"),
        ([(0, imu_packet(*IMU))], "a packet of the kind b'IMUS' in a stream of EVTS"),
        (
            [(0, buffer(b"EVTS", {0: struct.pack("<I", 4)}, struct.pack("<I", 2**32 - 1)))],
            "outside its packet",
        ),
        ([(0, event_packet((2**62, 1, 1, 1)))], "beyond any range"),
        ([(0, event_packet((-(2**63), 1, 1, 1)))], "beyond any range"),
    ],
)
def test_aedat4_refused(tmp_path: Path, packets: list[tuple[int, bytes]], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        open_recording(aedat4_file(tmp_path / "x.aedat4", *packets))


@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
def test_aedat4_damaged(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever bytes change, offsets lead nowhere outside: the file is read or refused in words."""
    path = aedat4_file(tmp_path / "x.aedat4", (0, event_packet(*EVENTS)), (1, imu_packet(*IMU[:9])))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(14, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    try:
        open_recording(path)
    except AsyneioError:
        return


def test_calibration_of_another_sensor(data_dir: Path, tmp_path: Path) -> None:
    shutil.copy(data_dir / "formats" / "davis346_static.aedat4", tmp_path)
    for name in ("camchain-imucam.yaml", "imu.yaml"):
        shutil.copy(data_dir / "davis240_imu" / name, tmp_path)
    with pytest.raises(
        CalibrationError, match="240 x 180 pixels, but davis346_static was recorded with 346 x 260"
    ):
        open_recording(tmp_path / "davis346_static.aedat4")
