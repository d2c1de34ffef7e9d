"""HDF5 files of the data sets, written as their documentation and tools describe."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.io import ReadOptions, open_recording
from asyneio.types import NS_PER_S, EventRecording, RecordArray
from tests.io.event_recordings import make_events
from tests.io.recordings import START_NS

EPOCH_US = START_NS // 1000

GRAVITY = np.array([0.0, 0.0, 9.81])


def whole_us(rng: np.random.Generator, count: int = 3000, scale: int = 1) -> RecordArray:
    """Events at whole microseconds from zero, coordinates up to `scale` times those of a DAVIS240."""
    events = make_events(rng, count)
    events["t_ns"] = (events["t_ns"] - START_NS) // 1000 * 1000
    events["x"] *= scale
    events["y"] *= scale
    return events


def read(path: Path, **options: Any) -> EventRecording:
    found = open_recording(path, ReadOptions(**options))
    assert isinstance(found, EventRecording)
    return found


def assert_events(found: EventRecording, wanted: RecordArray, offset_ns: int = 0) -> None:
    np.testing.assert_array_equal(found.events["t_ns"], wanted["t_ns"] + offset_ns)
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(found.events[name], wanted[name])


def write_columns(
    path: Path, events: RecordArray, offset_us: int | None = None, group: str = "events", **options: Any
) -> None:
    """As DSEC: uint32 us, uint16 pixels, uint8 polarity, chunks, an index by milliseconds."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        t_us = events["t_ns"] // 1000
        columns = {"t": t_us.astype("<u4"), "x": events["x"], "y": events["y"], "p": events["p"]}
        for name, values in columns.items():
            file.create_dataset(f"{group}/{name}", data=values, chunks=(min(50_000, events.size),), **options)
        file["ms_to_idx"] = np.searchsorted(t_us, np.arange(0, t_us[-1] // 1000) * 1000).astype("<u8")
        if offset_us is not None:
            file["t_offset"] = np.int64(offset_us)


def write_lines(path: Path, header: str, rows: list[tuple[object, ...]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(header + "".join(" ".join(map(str, row)) + "\n" for row in rows))


def poses(rng: np.random.Generator, count: int) -> np.ndarray:
    """Rigid transforms (count,4,4) all over the place."""
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.random(count, random_state=3).as_matrix()
    T[:, :3, 3] = rng.uniform(-2.0, 2.0, (count, 3))
    return T


def write_mvsec(path: Path, events: RecordArray, rows: int = 400) -> None:
    stamps = START_NS * 1e-9 + np.arange(rows) / 200
    with h5py.File(path, "w") as file:
        for side, shift in (("left", 0), ("right", 1)):
            # As ROS does: whole seconds and the rest, in one float64.
            t = events["t_ns"] // NS_PER_S + events["t_ns"] % NS_PER_S / NS_PER_S
            columns = [events["x"] + shift, events["y"], t, events["p"] * 2.0 - 1.0]
            file[f"davis/{side}/events"] = np.stack(columns, axis=1).astype("<f8")
            file[f"davis/{side}/imu"] = np.tile([0.0, 0.0, 9.81, 0.1, 0.2, 0.3 + shift], (rows, 1))
            file[f"davis/{side}/imu_ts"] = stamps


def write_m3ed(path: Path, events: RecordArray, T_left_imu: np.ndarray, T_left_right: np.ndarray) -> None:
    with h5py.File(path, "w") as file:
        for side, T in (("left", np.eye(4)), ("right", T_left_right)):
            group = file.create_group(f"prophesee/{side}")
            for name, values in (
                ("t", (events["t_ns"] // 1000).astype("<i8")),
                ("x", events["x"]),
                ("y", events["y"]),
                ("p", events["p"].astype("i1")),
            ):
                group.create_dataset(name, data=values, chunks=(min(400, events.size),), compression="lzf")
            group["ms_map_idx"] = np.zeros(3, dtype="<u8")
            calib = group.create_group("calib")
            calib["camera_model"], calib["distortion_model"] = "pinhole", "radtan"
            calib["intrinsics"] = np.array([1034.0, 1033.0, 629.0, 358.0])
            calib["distortion_coeffs"] = np.array([-0.09, 0.1, 1e-4, 2e-4])
            calib["resolution"] = np.array([1280, 720])
            calib["T_to_prophesee_left"] = T
        t = np.arange(800) * 2500
        accel, omega = np.tile(GRAVITY, (800, 1)), np.tile([0.1, 0.2, 0.3], (800, 1))
        accel[16:20] = omega[16:20] = np.nan
        t[16:20] = 0
        file["ovc/imu/ts"], file["ovc/imu/accel"], file["ovc/imu/omega"] = t, accel, omega
        file["ovc/imu/calib/T_to_prophesee_left"] = T_left_imu
