"""Files made to harm: links and storage outside the file, bombs, pickles, absurd sizes, paths that climb out.

Each is rejected with a message, in bounded memory, and nothing outside the recording is read. Tests of single
readers are next to them; `docs/reliability.md` lists all of them.
"""

from __future__ import annotations

import gzip
import socket
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import h5py
import numpy as np
import pytest
from backports import zstd

from asyneio.config import load_config
from asyneio.errors import AsyneioError, CalibrationError, ConfigError, RecordingError
from asyneio.io import open_recording, read_trajectory
from asyneio.io.calibration import read_calibration
from asyneio.io.recording.inertial_units import check_units
from asyneio.types import INERTIAL_DTYPE
from tests.io.prophesee.files import event, high
from tests.io.small_files import FILES
from tests.io.validity import assert_valid

SECRET = b"content of another file, not for the user of this one" * 100

#: One column or table of each HDF5 layout.
_MEMBERS = {
    "asyneio hdf5": "events/x",
    "columns": "events/x",
    "m3ed": "prophesee/left/x",
    "mvsec": "davis/left/events",
    "prophesee hdf5": "CD/events",
    "v2e hdf5": "events",
}


def external_storage(file: h5py.File, where: str, other: Path) -> None:
    shape, dtype = file[where].shape, file[where].dtype
    del file[where]
    size = int(np.prod(shape)) * dtype.itemsize
    file.create_dataset(where, shape, dtype, external=[(str(other), 0, size)])


def virtual_dataset(file: h5py.File, where: str, other: Path) -> None:
    shape, dtype = file[where].shape, file[where].dtype
    del file[where]
    layout = h5py.VirtualLayout(shape, dtype)
    layout[:] = h5py.VirtualSource(str(other), "x", shape)
    file.create_virtual_dataset(where, layout)


def external_link(file: h5py.File, where: str, other: Path) -> None:
    del file[where]
    file[where] = h5py.ExternalLink("../" + other.name, "/x")


def soft_link(file: h5py.File, where: str, other: Path) -> None:
    file.move(where, "/moved")
    file[where] = h5py.SoftLink("/moved")


def dangling_link(file: h5py.File, where: str, other: Path) -> None:
    del file[where]
    file[where] = h5py.SoftLink("/../../../../etc/passwd")


def objects(file: h5py.File, where: str, other: Path) -> None:
    count = file[where].shape[0]
    del file[where]
    file.create_dataset(where, (count,), h5py.vlen_dtype(np.dtype("<u2")))


def references(file: h5py.File, where: str, other: Path) -> None:
    count = file[where].shape[0]
    del file[where]
    file.create_dataset(where, (count,), h5py.ref_dtype)


def absurd_size(file: h5py.File, where: str, other: Path) -> None:
    shape, dtype = file[where].shape, file[where].dtype
    del file[where]
    chunks = (2**14, *shape[1:])
    file.create_dataset(where, (10**13, *shape[1:]), dtype, chunks=chunks, compression="gzip")


def many_dimensions(file: h5py.File, where: str, other: Path) -> None:
    del file[where]
    file.create_dataset(where, (1,) * 20, "<f8")


@pytest.mark.parametrize("kind", _MEMBERS)
@pytest.mark.parametrize(
    "change",
    [external_storage, virtual_dataset, external_link, soft_link, dangling_link, objects, references,
     absurd_size, many_dimensions],
)  # fmt: skip
def test_hdf5(tmp_path: Path, kind: str, change: Callable[[h5py.File, str, Path], None]) -> None:
    """Every layout of HDF5 with every way out of the file."""
    folder = tmp_path / "recording"
    folder.mkdir()
    path = FILES[kind][0](folder / "x.h5")
    other = tmp_path / "secret"
    other.write_bytes(SECRET)
    with h5py.File(path, "r+") as file:
        change(file, _MEMBERS[kind], other)
    assert_rejected(lambda: open_recording(path))


def assert_rejected(read: Callable[[], object], match: str = ".", limit_bytes: int = 2**28) -> None:
    """An error with a message, which does not contain another file's content, in bounded memory."""
    tracemalloc.start()
    try:
        with pytest.raises(AsyneioError, match=match) as caught:
            read()
        assert tracemalloc.get_traced_memory()[1] < limit_bytes
    finally:
        tracemalloc.stop()
    assert "content of another file" not in str(caught.value)


@pytest.mark.slow
def test_gzip_bomb(tmp_path: Path) -> None:
    """40 MB of one line in 40 kB: an archive of events compresses five times."""
    path = tmp_path / "events.txt.gz"
    path.write_bytes(gzip.compress(b"0.5 1 2 1\n" * 4_000_000, mtime=0))
    assert_rejected(lambda: open_recording(path), "a ratio above 200")


