"""Every format that can be written: there and back, refusals, interruptions."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from asyneio.io.conversion import resumable
from asyneio.io.conversion.convert import Source, Target, convert, from_zero
from asyneio.io.conversion.targets import TARGETS, target_named
from asyneio.io.prophesee.evt2_writer import evt2_words
from asyneio.types import EVENT_DTYPE, EventRecording, RecordArray
from tests.io.event_recordings import assert_same, make_event_recording

BY_NAME = {target.name: target for target in TARGETS}
ENDINGS = {"uzh": "", "uzh-zip": ".zip", "hdf5": ".h5", "dat": ".dat", "evt2": ".raw", "aedat2": ".aedat"}
RESUMED = ("uzh", "dat", "evt2", "aedat2")


@pytest.fixture
def recording(rng: np.random.Generator) -> EventRecording:
    return make_event_recording(rng, 3000)


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("resumable", "convert"):
        monkeypatch.setattr(f"asyneio.io.conversion.{module}.PIECE_EVENTS", 100)
    monkeypatch.setattr(resumable, "PIECES_PER_ENTRY", 3)


def nothing(done: int) -> None:
    """An advance that nobody looks at."""


def source_of(recording: EventRecording, target: Target) -> Source:
    """As `--from-zero --round` make it."""
    return Source(recording, from_zero(recording), target.limits.step_ns)


def read(path: Path) -> EventRecording:
    found = open_recording(path)
    assert isinstance(found, EventRecording)
    return found


def assert_events(found: RecordArray, wanted: RecordArray) -> None:
    for name in ("t_ns", "x", "y", "p"):
        np.testing.assert_array_equal(found[name], wanted[name])


def content(target: Target, path: Path) -> bytes:
    """The bytes of the output that says that all is whole."""
    return target.outputs(path)[-1].read_bytes()


@pytest.mark.parametrize("name", ["uzh", "uzh-zip", "hdf5"])
def test_nothing_is_lost(tmp_path: Path, recording: EventRecording, name: str, small_pieces: None) -> None:
    path = tmp_path / f"out{ENDINGS[name]}"
    convert(Source(recording), BY_NAME[name], path, nothing)
    assert_same(read(path), recording)
    assert BY_NAME[name].lost(recording) == ()


def test_rosbag(tmp_path: Path, recording: EventRecording) -> None:
    """Events, samples, poses and lens go in and come back; extrinsics and noise do not, and that is said."""
    target = target_named(None, tmp_path / "x.bag")
    done: list[int] = []
    convert(Source(recording), target, tmp_path / "x.bag", done.append)
    assert done[-1] == recording.events.size
    found = read(tmp_path / "x.bag")
    assert_events(found.events, recording.events)
    for sensor in ("gyroscope", "accelerometer"):
        np.testing.assert_array_equal(getattr(found, sensor), getattr(recording, sensor))
    assert found.camera == recording.camera
    assert found.calibration is None
    assert found.ground_truth is not None
    assert recording.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.position, recording.ground_truth.position)
    assert any("extrinsics, time shift and IMU noise" in lost for lost in target.lost(recording))
    with pytest.raises(RecordingError, match="neither --round nor --from-zero"):
        convert(source_of(recording, target), target, tmp_path / "y.bag", nothing)
    with pytest.raises(StopError):
        convert(Source(recording), target, tmp_path / "z.bag", stop_after(1))
    assert [entry.name for entry in tmp_path.iterdir()] == ["x.bag"]


@pytest.mark.parametrize("name", ["dat", "evt2", "aedat2"])
def test_events_and_back(tmp_path: Path, recording: EventRecording, name: str, small_pieces: None) -> None:
    """Rounded to microseconds once, every event comes back the same, through any format and another."""
    target = BY_NAME[name]
    source = source_of(recording, target)
    first, second = tmp_path / f"first{ENDINGS[name]}", tmp_path / "second.h5"
    convert(source, target, first, nothing)
    found = read(first)
    assert_events(found.events, source.events(0, recording.events.size))
    assert (found.width, found.height) == (240, 180)
    convert(Source(found), BY_NAME["hdf5"], second, nothing)
    assert_same(read(second), found)
    third = tmp_path / f"third{ENDINGS[name]}"
    convert(Source(read(second)), target, third, nothing)
    assert third.read_bytes() == first.read_bytes()
    assert "calibration" in " ".join(target.lost(recording))


def test_samples_in_aedat2(tmp_path: Path, recording: EventRecording) -> None:
    target = BY_NAME["aedat2"]
    source = source_of(recording, target)
    convert(source, target, tmp_path / "x.aedat", nothing)
    found, wanted = read(tmp_path / "x.aedat"), source.rest()
    for sensor, half in (("gyroscope", np.pi / 180 / 32.8 / 2), ("accelerometer", 9.80665 / 4096 / 2)):
        np.testing.assert_array_equal(getattr(found, sensor)["t_ns"], getattr(wanted, sensor)["t_ns"])
        error = np.abs(getattr(found, sensor)["xyz"] - getattr(wanted, sensor)["xyz"])
        assert error.max() <= half * (1 + 1e-9)
    assert any("rounded to 1/4096 g" in lost for lost in target.lost(recording))
    wild = replace(recording, gyroscope=recording.gyroscope.copy())
    wild.gyroscope["xyz"][5] = 18.0
    assert any("1 inertial sample(s) beyond" in lost for lost in target.lost(wild))
    odd = replace(recording, gyroscope=recording.gyroscope[::2])
    with pytest.raises(RecordingError, match="their times differ; write HDF5"):
        convert(source_of(odd, target), target, tmp_path / "y.aedat", nothing)


@pytest.mark.parametrize("name", ["IMU_rotDisk", "IMU_translBoxes"])
def test_real_davis240(data_dir: Path, tmp_path: Path, name: str) -> None:
    """Real events with their IMU to AEDAT-2.0, text and HDF5: bit for bit the same."""
    real = read(data_dir / "davis240_imu" / f"{name}.aedat")
    for kind in ("aedat2", "hdf5", "uzh"):
        path = tmp_path / f"{name}{ENDINGS[kind]}"
        convert(Source(real), BY_NAME[kind], path, nothing)
        found = read(path)
        assert_events(found.events, real.events)
        for sensor in ("gyroscope", "accelerometer"):
            np.testing.assert_array_equal(getattr(found, sensor), getattr(real, sensor))


def test_real_evt2(data_dir: Path, tmp_path: Path) -> None:
    real = read(data_dir / "formats" / "gen3.evt2.raw")
    for kind in ("evt2", "dat", "hdf5"):
        path = tmp_path / f"x{ENDINGS[kind]}"
        convert(Source(real), BY_NAME[kind], path, nothing)
        found = read(path)
        assert_events(found.events, real.events)
        assert (found.width, found.height) == (640, 480)


def test_real_aedat4(data_dir: Path, tmp_path: Path) -> None:
    """Stamps of the Unix epoch fit no 32 bits of microseconds: moved to zero they do."""
    real = read(data_dir / "formats" / "dvxplorer_static.aedat4")
    target = BY_NAME["dat"]
    with pytest.raises(RecordingError, match=r"times from 0 to 4295 s.*--from-zero"):
        convert(Source(real), target, tmp_path / "x.dat", nothing)
    convert(Source(real, from_zero(real)), target, tmp_path / "x.dat", nothing)
    moved = real.events.copy()
    moved["t_ns"] += from_zero(real)
    assert_events(read(tmp_path / "x.dat").events, moved)


def test_rounding(tmp_path: Path, recording: EventRecording) -> None:
    target = BY_NAME["evt2"]
    with pytest.raises(
        RecordingError, match=r"whole microseconds, but event 0 of synthetic is at .* --round"
    ):
        convert(Source(recording, from_zero(recording)), target, tmp_path / "x.raw", nothing)
    source = source_of(recording, target)
    exact = recording.events["t_ns"] + from_zero(recording)
    assert np.abs(source.events(0, 3000)["t_ns"] - exact).max() <= 500
    whole = BY_NAME["aedat2"]
    late = source.rest()
    late.gyroscope["t_ns"] += 1
    mixed = replace(late, events=source.events(0, 3000))
    with pytest.raises(RecordingError, match="a sample of the IMU"):
        convert(Source(mixed), whole, tmp_path / "x.aedat", nothing)


def test_sensors_that_do_not_fit(tmp_path: Path, recording: EventRecording) -> None:
    wide = replace(recording, width=2500)
    with pytest.raises(RecordingError, match="up to 2047; the sensor of synthetic has 2500 x 180"):
        convert(source_of(wide, BY_NAME["evt2"]), BY_NAME["evt2"], tmp_path / "x.raw", nothing)
    with pytest.raises(RecordingError, match="a sensor of 240 x 180; that of synthetic has 2500 x 180"):
        convert(source_of(wide, BY_NAME["aedat2"]), BY_NAME["aedat2"], tmp_path / "x.aedat", nothing)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ENDINGS)
def test_what_is_there_stays(tmp_path: Path, recording: EventRecording, name: str) -> None:
    target, path = BY_NAME[name], tmp_path / f"x{ENDINGS[name]}"
    source = source_of(recording, target)
    convert(source, target, path, nothing)
    before = content(target, path)
    shorter = replace(source, recording=replace(recording, events=recording.events[:100]))
    with pytest.raises(RecordingError, match="is there already; --force"):
        convert(shorter, target, path, nothing)
    assert content(target, path) == before
    convert(shorter, target, path, nothing, force=True)
    assert read(path).events.size == 100


class StopError(Exception):
    """Stands for whatever interrupts."""


def stop_after(events: int) -> Callable[[int], None]:
    def advance(done: int) -> None:
        if done >= events:
            raise StopError

    return advance


@pytest.mark.parametrize("name", ENDINGS)
@pytest.mark.parametrize("done", [0, 700, 2900])
def test_interrupted(
    tmp_path: Path, recording: EventRecording, name: str, done: int, small_pieces: None
) -> None:
    """What was interrupted is no recording; resumed, it has the same bytes as if nothing had happened."""
    target, path = BY_NAME[name], tmp_path / f"x{ENDINGS[name]}"
    source = source_of(recording, target)
    convert(source, target, tmp_path / f"whole{ENDINGS[name]}", nothing)
    wanted = content(target, tmp_path / f"whole{ENDINGS[name]}")
    with pytest.raises(StopError):
        convert(source, target, path, stop_after(done))
    output = target.outputs(path)[-1]
    assert not output.exists()
    with pytest.raises(RecordingError, match=r"unfinished|does not exist"):
        open_recording(path)
    with pytest.raises(RecordingError, match="unfinished"):
        open_recording(output.with_name(output.name + ".part"))
    reused = convert(source, target, path, nothing, resume=True)
    assert content(target, path) == wanted
    assert reused == (max(done - 100, 0) // 300 * 300 if name in RESUMED else 0)
    names = {entry.name for entry in output.parent.iterdir()}
    assert not any(".part" in entry for entry in names)


@pytest.mark.parametrize("name", RESUMED)
def test_another_source_is_not_continued(
    tmp_path: Path, recording: EventRecording, name: str, small_pieces: None
) -> None:
    target, path = BY_NAME[name], tmp_path / f"x{ENDINGS[name]}"
    source = source_of(recording, target)
    with pytest.raises(StopError):
        convert(source, target, path, stop_after(1500))
    other = replace(source, origin="another")
    assert convert(other, target, path, nothing, resume=True) == 0
    assert_events(read(path).events, source.events(0, 3000))


@pytest.mark.parametrize("damage", ["journal", "short", "nonsense", "none"])
def test_damaged_part(tmp_path: Path, recording: EventRecording, damage: str, small_pieces: None) -> None:
    """A journal that does not fit what is there is not believed; what is beyond it is written again."""
    target, path = BY_NAME["evt2"], tmp_path / "x.raw"
    source = source_of(recording, target)
    convert(source, target, tmp_path / "whole.raw", nothing)
    with pytest.raises(StopError):
        convert(source, target, path, stop_after(1500))
    part, journal = resumable.part_of(path), resumable.journal_of(path)
    if damage == "journal":
        journal.write_text(journal.read_text()[:-5])
    elif damage == "short":
        part.write_bytes(part.read_bytes()[:50])
    elif damage == "nonsense":
        journal.write_text('{"key": 5, "events": "many", "bytes": null}')
    else:
        with part.open("ab") as stream:
            stream.write(b"what the disk kept of a crash")
    reused = convert(source, target, path, nothing, resume=True)
    assert (reused > 0) == (damage == "none")
    assert path.read_bytes() == (tmp_path / "whole.raw").read_bytes()


SCRIPT = """
import sys
import tracemalloc
from pathlib import Path
from asyneio.io import open_recording
from asyneio.io.conversion import resumable
from asyneio.io.conversion.convert import Source, convert
from asyneio.io.conversion.targets import target_named
resumable.PIECE_EVENTS, resumable.PIECES_PER_ENTRY = 1000, 2
source, output = map(Path, sys.argv[1:])
advance = lambda done: (print(done, flush=True), sys.stdin.readline())
convert(Source(open_recording(source)), target_named(None, output), output, advance)
"""


def test_killed(tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is killed without warning; the next one goes on, to the same bytes."""
    monkeypatch.setattr(resumable, "PIECE_EVENTS", 1000)
    recording, target = make_event_recording(rng, 20_000), BY_NAME["dat"]
    source = source_of(recording, target)
    plain = replace(source.rest(), events=source.events(0, 20_000))
    convert(Source(plain), BY_NAME["hdf5"], tmp_path / "source.h5", nothing)
    convert(Source(plain), target, tmp_path / "whole.dat", nothing)
    output = tmp_path / "out.dat"
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / "source.h5"), str(output)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        # It waits for an answer after each piece, and is killed in the middle of the ninth.
        for done in range(0, 9000, 1000):
            assert int(process.stdout.readline()) == done
            if done < 8000:
                print(file=process.stdin, flush=True)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert not output.exists()
    loaded = read(tmp_path / "source.h5")
    assert convert(Source(loaded), target, output, nothing, resume=True) == 8000
    assert output.read_bytes() == (tmp_path / "whole.dat").read_bytes()


