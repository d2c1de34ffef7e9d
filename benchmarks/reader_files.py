"""Files for the benchmark of readers: generated from one set of events, and real ones if available."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from asyneio.io.conversion.convert import Source, convert
from asyneio.io.conversion.targets import target_named
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, EventRecording, RecordArray

WIDTH, HEIGHT = 240, 180
_US = 1000


@dataclass(frozen=True)
class BenchmarkFile:
    """A file, its title, and other libraries (names in `reader_libraries`) that read it."""

    title: str
    path: Path
    libraries: tuple[str, ...]


def make_recording(count: int) -> EventRecording:
    """Events like those of a moving camera: bursts in rows, about one per microsecond, from 1 s on."""
    rng = np.random.default_rng(0)
    events = np.zeros(count, dtype=EVENT_DTYPE)
    events["t_ns"] = (1_000_000 + np.cumsum(rng.integers(0, 3, count))) * _US
    events["x"] = (rng.integers(0, WIDTH) + np.cumsum(rng.integers(-3, 4, count))) % WIDTH
    events["y"] = np.repeat(rng.integers(0, HEIGHT, -(-count // 4)), 4)[:count]
    events["p"] = rng.integers(0, 2, count)
    empty = np.empty(0, dtype=INERTIAL_DTYPE)
    return EventRecording("benchmark", events, WIDTH, HEIGHT, empty, empty)


def make_files(folder: Path, count: int, real: Path | None) -> list[BenchmarkFile]:
    """One file of each format that can be generated, then the real ones."""
    folder.mkdir(parents=True, exist_ok=True)
    recording = make_recording(count)
    files: list[BenchmarkFile] = []
    converted: list[tuple[str, str, tuple[str, ...]]] = [
        ("UZH text", "events.txt", ("pandas", "numpy loadtxt")),
        ("HDF5, ours", "x.h5", ("h5py columns",)),
        ("ROS 1 bag, EventArray", "x.bag", ("rosbags",)),
        ("ROS 2 MCAP, EventArray", "ros2", ("rosbags",)),
    ]
    for title, name, libraries in converted:
        output = folder if name == "events.txt" else folder / name
        named = "uzh" if output == folder else "rosbag2" if name == "ros2" else None
        target = target_named(named, output)
        convert(Source(recording), target, output, lambda done: None, force=True)
        files.append(BenchmarkFile(title, folder / name, libraries))
    written: list[tuple[str, str, Callable[[Path, RecordArray], None], tuple[str, ...]]] = [
        ("AEDAT-2.0", "x.aedat", write_aedat2, ()),
        ("Prophesee DAT", "x.dat", write_dat, ("expelliarmus DAT", "faery")),
        ("Prophesee EVT 2.0", "evt2.raw", write_evt2, ("expelliarmus EVT2", "faery", "evlib")),
        ("Prophesee EVT 3.0", "evt3.raw", write_evt3, ("expelliarmus EVT3", "faery", "evlib", "evt3")),
        ("DSEC (Blosc Zstd)", "dsec.h5", write_dsec, ("h5py columns", "evlib")),
        ("MVSEC", "mvsec.hdf5", write_mvsec, ("h5py MVSEC",)),
        ("M3ED (LZF)", "m3ed.h5", write_m3ed, ("h5py M3ED",)),
        ("AEDAT4 (LZ4)", "x.aedat4", write_aedat4, ("aedat", "dv-processing", "faery")),
    ]
    for title, name, write, libraries in written:
        if _made(write, folder / name, recording.events):
            files.append(BenchmarkFile(title, folder / name, libraries))
    if real is not None:
        files += [
            BenchmarkFile(f"real: {path.name}", path, libraries)
            for path, libraries in (
                (real / "slider_depth" / "events.txt", ("pandas",)),
                (real / "davis240_imu" / "IMU_rotDisk.aedat", ()),
                (real / "formats" / "dvxplorer_static.aedat4", ("aedat", "dv-processing")),
                (real / "formats" / "gen3.evt2.raw", ("expelliarmus EVT2", "faery", "evlib")),
                (real / "formats" / "event_packet_evt3.bag", ()),
            )
        ]
    return files


def _made(write: Callable[[Path, RecordArray], None], path: Path, events: RecordArray) -> bool:
    """Whether a file could be generated; prints a message if a library is missing."""
    try:
        write(path, events)
    except ImportError as error:
        print(f"{path.name} is skipped: {error}")
        return False
    return True


def write_aedat2(path: Path, events: RecordArray) -> None:
    """AEDAT-2.0 of a DAVIS240C: big-endian address and time [us]."""
    x, y, p = (events[name].astype(np.int64) for name in ("x", "y", "p"))
    address = (HEIGHT - 1 - y) << 22 | (WIDTH - 1 - x) << 12 | p << 11
    words = np.stack([address, events["t_ns"] // _US], axis=1).astype(">u4")
    header = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
    path.write_bytes(header + words.tobytes())


def write_dat(path: Path, events: RecordArray) -> None:
    """DAT of version 2: time [us], then column, row and polarity in one word."""
    x, y, p = (events[name].astype(np.int64) for name in ("x", "y", "p"))
    words = np.stack([events["t_ns"] // _US, p << 28 | y << 14 | x], axis=1).astype("<u4")
    header = f"% Data file containing CD events.\n% Version 2\n% Height {HEIGHT}\n% Width {WIDTH}\n"
    path.write_bytes(header.encode() + b"\x0c\x08" + words.tobytes())


def write_evt2(path: Path, events: RecordArray) -> None:
    """EVT 2.0: a high time whenever it changes, then the event."""
    t_us, x, y, p = (events[name].astype(np.int64) for name in ("t_ns", "x", "y", "p"))
    t_us //= _US
    words = np.stack([8 << 28 | t_us >> 6, p << 28 | (t_us & 0x3F) << 22 | x << 11 | y], axis=1)
    new_high = np.concatenate([[True], t_us[1:] >> 6 != t_us[:-1] >> 6])
    keep = np.stack([new_high, np.ones_like(new_high)], axis=1)
    header = f"% evt 2.0\n% format EVT2;height={HEIGHT};width={WIDTH}\n% geometry {WIDTH}x{HEIGHT}\n% end\n"
    path.write_bytes(header.encode() + words[keep].astype("<u4").tobytes())


def write_evt3(path: Path, events: RecordArray) -> None:
    """EVT 3.0 with single events: a time and a row if they change, and a column for each event."""
    t_us, y = events["t_ns"] // _US, events["y"].astype(np.int64)
    new_time = np.concatenate([[True], t_us[1:] != t_us[:-1]])
    new_high = np.concatenate([[True], t_us[1:] >> 12 != t_us[:-1] >> 12])
    new_row = np.concatenate([[True], y[1:] != y[:-1]])
    words = np.stack(
        [
            8 << 12 | (t_us >> 12 & 0xFFF),
            6 << 12 | (t_us & 0xFFF),
            y,
            2 << 12 | events["p"].astype(np.int64) << 11 | events["x"],
        ],
        axis=1,
    )
    keep = np.stack([new_high, new_time, new_row, np.ones_like(new_row)], axis=1)
    header = f"% evt 3.0\n% format EVT3;height={HEIGHT};width={WIDTH}\n% geometry {WIDTH}x{HEIGHT}\n% end\n"
    path.write_bytes(header.encode() + words[keep].astype("<u2").tobytes())


def write_dsec(path: Path, events: RecordArray) -> None:
    """The layout and the codec of the DSEC data set."""
    import hdf5plugin

    _columns(path, "events", events, "<u4", {**hdf5plugin.Blosc(cname="zstd")})
    with h5py.File(path, "r+") as file:
        file["t_offset"] = np.int64(0)


def write_mvsec(path: Path, events: RecordArray) -> None:
    """(N,4) float64."""
    columns = [events["x"], events["y"], events["t_ns"] * 1e-9, events["p"] * 2.0 - 1.0]
    with h5py.File(path, "w") as file:
        file["davis/left/events"] = np.stack(columns, axis=1)


def write_m3ed(path: Path, events: RecordArray) -> None:
    """Chunks of 40 000 with LZF, as in the tool of the data set."""
    _columns(path, "prophesee/left", events, "<i8", {"compression": "lzf", "chunks": (40_000,)})


def _columns(path: Path, group: str, events: RecordArray, time: str, options: dict[str, object]) -> None:
    with h5py.File(path, "w") as file:
        for name in ("x", "y", "p"):
            file.create_dataset(f"{group}/{name}", data=events[name], **options)
        file.create_dataset(f"{group}/t", data=(events["t_ns"] // _US).astype(time), **options)


def write_aedat4(path: Path, events: RecordArray) -> None:
    """Through dv-processing, in packets of 20 000."""
    import dv_processing

    settings = dv_processing.io.MonoCameraWriter.EventOnlyConfig("DAVIS346_benchmark", (WIDTH, HEIGHT))
    writer = dv_processing.io.MonoCameraWriter(str(path), settings)
    columns = [(events["t_ns"] // _US).tolist(), *(events[name].tolist() for name in ("x", "y"))]
    rows = list(zip(*columns, (events["p"] > 0).tolist(), strict=True))
    for start in range(0, len(rows), 20_000):
        store = dv_processing.EventStore()
        for row in rows[start : start + 20_000]:
            store.push_back(*row)
        writer.writeEvents(store)
