"""A small valid file of every format, for tests that damage it."""

from __future__ import annotations

import gzip
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from asyneio.io import write_events_hdf5
from asyneio.types import EventRecording
from tests.io.aedat.packets import EVENTS, IMU, aedat4_file, event_packet, imu_packet
from tests.io.aedat.writer import write_aedat2
from tests.io.event_recordings import make_event_recording, make_events
from tests.io.hdf5.layouts import whole_us, write_columns, write_m3ed, write_mvsec
from tests.io.prophesee.test_evt21 import evt21
from tests.io.prophesee.writers import write_dat, write_evt2
from tests.io.ros.bags import recording_records, write_bag
from tests.io.test_event_stream import event_stream


def small_recording() -> EventRecording:
    """Forty events and forty samples at whole microseconds from 0."""
    made = make_event_recording(np.random.default_rng(1), 40)
    events, streams = made.events.copy(), [made.gyroscope[:40].copy(), made.accelerometer[:40].copy()]
    first_ns = min(int(events["t_ns"][0]), int(streams[0]["t_ns"][0]))
    for rows in (events, *streams):
        rows["t_ns"] = (rows["t_ns"] - first_ns) // 1000 * 1000
    return replace(made, events=events, gyroscope=streams[0], accelerometer=streams[1], ground_truth=None)


