"""HDF5 of the data sets, made as their documentation and tools say; hostile and damaged ones refused."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asyneio.errors import AsyneioError, RecordingError
from asyneio.io import ReadOptions, open_recording, write_camchain, write_imu_noise
from asyneio.io.hdf5 import columns as hdf5_columns
from asyneio.io.open_recording import open_contents
from asyneio.types import EVENT_DTYPE, NS_PER_S, EventRecording, RecordArray
from tests.io.event_recordings import make_events
from tests.io.recordings import START_NS, make_calibration

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


def test_dsec(tmp_path: Path, rng: np.random.Generator) -> None:
    left, right = whole_us(rng, scale=2), whole_us(rng, scale=2)
    root = tmp_path / "interlaken_00_c"
    write_columns(root / "events" / "left" / "events.h5", left, EPOCH_US)
    write_columns(root / "events" / "right" / "events.h5", right, EPOCH_US)
    with h5py.File(root / "events" / "left" / "rectify_map.h5", "w") as file:
        file["rectify_map"] = np.zeros((4, 4, 2))
    for path, wanted, options in (
        (root, left, {}),
        (root, right, {"events": "right"}),
        (root / "events" / "right" / "events.h5", right, {}),
    ):
        found = read(path, **options)
        assert_events(found, wanted, EPOCH_US * 1000)
        assert (found.name, found.width, found.height) == ("interlaken_00_c", 640, 480)
        assert found.gyroscope.size == 0
        notes = " ".join(found.notes)
        assert "no inertial samples" in notes
        assert f"t_offset of {EPOCH_US} us" in notes
    assert any("left camera of left and right" in note for note in read(root).notes)
    with pytest.raises(RecordingError, match="no events of the camera 'top'; it has those of left and right"):
        read(root, events="top")


def test_vector(tmp_path: Path, rng: np.random.Generator) -> None:
    events = whole_us(rng, scale=2)
    write_columns(tmp_path / "desk_fast1.synced.left_event.hdf5", events, EPOCH_US)
    rows = [
        (f"{START_NS // 10**9 + k / 200:.9f}", 0.1, 0.2, 0.3, *GRAVITY, 1.0, 0.0, 0.0) for k in range(500)
    ]
    write_lines(tmp_path / "desk_fast1.synced.imu.txt", "# timestamp gx gy gz ax ay az mx my mz\n", rows)
    truth = [(f"{START_NS // 10**9 + k / 120:.9f}", 1, 2, 3, 0, 0, 0, 1) for k in range(200)]
    write_lines(tmp_path / "desk_fast1.synced.gt.txt", "# timestamp px py pz qx qy qz qw\n", truth)
    found = read(tmp_path)
    assert_events(found, events, EPOCH_US * 1000)
    assert (found.name, found.width, found.height) == ("desk_fast1", 640, 480)
    np.testing.assert_array_equal(found.gyroscope["xyz"][0], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    assert found.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.position[0], [1.0, 2.0, 3.0])
    write_columns(tmp_path / "robot.synced.left_event.hdf5", events, EPOCH_US)
    with pytest.raises(RecordingError, match="2 sequences: desk_fast1, robot; name a file"):
        read(tmp_path)
    assert read(tmp_path / "robot.synced.left_event.hdf5").gyroscope.size == 0


@pytest.mark.parametrize("sub", ["", "bike-easy-vi_gt_data"])
def test_tum_vie(tmp_path: Path, rng: np.random.Generator, sub: str) -> None:
    events = whole_us(rng, scale=4)
    write_columns(tmp_path / "bike-easy-events_left.h5", events)
    write_columns(tmp_path / "bike-easy-events_right.h5", whole_us(rng, scale=4))
    rows = [(f"{5000 * k + 0.25:.3f}", 0.1, 0.2, 0.3, *GRAVITY, 25.0) for k in range(500)]
    write_lines(tmp_path / sub / "imu_data.txt", "# timestamp[us] gx gy gz ax ay az temperature\n", rows)
    truth = [(f"{8333.25 * k:.3f}", 1, 2, 3, 0, 0, 0, 1) for k in range(200)]
    write_lines(tmp_path / sub / "mocap_data.txt", "# timestamp[us] px py pz qx qy qz qw\n", truth)
    found = read(tmp_path, events="left")
    assert_events(found, events)
    assert (found.name, found.width, found.height) == ("bike-easy", 1280, 720)
    np.testing.assert_array_equal(found.gyroscope["t_ns"][:2], [250, 5_000_250])
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    assert found.ground_truth is not None
    assert found.ground_truth.t_ns[1] == 8_333_250
    assert any("markers" in note for note in found.notes)


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


def test_mvsec(tmp_path: Path, rng: np.random.Generator) -> None:
    events = make_events(rng, 3000)
    write_mvsec(tmp_path / "indoor_flying1_data.hdf5", events)
    T_w_c, stamps = poses(rng, 50), START_NS * 1e-9 + np.arange(50) / 20
    with h5py.File(tmp_path / "indoor_flying1_gt.hdf5", "w") as file:
        file["davis/left/pose"], file["davis/left/pose_ts"] = T_w_c, stamps
    found = read(tmp_path)
    # A float64 of seconds since the epoch has steps of 238 ns.
    assert np.abs(found.events["t_ns"] - events["t_ns"]).max() <= 120
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(found.events[name], events[name])
    assert (found.width, found.height) == (346, 260)
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    np.testing.assert_array_equal(found.gyroscope["xyz"][0], [0.1, 0.2, 0.3])
    assert found.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.position, T_w_c[:, :3, 3])
    turned = Rotation.from_quat(found.ground_truth.quaternion).as_matrix()
    np.testing.assert_allclose(turned, T_w_c[:, :3, :3], atol=1e-12)
    assert any("those of the camera" in note for note in found.notes)
    right = read(tmp_path, events="right")
    np.testing.assert_array_equal(right.events["x"], events["x"] + 1)
    np.testing.assert_array_equal(right.gyroscope["xyz"][0], [0.1, 0.2, 1.3])
    assert right.ground_truth is None


def test_both_cameras_are_cached_apart(tmp_path: Path, rng: np.random.Generator) -> None:
    events = make_events(rng, 500)
    write_mvsec(tmp_path / "x.hdf5", events)
    for side, shift in (("left", 0), ("right", 1)) * 2:
        found = open_recording(tmp_path / "x.hdf5", ReadOptions(events=side), cache_from=0)
        assert isinstance(found, EventRecording)
        np.testing.assert_array_equal(found.events["x"], events["x"] + shift)


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


def test_m3ed(tmp_path: Path, rng: np.random.Generator) -> None:
    events = whole_us(rng, scale=4)
    T_left_imu, T_left_right = poses(rng, 2)
    path = tmp_path / "falcon_indoor_flight_1_data.h5"
    write_m3ed(path, events, T_left_imu, T_left_right)
    T_c_w = poses(rng, 40)
    with h5py.File(tmp_path / "falcon_indoor_flight_1_pose_gt.h5", "w") as file:
        file["Cn_T_C0"], file["Ln_T_L0"], file["ts"] = T_c_w, T_c_w, np.arange(40) * 50_000.0
    found = read(tmp_path)
    assert_events(found, events)
    assert found.gyroscope.size == found.accelerometer.size == 796
    assert any("left out 4 of 800 rows" in note for note in found.notes)
    assert found.camera is not None
    assert (found.camera.fx, found.camera.width, found.camera.coefficients[0]) == (1034.0, 1280, -0.09)
    assert found.calibration is None
    assert found.ground_truth is not None
    centres = np.linalg.inv(T_c_w)[:, :3, 3]
    np.testing.assert_allclose(found.ground_truth.position, centres, atol=1e-12)
    write_imu_noise(tmp_path / "imu.yaml", make_calibration().noise)
    for side, T_left_camera in (("left", np.eye(4)), ("right", T_left_right)):
        full = read(path, events=side)
        assert full.calibration is not None
        T_b_c = np.linalg.inv(T_left_imu) @ T_left_camera
        np.testing.assert_allclose(full.calibration.T_b_c, T_b_c, atol=1e-12)
    moved = read(path, events="left").ground_truth
    assert moved is not None
    T_w_b = np.linalg.inv(T_c_w) @ T_left_imu
    np.testing.assert_allclose(moved.position, T_w_b[:, :3, 3], atol=1e-12)


def test_unknown_origin(tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """The size is guessed from a look at some events, not from decoding all of them again and again."""
    events = whole_us(rng)
    events["x"] += 100
    decoded = []
    real = hdf5_columns.ColumnEvents.chunks
    monkeypatch.setattr(hdf5_columns.ColumnEvents, "chunks", lambda self: decoded.append(1) or real(self))  # type: ignore[func-returns-value]
    for group in ("events", "/"):
        write_columns(tmp_path / "mine.h5", events, 77, group)
        found = read(tmp_path / "mine.h5")
        assert_events(found, events, 77_000)
        assert (found.width, found.height) == (346, 260)
        notes = " ".join(found.notes)
        assert "columns t x y p; time in microseconds (as of DSEC)" in notes
        assert "taken to be 346 x 260" in notes
    assert len(decoded) == 2


def test_samples_beside_unknown_origin(tmp_path: Path, rng: np.random.Generator) -> None:
    write_columns(tmp_path / "mine.h5", whole_us(rng))
    rows = [(5_000_000 * k, 0.1, 0.2, 0.3, *GRAVITY) for k in range(400)]
    write_lines(tmp_path / "imu0" / "data.csv", "", [(",".join(map(str, row)),) for row in rows])
    found = read(tmp_path / "mine.h5")
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    assert any("gyroscope first, as gravity says; time in ns" in note for note in found.notes)
    other = [(0.005 * k, *GRAVITY, 0.4, 0.5, 0.6) for k in range(400)]
    write_lines(tmp_path / "other.txt", "", other)
    for name in (str(tmp_path / "other.txt"), "other.txt"):
        named = read(tmp_path / "mine.h5", samples=name)
        np.testing.assert_array_equal(named.gyroscope["xyz"][0], [0.4, 0.5, 0.6])
    with pytest.raises(RecordingError, match=r"no file nothing\.txt of inertial samples"):
        read(tmp_path / "mine.h5", samples="nothing.txt")


def test_table_of_prophesee(tmp_path: Path, rng: np.random.Generator) -> None:
    events = whole_us(rng, scale=4)
    table = np.empty(events.size, dtype=[("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    table["x"], table["y"], table["p"], table["t"] = (
        events["x"],
        events["y"],
        events["p"],
        events["t_ns"] // 1000,
    )
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        file.create_dataset("CD/events", data=table, chunks=(512,))
        file.attrs["geometry"] = "1280x720"
    found = read(tmp_path / "x.hdf5")
    assert_events(found, events)
    assert (found.width, found.height) == (1280, 720)


def test_codec_of_prophesee_is_named(tmp_path: Path) -> None:
    """A data set compressed by a filter that is nowhere installed."""
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        table = np.zeros(10, dtype=[("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
        space = h5py.h5s.create_simple((10,), (h5py.h5s.UNLIMITED,))
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((10,))
        properties.set_filter(36559, h5py.h5z.FLAG_OPTIONAL, ())
        file.create_group("CD")
        kind = h5py.h5t.py_create(table.dtype, logical=True)
        h5py.h5d.create(file["CD"].id, b"events", kind, space, properties)
    with pytest.raises(RecordingError, match="Prophesee's ECF codec, which is not installed"):
        read(tmp_path / "x.hdf5")


def test_blosc(tmp_path: Path, rng: np.random.Generator) -> None:
    """As DSEC publishes its files; the codecs come with the extra `h5`."""
    events = whole_us(rng)
    for codec in (hdf5plugin.Blosc(cname="zstd"), hdf5plugin.Zstd()):
        write_columns(tmp_path / "x.h5", events, 0, **codec)
        assert_events(read(tmp_path / "x.h5"), events)


def test_missing_codec_names_the_extra(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_columns(tmp_path / "x.h5", whole_us(rng), 0, **hdf5plugin.Blosc())
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda number: number < 32000)
    with pytest.raises(RecordingError, match=r"compressed by Blosc.*pip install 'asyneio\[h5\]'"):
        read(tmp_path / "x.h5")


def test_memory_is_bounded(tmp_path: Path) -> None:
    """Three million events, 48 MB decoded: a few blocks of them are in memory at a time."""
    events = np.zeros(3_000_000, dtype=EVENT_DTYPE)
    events["t_ns"] = np.arange(events.size) * 1000
    write_columns(tmp_path / "x.h5", events, 5)
    source = open_contents(tmp_path / "x.h5", ReadOptions()).decode()
    tracemalloc.start()
    count = sum(piece.size for piece, _ in source.chunks())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == events.size
    assert peak < 16 * 2**20


def test_no_events(tmp_path: Path, rng: np.random.Generator) -> None:
    for name in ("t", "x", "y", "p"):
        with h5py.File(tmp_path / "x.h5", "a") as file:
            file[f"events/{name}"] = np.zeros(0, dtype="<u4")
    write_mvsec(tmp_path / "y.hdf5", make_events(rng, 10)[:0])
    for path in ("x.h5", "y.hdf5"):
        with pytest.raises(RecordingError, match="holds no event"):
            read(tmp_path / path)


def test_blocks_do_not_matter(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hdf5_columns, "BLOCK_EVENTS", 333)
    events = whole_us(rng)
    write_columns(tmp_path / "x.h5", events, 5)
    assert_events(read(tmp_path / "x.h5"), events, 5000)
    stamped = make_events(rng, 1000)
    write_mvsec(tmp_path / "y.hdf5", stamped)
    assert np.abs(read(tmp_path / "y.hdf5").events["t_ns"] - stamped["t_ns"]).max() <= 120


def external_link(file: h5py.File) -> None:
    del file["events/x"]
    file["events/x"] = h5py.ExternalLink("other.h5", "/x")


def soft_link_of_the_group(file: h5py.File) -> None:
    file.move("events", "moved")
    file["events"] = h5py.SoftLink("/moved")


def linked_offset(file: h5py.File) -> None:
    del file["t_offset"]
    file["t_offset"] = h5py.ExternalLink("other.h5", "/x")


def huge_offset(file: h5py.File) -> None:
    del file["t_offset"]
    file["t_offset"] = np.uint64(2**63)


def offset_of_text(file: h5py.File) -> None:
    del file["t_offset"]
    file["t_offset"] = "now"


def short(file: h5py.File) -> None:
    del file["events/y"]
    file["events/y"] = np.zeros(7, dtype="<u2")


def absurd_stamps(file: h5py.File) -> None:
    count = file["events/t"].shape[0]
    del file["events/t"]
    file["events/t"] = np.full(count, 2**64 - 1, dtype="<u8")


def bomb(file: h5py.File) -> None:
    for name in ("t", "x", "y", "p"):
        del file[f"events/{name}"]
        file.create_dataset(f"events/{name}", (10**14,), "<u4", chunks=(2**16,), compression="gzip")


@pytest.mark.parametrize(
    "change",
    [external_link, soft_link_of_the_group, linked_offset, huge_offset, offset_of_text, short,
     absurd_stamps, bomb],
)  # fmt: skip
def test_refused(tmp_path: Path, rng: np.random.Generator, change: Callable[[h5py.File], None]) -> None:
    path = tmp_path / "x.h5"
    write_columns(path, whole_us(rng), 0)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(3000, dtype="<u2")
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(RecordingError):
        read(path)


@pytest.mark.parametrize("name", ["davis/left/imu", "davis/left/imu_ts", "davis/left/events"])
@pytest.mark.parametrize("what", ["link", "shape", "text"])
def test_mvsec_refused(tmp_path: Path, rng: np.random.Generator, name: str, what: str) -> None:
    path = tmp_path / "x.hdf5"
    write_mvsec(path, make_events(rng, 100))
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = {
            "link": h5py.ExternalLink("other.h5", "/x"),
            "shape": np.zeros((3, 3)),
            "text": "none",
        }[what]
    with pytest.raises(RecordingError):
        read(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300, -1e300])
def test_mvsec_absurd_numbers(tmp_path: Path, rng: np.random.Generator, bad: float) -> None:
    """An absurd coordinate is an event outside the sensor; an absurd stamp or polarity is refused."""
    path = tmp_path / "x.hdf5"
    events = make_events(rng, 1000)
    write_mvsec(path, events)
    with h5py.File(path, "r+") as file:
        file["davis/left/events"][5, 0] = bad
    assert any("dropped 1 event(s) outside" in note for note in read(path).notes)
    for column in (2, 3):
        write_mvsec(path, events)
        with h5py.File(path, "r+") as file:
            file["davis/left/events"][5, column] = bad
        with pytest.raises(RecordingError):
            read(path)


@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_damage(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever bytes change, the file is read or refused in words."""
    path = tmp_path / "x.h5"
    rng = np.random.default_rng(1)
    kind = data.draw(st.sampled_from(["mvsec", "m3ed", "columns"]))
    if kind == "mvsec":
        write_mvsec(path, make_events(rng, 50), 20)
    elif kind == "m3ed":
        write_m3ed(path, whole_us(rng, 50), np.eye(4), np.eye(4))
    else:
        write_columns(path, whole_us(rng, 50), 7)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(8, len(content)))])
    try:
        open_recording(path)
    except AsyneioError:
        return


def test_calibration_beside(tmp_path: Path, rng: np.random.Generator) -> None:
    """A lens found beside events of unknown origin gives the size as well."""
    calibration = make_calibration()
    write_camchain(tmp_path / "camchain-imucam.yaml", calibration)
    write_imu_noise(tmp_path / "imu.yaml", calibration.noise)
    write_columns(tmp_path / "mine.h5", whole_us(rng))
    found = read(tmp_path / "mine.h5")
    assert found.calibration is not None
    assert (found.width, found.height) == (240, 180)
    assert found.events["t_ns"][-1] < 3 * NS_PER_S