def test_names() -> None:
    for name, ending in ENDINGS.items():
        assert target_named(None, Path(f"out{ending}")).name == name
        assert target_named(name, Path("anything.bin")).name == name
    with pytest.raises(
        RecordingError, match=r"out\.xyz is none that can be written; expected uzh \(a folder\)"
    ):
        target_named(None, Path("out.xyz"))
    with pytest.raises(RecordingError, match="the format 'rosbag7' is none"):
        target_named("rosbag7", Path("out"))


@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
def test_any_events(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever the times, columns and rows: every format gives back what it was given."""
    steps = data.draw(st.lists(st.integers(0, 40_000_000), min_size=1, max_size=30))
    events = np.zeros(len(steps), dtype=EVENT_DTYPE)
    events["t_ns"] = np.cumsum(steps) * 1000
    for name, end in (("x", 240), ("y", 180), ("p", 2)):
        events[name] = data.draw(
            st.lists(st.integers(0, end - 1), min_size=len(steps), max_size=len(steps)), label=name
        )
    events["x"][0], events["y"][0] = 239, 179
    empty = make_event_recording(np.random.default_rng(0), 1).gyroscope[:0]
    recording = EventRecording("any", events, 240, 180, empty, empty)
    target = data.draw(st.sampled_from([target for target in TARGETS if target.name in RESUMED[1:]]))
    path = tmp_path / f"x{ENDINGS[target.name]}"
    convert(Source(recording), target, path, nothing, force=True)
    assert_events(read(path).events, events)


def test_words_of_pieces(rng: np.random.Generator) -> None:
    """Cut anywhere, the words of EVT 2.0 are the same."""
    events = make_event_recording(rng, 500).events.copy()
    events["t_ns"] = (events["t_ns"] - events["t_ns"][0]) // 1000 * 1000
    whole = evt2_words(events, None)
    for cut in (1, 77, 499):
        parts = evt2_words(events[:cut], None) + evt2_words(events[cut:], int(events["t_ns"][cut - 1]))
        assert parts == whole


def test_from_the_cache(tmp_path: Path, recording: EventRecording) -> None:
    """Events of large recordings are a memory map that cannot be written to."""
    source = source_of(recording, BY_NAME["dat"])
    plain = replace(source.rest(), events=source.events(0, recording.events.size))
    convert(Source(plain), BY_NAME["hdf5"], tmp_path / "source.h5", nothing)
    cached = open_recording(tmp_path / "source.h5", cache_from=0)
    assert isinstance(cached, EventRecording)
    assert isinstance(cached.events, np.memmap)
    for target in TARGETS:
        path = tmp_path / f"x{target.name}{''.join(target.suffixes[:1])}"
        convert(Source(cached), target, path, nothing)
        assert_events(read(path).events, plain.events)


def test_memory_is_bounded(tmp_path: Path) -> None:
    """Two million events that are a file, as those of a large recording are: written piece by piece."""
    events = np.lib.format.open_memmap(tmp_path / "events.npy", "w+", EVENT_DTYPE, (2_000_000,))
    events["t_ns"] = np.arange(events.size) * 1000
    empty = make_event_recording(np.random.default_rng(0), 1).gyroscope[:0]
    recording = EventRecording("large", events, 240, 180, empty, empty)
    for name in ("dat", "evt2", "hdf5"):
        target, path = BY_NAME[name], tmp_path / f"x{ENDINGS[name]}"
        convert(Source(replace(recording, events=events[:1000])), target, path, nothing)
        tracemalloc.start()
        convert(Source(recording), target, path, nothing, force=True)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 24 * 2**20, name


def test_disk_that_refuses(tmp_path: Path, recording: EventRecording) -> None:
    (tmp_path / "file").write_text("")
    for name in ENDINGS:
        path = tmp_path / "file" / f"x{ENDINGS[name]}"
        with pytest.raises(RecordingError, match=r"cannot write|is there already|cannot make"):
            convert(source_of(recording, BY_NAME[name]), BY_NAME[name], path, nothing)
    assert os.listdir(tmp_path) == ["file"]