def make_zip(path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("run/events.txt", "".join(f"0.{k:03d} {k % 240} 5 1\n" for k in range(100)))
        archive.writestr("run/imu.txt", "".join(f"0.{5 * k:03d} 0 0 9.8 0 0 0\n" for k in range(20)))
    return path


def make_text(path: Path) -> Path:
    path.write_text("".join(f"0.{k:03d} {k % 240} 5 {k % 2}\n" for k in range(50)))
    return path


def make_aedat4(path: Path) -> Path:
    return aedat4_file(path, (0, event_packet(*EVENTS)), (1, imu_packet(*IMU[:9])))


def make_hdf5(path: Path) -> Path:
    write_events_hdf5(small_recording(), path)
    return path


def make_mvsec(path: Path) -> Path:
    write_mvsec(path, make_events(np.random.default_rng(1), 50), 20)
    return path


def make_m3ed(path: Path) -> Path:
    write_m3ed(path, whole_us(np.random.default_rng(1), 50), np.eye(4), np.eye(4))
    return path


def make_columns(path: Path) -> Path:
    write_columns(path, whole_us(np.random.default_rng(1), 50), 7)
    return path


def make_bag(ros: int, packing: str = "", storage: str = "mcap") -> Callable[[Path], Path]:
    def make(path: Path) -> Path:
        write_bag(path, ros, recording_records(small_recording(), length=10), packing, storage)
        return path if ros == 1 else path / f"{path.name}.{'db3' if storage == 'sqlite3' else 'mcap'}"

    return make


def event_columns(count: int = 60) -> np.ndarray:
    """Columns t [us], x, y, p, int64; times are distinct."""
    rng = np.random.default_rng(2)
    t = 1000 + np.cumsum(rng.integers(1, 3000, count))
    columns = [t, rng.integers(0, 240, count), rng.integers(0, 180, count), rng.integers(0, 2, count)]
    return np.stack(columns, axis=1)


def make_csv(path: Path) -> Path:
    rows = (f"{x},{y},{p},{t}\n" for t, x, y, p in event_columns().tolist())
    path.write_text("x,y,polarity,timestamp[us]\n" + "".join(rows))
    return path


def make_gzip(path: Path) -> Path:
    content = make_text(path).read_bytes()
    path.write_bytes(gzip.compress(content, mtime=0))
    return path


def make_numpy(packed: bool) -> Callable[[Path], Path]:
    def make(path: Path) -> Path:
        t, x, y, p = event_columns().T
        with path.open("wb") as stream:
            if packed:
                np.savez(stream, t=t, x=x.astype("u2"), y=y.astype("u2"), p=p.astype(bool))
            else:
                np.save(stream, event_columns())
        return path

    return make


def make_event_stream(atis: bool) -> Callable[[Path], Path]:
    def make(path: Path) -> Path:
        path.write_bytes(event_stream(event_columns(), atis))
        return path

    return make


def make_evt21(path: Path) -> Path:
    path.write_bytes(evt21(event_columns(), False, ""))
    return path


def make_evt3(path: Path) -> Path:
    """EVT 3.0 with single events: the high part of a time, its low part, the row, the column."""
    words: list[int] = []
    for t, x, y, p in event_columns().tolist():
        words += [8 << 12 | t >> 12 & 0xFFF, 6 << 12 | t & 0xFFF, y, 2 << 12 | p << 11 | x]
    header = b"% evt 3.0\n% format EVT3;height=180;width=240\n% end\n"
    path.write_bytes(header + np.array(words, dtype="<u2").tobytes())
    return path


def make_prophesee_hdf5(path: Path) -> Path:
    t, x, y, p = event_columns().T
    table = np.empty(t.size, dtype=[("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    table["x"], table["y"], table["p"], table["t"] = x, y, p, t
    with h5py.File(path, "w") as file:
        file.create_dataset("CD/events", data=table, chunks=(16,))
        file.attrs["geometry"] = "240x180"
    return path


def make_table(path: Path) -> Path:
    """As v2e writes it."""
    t, x, y, p = event_columns().T
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "events", data=np.stack([t, x, y, 2 * p - 1], 1).astype("<i8"), compression="gzip"
        )
    return path


#: A small valid file of each format, and how many bytes at its start stay as they are.
FILES: dict[str, tuple[Callable[[Path], Path], int]] = {
    "aedat2": (lambda path: write_aedat2(path, small_recording()), 14),
    "aedat4": (make_aedat4, 14),
    "asyneio hdf5": (make_hdf5, 0),
    "bag": (make_bag(1), 0),
    "bag, bz2": (make_bag(1, "bz2"), 0),
    "bag, lz4": (make_bag(1, "lz4"), 0),
    "columns": (make_columns, 0),
    "dat": (lambda path: write_dat(path, small_recording()), 0),
    "evt2": (lambda path: write_evt2(path, small_recording()), 0),
    "m3ed": (make_m3ed, 0),
    "mcap": (make_bag(2), 0),
    "mcap, zstd": (make_bag(2, "storage"), 0),
    "mvsec": (make_mvsec, 0),
    "sqlite": (make_bag(2, "", "sqlite3"), 0),
    "text": (make_text, 0),
    "csv": (make_csv, 0),
    "event stream": (make_event_stream(False), 0),
    "event stream, ATIS": (make_event_stream(True), 0),
    "evt2.1": (make_evt21, 0),
    "evt3": (make_evt3, 0),
    "gzip": (make_gzip, 0),
    "npy": (make_numpy(False), 0),
    "npz": (make_numpy(True), 0),
    "prophesee hdf5": (make_prophesee_hdf5, 0),
    "v2e hdf5": (make_table, 0),
    "zip": (make_zip, 0),
}


#: Valid texts of the files beside a recording, by what reads them.
TEXTS: dict[str, tuple[str, ...]] = {
    "calibration": (
        "cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n"
        "  distortion_coeffs: [-0.37, 0.15, -0.0003, -0.0007]\n  intrinsics: [199.1, 198.7, 120.3, 90.9]\n"
        "  resolution: [240, 180]\n  T_cam_imu:\n  - [1.0, 0.0, 0.0, 0.01]\n  - [0.0, 1.0, 0.0, 0.0]\n"
        "  - [0.0, 0.0, 1.0, 0.0]\n  - [0.0, 0.0, 0.0, 1.0]\n  timeshift_cam_imu: -0.001\n",
        "%YAML:1.0\n---\nmodel_type: PINHOLE\ncamera_name: camera\nimage_width: 240\nimage_height: 180\n"
        "distortion_parameters:\n   k1: -0.3\n   k2: 0.1\n   p1: 0.0\n   p2: 0.0\n"
        "projection_parameters:\n   fx: 199.0\n   fy: 199.0\n   cx: 120.0\n   cy: 90.0\n"
        "body_T_cam0: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n"
        "   data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n",
        '{"value0": {"T_imu_cam": [{"px": 0.1, "py": 0.0, "pz": 0.0, "qx": 0, "qy": 0, "qz": 0, "qw": 1}],'
        ' "intrinsics": [{"camera_type": "kb4", "intrinsics": {"fx": 199, "fy": 199, "cx": 120, "cy": 90,'
        ' "k1": 0.1, "k2": 0.0, "k3": 0.0, "k4": 0.0}}], "resolution": [[240, 180]], "imu_update_rate": 200,'
        ' "accel_noise_std": [0.01, 0.01, 0.01], "gyro_noise_std": [0.001, 0.001, 0.001],'
        ' "accel_bias_std": [0.001, 0.001, 0.001], "gyro_bias_std": [0.0001, 0.0001, 0.0001]}}',
    ),
    "inertial": (
        "".join(f"{0.005 * k:.3f} 0.01 0.02 9.81 0.001 0.002 0.003\n" for k in range(20)),
        "#timestamp [ns],w_x [rad s^-1],w_y,w_z,a_x [m s^-2],a_y,a_z\n"
        + "".join(f"{1_600_000_000_000_000_000 + 5_000_000 * k},0.1,0.2,0.3,0,0,9.81\n" for k in range(20)),
        "t[us];gyro_x_dps;gyro_y_dps;gyro_z_dps;accel_x[g];accel_y[g];accel_z[g]\n"
        + "".join(f"{5000 * k};1,5;2,5;3,5;0,01;0,02;0,98\n" for k in range(20)),
    ),
    "trajectory": (
        "".join(f"{0.1 * k:.1f} {0.2 * k:.2f} 0 0 0 0 0 1\n" for k in range(20)),
        "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z\n"
        + "".join(f"{1_600_000_000_000_000_000 + 5_000_000 * k},0.1,0.2,0.3,1,0,0,0\n" for k in range(20)),
        "".join(f"1 0 0 {0.1 * k:.1f} 0 1 0 0 0 0 1 0\n" for k in range(20)),
    ),
}
