"""Formats of others: EVT 2.1, Event Stream, NumPy, csv in any order and unit, gzip, HDF5 of v2e and E2VID.

Inputs are made here after the published layouts, not by the readers' own code.
"""

from __future__ import annotations

import gzip
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from asyneio.types import EventRecording, RecordArray

T0_US = 1_600_000_000_000_000
SIZE = (240, 180)


@pytest.fixture
def events(rng: np.random.Generator) -> np.ndarray:
    """Columns t [us], x, y, p of 3000 events, int64."""
    t = np.sort(rng.integers(0, 300_000, 3000))
    return np.stack([t, rng.integers(0, 240, 3000), rng.integers(0, 180, 3000), rng.integers(0, 2, 3000)], 1)


def read(path: Path) -> EventRecording:
    found = open_recording(path)
    assert isinstance(found, EventRecording)
    return found


def assert_events(found: RecordArray, wanted: np.ndarray, offset_us: int = 0) -> None:
    """The same events; those of one time may stand in another order."""
    columns = np.stack([found["t_ns"] // 1000 - offset_us, found["x"], found["y"], found["p"]], 1)
    columns = columns.astype(np.int64)
    assert sorted(map(tuple, columns.tolist())) == sorted(map(tuple, wanted.tolist()))


def evt21(events: np.ndarray, legacy: bool, endianness: str) -> bytes:
    """A RAW file: one pixel a word but for the first, which has the last bit of its mask set as well."""
    words, high = [], -1
    for t, x, y, p in events.tolist():
        if t >> 6 != high:
            high = t >> 6
            words.append(8 << 60 | high << 32)
        words.append(p << 60 | (t & 63) << 54 | (x // 32 * 32) << 43 | y << 32 | 1 << x % 32)
    data = np.array(words, dtype=np.uint64)
    if legacy:
        data = (data >> np.uint64(32)) | (data << np.uint64(32))
    header = f"% evt 2.1\n% format EVT21;height=180;width=240{endianness}\n% end\n"
    return header.encode() + data.astype("<u8").tobytes()


@pytest.mark.parametrize(
    ("legacy", "endianness"),
    [(False, ""), (False, ";endianness=little"), (True, ""), (True, ";endianness=legacy")],
)
def test_evt21_in_both_word_orders(tmp_path: Path, events: np.ndarray, legacy: bool, endianness: str) -> None:
    (tmp_path / "rec.raw").write_bytes(evt21(events, legacy, endianness))
    found = read(tmp_path)
    assert (found.width, found.height) == SIZE
    assert_events(found.events, events)


def test_words_that_are_no_evt21_are_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    garbage = rng.integers(0, 2**62, 5000).astype("<u8").tobytes()
    (tmp_path / "rec.raw").write_bytes(b"% evt 2.1\n% geometry 240x180\n% end\n" + garbage)
    with pytest.raises(RecordingError, match=r"rec.raw: \d+ of 5000 words are of no kind that EVT 2.1 knows"):
        open_recording(tmp_path)


def test_padding_of_a_lucid_camera_is_counted(tmp_path: Path) -> None:
    words = [0x8000, 0x6000, 0x0005, 0x2807, 0x9999, 0x6010, 0x2808, 0x9999, 0xB123]
    header = b"% evt 3.0\n% geometry 240x180\n% end\n"
    (tmp_path / "rec.raw").write_bytes(header + np.array(words, "<u2").tobytes())
    found = read(tmp_path)
    assert found.events["x"].tolist() == [7, 8]
    notes = " ".join(found.notes)
    assert "skipped 2 word(s) of padding (code 9) (22% of the words)" in notes
    assert "skipped 1 word(s) of no known kind (11% of the words): is the file damaged?" in notes


def event_stream(events: np.ndarray, atis: bool) -> bytes:
    longest, last, out = (63 if atis else 127), 0, bytearray()
    for t, x, y, p in events.tolist():
        step = t - last
        while step >= longest:
            count = min(step // longest, 3) if atis else 1
            out.append(0xFC | count if atis else 0xFF)
            step -= count * longest
        out += struct.pack("<BHH", step << 2 | p << 1 if atis else step << 1 | p, x, y)
        last = t
    return struct.pack("<12s3BBHH", b"Event Stream", 2, 0, 0, 2 if atis else 1, *SIZE) + bytes(out)


@pytest.mark.parametrize("atis", [False, True])
def test_event_stream(tmp_path: Path, events: np.ndarray, atis: bool) -> None:
    (tmp_path / "rec.es").write_bytes(event_stream(events, atis))
    found = read(tmp_path / "rec.es")
    assert (found.width, found.height) == SIZE
    assert_events(found.events, events)


def test_event_stream_of_other_kinds_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rec.es").write_bytes(struct.pack("<12s3BBHH", b"Event Stream", 2, 0, 0, 4, *SIZE))
    with pytest.raises(RecordingError, match="a colour camera; expected a DVS"):
        open_recording(tmp_path / "rec.es")


def npz(path: Path, events: np.ndarray) -> None:
    t, x, y, p = events.T
    np.savez(path, x=x.astype("u2"), y=y.astype("u2"), t=t + T0_US, p=p.astype(bool))


def npz_of_one_array(path: Path, events: np.ndarray) -> None:
    np.savez(path, events=events[:, [1, 2, 3, 0]] + np.array([0, 0, 0, T0_US]))


def npy(path: Path, events: np.ndarray) -> None:
    with path.open("wb") as stream:
        np.save(stream, (events + np.array([T0_US, 0, 0, 0])).astype(np.float64))


def npy_of_fields(path: Path, events: np.ndarray) -> None:
    table = np.zeros(len(events), [("x", "<u2"), ("y", "<u2"), ("p", "i1"), ("timestamp", "<i8")])
    table["timestamp"], table["x"], table["y"] = events[:, 0] + T0_US, events[:, 1], events[:, 2]
    table["p"] = 2 * events[:, 3] - 1
    with path.open("wb") as stream:
        np.save(stream, table)


@pytest.mark.parametrize(
    ("name", "write"),
    [("a.npz", npz), ("b.npz", npz_of_one_array), ("c.npy", npy), ("d.npy", npy_of_fields)],
)
def test_numpy(
    tmp_path: Path, events: np.ndarray, name: str, write: Callable[[Path, np.ndarray], None]
) -> None:
    write(tmp_path / name, events)
    assert_events(read(tmp_path).events, events, T0_US)


def test_numpy_without_events_lists_what_it_holds(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", depth=np.zeros((3, 4, 5)), index=np.array([{}], dtype=object))
    with pytest.raises(
        RecordingError, match=r"holds depth \(3, 4, 5\) of float64; expected arrays named t, x"
    ):
        open_recording(tmp_path / "a.npz")


TEXTS = {
    "Metavision": ("", "{x},{y},{p},{t}", 0, "x y p t, time in microseconds"),
    "tabs": ("", "{x}\t{y}\t{p}\t{t}", 57_922_807_588, "x y p t, time in microseconds"),
    "DV": ("\ufefftimestamp,x,y,polarity\r\n", "{t},{x},{y},{p}\r", T0_US, "by their names"),
    "pandas": (",timestamp,x,y,polarity\n", "7,{t},{x},{y},{p}", T0_US, "by their names"),
    "microseconds": ("", "{t} {x} {y} {p}", T0_US, "t x y p, time in microseconds (stamps since 1970)"),
    "named unit": ("# x y t[us] p\n", "{x} {y} {t} {p}", 0, "time in microseconds (by its name)"),
    "N-MNIST": ("", "{x} {y} {t} {p}", 0, "x y t p, time in microseconds"),
}


@pytest.mark.parametrize("layout", TEXTS)
@pytest.mark.parametrize("packed", [False, True])
def test_text_of_others(tmp_path: Path, events: np.ndarray, layout: str, packed: bool) -> None:
    header, line, offset, said = TEXTS[layout]
    rows = (line.format(t=t + offset, x=x, y=y, p=p) + "\n" for t, x, y, p in events.tolist())
    text = (header + "".join(rows)).encode()
    if packed:
        (tmp_path / "events.csv.gz").write_bytes(gzip.compress(text))
    else:
        (tmp_path / "events.csv").write_bytes(text)
    found = read(tmp_path)
    assert_events(found.events, events, offset)
    assert said in " ".join(found.notes)
    assert "unreadable" not in " ".join(found.notes)


def test_nanoseconds_of_the_epoch_are_exact(tmp_path: Path) -> None:
    stamps = [T0_US * 1000 + k for k in (1, 2, 999)]
    (tmp_path / "events.txt").write_text("".join(f"{t} 5 6 1\n" for t in stamps))
    assert read(tmp_path).events["t_ns"].tolist() == stamps


def test_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "events.txt").write_bytes(b"\xef\xbb\xbf0.5 1 2 1\r\n0.6 1 2 0\r\n")
    found = read(tmp_path)
    assert found.events["t_ns"].tolist() == [500_000_000, 600_000_000]
    assert not any("unreadable" in note for note in found.notes)


def test_decimal_commas_are_named_and_the_cure_works(tmp_path: Path, events: np.ndarray) -> None:
    rows = ((t, x, y, p) for t, x, y, p in events.tolist())
    file = tmp_path / "events.txt"
    file.write_text("".join(f"5,{t:06d};{x};{y};{p}\n" for t, x, y, p in rows))
    with pytest.raises(RecordingError, match="decimal commas") as caught:
        open_recording(tmp_path)
    command = str(caught.value).split("Type: ")[1]
    assert "'5," in str(caught.value)
    subprocess.run(command, shell=True, cwd=tmp_path, check=True)
    assert_events(read(tmp_path).events, events, 5_000_000)


def test_rows_out_of_order_are_named_and_the_cure_works(tmp_path: Path, events: np.ndarray) -> None:
    order = np.lexsort((events[:, 1], events[:, 0] // 33_000))
    lines = (f"{t / 1e6:.6f} {x} {y} {p}\n" for t, x, y, p in events[order].tolist())
    (tmp_path / "events.txt").write_text("".join(lines))
    with pytest.raises(RecordingError, match="not in the order of time") as caught:
        open_recording(tmp_path)
    command = str(caught.value).split("Sort it: ")[1]
    subprocess.run(f"{command} && mv sorted.txt events.txt", shell=True, cwd=tmp_path, check=True)
    assert_events(read(tmp_path).events, events)


def write_v2e(file: h5py.File, events: np.ndarray) -> None:
    rows = np.stack([events[:, 0], events[:, 1], events[:, 2], 2 * events[:, 3] - 1], 1)
    file.create_dataset("events", data=rows.astype("<u4"), compression="gzip")


def write_e2vid(file: h5py.File, events: np.ndarray) -> None:
    group = file.create_group("events")
    group["ts"], group["ps"] = events[:, 0] / 1e6, events[:, 3].astype(bool)
    group["xs"], group["ys"] = events[:, 1].astype("i2"), events[:, 2].astype("i2")
    file.attrs["sensor_resolution"] = (180, 240)


def write_matlab(file: h5py.File, events: np.ndarray) -> None:
    for name, values in zip("txyp", events.T, strict=True):
        file[f"events/{name}"] = values.astype(">f8")


@pytest.mark.parametrize("write", [write_v2e, write_e2vid, write_matlab])
def test_hdf5_of_others(
    tmp_path: Path, events: np.ndarray, write: Callable[[h5py.File, np.ndarray], None]
) -> None:
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        write(file, events)
    found = read(tmp_path)
    assert_events(found.events, events)
    assert (found.width, found.height) == SIZE
    assert "rec.h5" in " ".join(found.notes)


def test_hdf5_in_nanoseconds_of_the_epoch(tmp_path: Path, events: np.ndarray) -> None:
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        for name, values in zip("txyp", events.T, strict=True):
            file[f"events/{name}"] = values if name != "t" else (values + T0_US) * 1000
    found = read(tmp_path)
    assert_events(found.events, events, T0_US)
    assert "nanoseconds (stamps since 1970)" in " ".join(found.notes)


def test_unknown_hdf5_is_listed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        file["depth/images"] = np.zeros((2, 3))
    with pytest.raises(RecordingError, match=r"holds depth/images \(2, 3\) float64; expected events/x, y"):
        open_recording(tmp_path / "rec.h5")


@pytest.mark.parametrize(("where", "stamp"), [(0, 0), (1500, 0), (1500, 2**60), (2999, 2**60), (0, 2**60)])
def test_one_wrong_stamp_is_dropped(tmp_path: Path, events: np.ndarray, where: int, stamp: int) -> None:
    t_ns = (events[:, 0] + T0_US) * 1000
    t_ns[where] = stamp
    lines = (
        f"{t // 10**9}.{t % 10**9:09d} {x} {y} {p}\n"
        for t, (x, y, p) in zip(t_ns.tolist(), events[:, 1:].tolist(), strict=True)
    )
    (tmp_path / "events.txt").write_text("".join(lines))
    found = read(tmp_path)
    assert_events(found.events, np.delete(events, where, axis=0), T0_US)
    assert "dropped 1 isolated event(s)" in " ".join(found.notes)


def test_a_path_that_is_not_there_and_a_pipe(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"does not exist; \S+ is there"):
        open_recording(tmp_path / "no" / "such")
    with pytest.raises(RecordingError, match="is a pipe or a device"):
        open_recording("/dev/null")
