"""AEDAT4: real recordings against an independent decoder, damaged ones against the rules."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import aedat
import numpy as np
import pytest

from asyneio.errors import CalibrationError, RecordingError
from asyneio.io import open_recording
from tests.io.aedat.packets import EVENTS, IMU, aedat4_file, buffer, event_packet, imu_packet
from tests.io.validity import assert_valid, valid_or_rejected


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
    assert any("truncated after" in note for note in found.notes)


def test_aedat4_damaged_header(data_dir: Path, tmp_path: Path) -> None:
    """Changed bytes in the header of a real file."""
    data = (data_dir / "formats" / "davis346_static.aedat4").read_bytes()
    path = tmp_path / "bad.aedat4"
    generator = np.random.default_rng(5)
    for _ in range(20):
        changed = bytearray(data[:20_000])
        for position in generator.integers(14, 3000, 5):
            changed[position] = generator.integers(128, 256)
        path.write_bytes(changed)
        valid_or_rejected(lambda: open_recording(path), assert_valid)


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
    assert any("already in m/s^2" in note for note in found.notes)
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
        with pytest.raises(RecordingError, match=r"AEDAT4|unknown format"):
            open_recording(path)


@pytest.mark.parametrize(
    ("packets", "message"),
    [
        ([(1, imu_packet(*IMU))], "contains no events"),
        ([(0, b"short")], "cannot be decompressed"),
        ([(0, struct.pack("<II", 8, 2**31) + b"EVTS")], "outside its packet"),
        ([(0, imu_packet(*IMU))], "a packet of type b'IMUS' in a stream of type EVTS"),
        (
            [(0, buffer(b"EVTS", {0: struct.pack("<I", 4)}, struct.pack("<I", 2**32 - 1)))],
            "outside its packet",
        ),
        ([(0, event_packet((2**62, 1, 1, 1)))], "out of range"),
        ([(0, event_packet((-(2**63), 1, 1, 1)))], "out of range"),
    ],
)
def test_aedat4_refused(tmp_path: Path, packets: list[tuple[int, bytes]], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        open_recording(aedat4_file(tmp_path / "x.aedat4", *packets))


def test_calibration_of_another_sensor(data_dir: Path, tmp_path: Path) -> None:
    shutil.copy(data_dir / "formats" / "davis346_static.aedat4", tmp_path)
    for name in ("camchain-imucam.yaml", "imu.yaml"):
        shutil.copy(data_dir / "davis240_imu" / name, tmp_path)
    with pytest.raises(
        CalibrationError, match="240 x 180 pixels, but davis346_static was recorded with 346 x 260"
    ):
        open_recording(tmp_path / "davis346_static.aedat4")