def test_zip_with_paths_that_climb_out(tmp_path: Path) -> None:
    """Members are read in place and never written: `../` in their names has no effect."""
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    path = folder / "run.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../../events.txt", "0.5 1 2 1\n0.6 1 2 0\n")
        archive.writestr("/tmp/asyneio-climbed.txt", "x")
    try:
        assert_valid(open_recording(path))
    except RecordingError as error:
        assert str(error)  # noqa: PT017
    assert [entry.name for entry in tmp_path.rglob("*") if entry.is_file()] == ["run.zip"]
    assert not Path("/tmp/asyneio-climbed.txt").exists()


def test_zip_that_declares_too_little(tmp_path: Path) -> None:
    """The declared size is a hundredth of what is packed: reading stops there."""
    path = tmp_path / "run.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("events.txt", "0.5 1 2 1\n" * 1_000_000)
    data = bytearray(path.read_bytes())
    for magic, at in ((b"PK\3\4", 22), (b"PK\1\2", 24)):
        place = data.index(magic) + at
        data[place : place + 4] = struct.pack("<I", 1000)
    path.write_bytes(data)
    assert_rejected(lambda: open_recording(path), "damaged")


#: Each line is nine times the one before.
LAUGHS = "a: &a [x, x]\n" + "".join(
    f"{name}: &{name} [{','.join([f'*{before}'] * 9)}]\n" for before, name in pairwise("abcdefghi")
)


