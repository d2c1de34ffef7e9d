"""AEDAT-2.0: real recordings against a second decoder, damaged ones against the rules."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from asyneio.errors import RecordingError
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
    for text in ("2 frame word(s)", "1 external signal", "3 inertial word(s)", "3 byte(s) at the end"):
        assert text in notes


@pytest.mark.slow
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
        (b"#!AER-DAT2.0\r\n# and so on", "contains only a header"),
    ],
)
def test_other_headers(tmp_path: Path, header: bytes, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        open_recording(write(tmp_path, header=header))


def test_unnamed_camera(tmp_path: Path) -> None:
    found = open_recording(write(tmp_path, event(1), header=b"#!AER-DAT2.0\n"))
    assert any("assumed to be a DAVIS240" in note for note in found.notes)