class Payload:
    """Unpickling it writes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (open, (str(self.path), "w"))


@pytest.mark.parametrize("packed", [False, True])
def test_pickles_are_not_executed(tmp_path: Path, packed: bool) -> None:
    path, written = tmp_path / "events", tmp_path / "written"
    array = np.array([Payload(written)] * 4, dtype=object)
    with path.open("wb") as stream:
        if packed:
            np.savez(stream, t=array, x=array, y=array, p=array)
        else:
            np.save(stream, array, allow_pickle=True)
    assert_rejected(lambda: open_recording(path))
    assert not written.exists()


@pytest.mark.parametrize("shape", ["(10000000000000, 4)", "(-4, 4)", "(4, 99999999999999999999)", "()"])
def test_npy_of_absurd_size(tmp_path: Path, shape: str) -> None:
    """Only rows that the file contains are read."""
    header = f"{{'descr': '<i8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (117 - len(header)) + b"\n"
    path = tmp_path / "x.npy"
    rows = np.array([[0, 1, 2, 1], [5, 1, 2, 0]], dtype="<i8").tobytes()
    path.write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header + rows)
    if shape.startswith("(10"):
        assert open_recording(path).events.size == 2
    else:
        assert_rejected(lambda: open_recording(path))


@pytest.mark.parametrize("end", ["", "(", "'shape': (3, 4", "}}", "\0", "  \\"])
def test_npy_header_that_does_not_end(tmp_path: Path, end: str) -> None:
    """NumPy tokenizes headers as Python and raises its errors."""
    header = f"{{'descr': '<i8', 'fortran_order': False, {end}".encode().ljust(118)
    for name, wrap in (("x.npy", False), ("x.npz", True)):
        path = tmp_path / name
        data = b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header + bytes(64)
        if wrap:
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("t.npy", data)
        else:
            path.write_bytes(data)
        assert_rejected(lambda path=path: open_recording(path), "expected arrays named t, x, y, p")


@pytest.mark.filterwarnings("error")
def test_readings_whose_norm_overflows() -> None:
    """Every third reading is finite, but its square is not."""
    gyroscope, accelerometer = np.zeros(100, INERTIAL_DTYPE), np.zeros(100, INERTIAL_DTYPE)
    gyroscope["t_ns"] = accelerometer["t_ns"] = 5_000_000 * np.arange(100)
    accelerometer["xyz"][:, 2], accelerometer["xyz"][::3, 0] = 9.81, 1e200
    gyroscope["xyz"][::3, 0] = 1e200
    with pytest.raises(RecordingError, match="exceeds 35 rad/s even as deg/s"):
        check_units(gyroscope, accelerometer, ())


@pytest.mark.parametrize("size", ["0x0", "-1x5", "99999999x99999999", "1e9x2", "65536x2", "9" * 5000 + "x1"])
def test_absurd_sensor_size(tmp_path: Path, size: str) -> None:
    """The size is ignored or rejected; no image of this size is allocated."""
    path = tmp_path / "x.raw"
    path.write_bytes(f"% evt 2.0\n% geometry {size}\n% end\n".encode() + high(64) + event(65) + event(66))
    tracemalloc.start()
    try:
        found = open_recording(path)
        assert_valid(found)
        assert found.width <= 1280
    except AsyneioError as error:
        assert str(error)  # noqa: PT017
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 2**28


@pytest.mark.parametrize("length", [2**31 - 1, -1, 0, -(2**31)])
def test_absurd_packet_lengths(tmp_path: Path, length: int) -> None:
    """AEDAT4: the length of a packet is checked against the file."""
    path = FILES["aedat4"][0](tmp_path / "x.aedat4")
    data = bytearray(path.read_bytes())
    place = data.index(b"EVTS", data.index(b"</dv>")) - 12
    data[place : place + 4] = struct.pack("<i", length)
    path.write_bytes(data)
    assert_rejected(lambda: open_recording(path))


def test_zstd_bomb(tmp_path: Path) -> None:
    """A compressed MCAP that unpacks to zeros without end."""
    path = tmp_path / "x.mcap.zstd"
    path.write_bytes(zstd.compress(b"\x89MCAP0\r\n" + bytes(2**26)))
    assert_rejected(lambda: open_recording(path), "a ratio above 200")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (LAUGHS, "aliases"),
        ("cam0: !!python/object/apply:os.system ['touch written']\n", "not valid YAML"),
        ("cam0: !!python/name:os.system\n", "not valid YAML"),
        ("? [[[[1]]]]\n: 1\n", "."),
        ("cam0: " + "{a: " * 400 + "\n", "."),
        ("cam0: " + "9" * 60_000 + "\n", "."),
    ],
)  # fmt: skip
def test_yaml(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=match):
        read_calibration(path, size=(240, 180))
    assert [entry.name for entry in tmp_path.iterdir()] == ["camchain.yaml"]


@pytest.mark.parametrize("where", ["../secret.yaml", "/etc/hostname", "a/../../secret.yaml", "", "\0"])
def test_calibration_that_refers_to_another_folder(tmp_path: Path, where: str) -> None:
    """VINS-Fusion names the files of its cameras."""
    (tmp_path / "secret.yaml").write_bytes(SECRET)
    folder = tmp_path / "rig"
    folder.mkdir()
    path = folder / "rig.yaml"
    path.write_text(f"%YAML:1.0\nimu: 1\nnum_of_cam: 1\ncam0_calib: {where!r}\n".replace("'\\x00'", '"\\0"'))
    assert_rejected(lambda: read_calibration(path, size=(240, 180)))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (LAUGHS, "uses more than 32 aliases"),
        ("a: " * 5 + "!!python/object/apply:os.system ['touch written']\n", "not valid YAML"),
        ("".join(" " * k + f"k{k}:\n" for k in range(60)), "nested more than 32 levels deep"),
        ("- " * 500 + "1\n", "nested more than 32 levels deep"),
        ("[" * 2000, "more than 1000 brackets"),
        ("# comment\n" * 10_000, "larger than 64 KiB"),
        ("window: {length_s: " + "9" * 5000 + "}\n", "."),
        ("window: \xff".encode("latin-1"), "not text in UTF-8"),
        (b"\0\0\0\0", "not valid YAML"),
    ],
)  # fmt: skip
def test_settings(tmp_path: Path, text: str | bytes, match: str) -> None:
    """The settings of a run are read with the same limits as a calibration."""
    path = tmp_path / "config.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError, match=match):
        load_config(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["config.yaml"]


def test_line_without_end(tmp_path: Path) -> None:
    """A trajectory of one line of 32 MB."""
    path = tmp_path / "groundtruth.txt"
    path.write_bytes(b"1 " * 2**24)
    assert_rejected(lambda: read_trajectory(path))


class NetworkUsedError(Exception):
    """The network was used."""


@pytest.fixture
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sockets and name look-ups raise an error that no reader handles."""

    def block(*_: object, **__: object) -> NoReturn:
        raise NetworkUsedError

    monkeypatch.setattr(socket, "socket", block)
    for name in ("create_connection", "getaddrinfo", "gethostbyname"):
        monkeypatch.setattr(socket, name, block)


def test_the_fixture_blocks(offline: None) -> None:
    with pytest.raises(NetworkUsedError):
        socket.create_connection(("localhost", 1))


@pytest.mark.parametrize("kind", FILES)
def test_reading_uses_no_network(tmp_path: Path, kind: str, offline: None) -> None:
    assert_valid(open_recording(FILES[kind][0](tmp_path / "x")))


@pytest.mark.parametrize("name", ["http://localhost/x.bag", "s3://bucket/x.h5", "file:///etc/hostname"])
def test_addresses_are_no_paths(name: str, offline: None) -> None:
    """An address is the name of a file that does not exist."""
    with pytest.raises(RecordingError, match="does not exist"):
        open_recording(name)
