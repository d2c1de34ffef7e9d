"""A recording whose clock jumps back, through the commands: new segments, never a pose across the jump."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.evaluation import PROTOCOLS, evaluate
from asyneio.io import open_recording, read_trajectory, write_uzh_folder
from asyneio.io.hdf5.asyneio_writer import write_events_hdf5
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import NS_PER_S, EventRecording, PoseTrajectory
from tests.cli.conftest import Asyneio
from tests.faults.conftest import Run
from tests.io.event_recordings import make_event_recording

#: The simulated recording lasts this long; the second one follows after a pause of at least 1.2 s.
SECONDS, OFFSET_S = 3.0, 5


@pytest.fixture(scope="module")
def room() -> EventRecording:
    return simulate_events(replace(EVENT_SCENARIOS["event_room"], duration_s=SECONDS)).recording


@pytest.fixture
def short(rng: np.random.Generator) -> EventRecording:
    """Two seconds of random events."""
    return make_event_recording(rng, 20_000)


def looped(recording: EventRecording) -> EventRecording:
    """A recording as a loop in one file leaves it: all streams twice, ground truth once."""
    streams = ("events", "gyroscope", "accelerometer")
    return replace(recording, **{name: np.concatenate([getattr(recording, name)] * 2) for name in streams})


def as_text(recording: EventRecording, folder: Path) -> Path:
    write_uzh_folder(looped(recording), folder)
    return folder


def as_hdf5(recording: EventRecording, folder: Path) -> Path:
    folder.mkdir()
    write_events_hdf5(looped(recording), folder / "recording.h5")
    return folder / "recording.h5"


def one_line(text: str) -> str:
    return " ".join(text.split())


def error_m(estimate: PoseTrajectory, truth: PoseTrajectory) -> float:
    return float(evaluate(estimate, truth, PROTOCOLS["posyaw"]).position_m.rmse)


@pytest.mark.slow
@pytest.mark.parametrize("write", [as_text, as_hdf5])
def test_a_recording_twice_in_one_file_gives_two_segments(
    asyneio: Asyneio,
    room: EventRecording,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    write: Callable[[EventRecording, Path], Path],
) -> None:
    monkeypatch.setattr("asyneio.cli.execute.available", lambda: False)
    out = tmp_path / "out"
    status, _, said = asyneio("run", write(room, tmp_path / "twice"), "-o", out)
    assert status == 1
    assert f"time jumps back by 3.000 s before event {room.events.size} " in one_line(said)
    assert f"time stamps in the results are later by {OFFSET_S} s than in the file" in one_line(said)
    assert "the trajectory has 2 segments" in one_line(said)
    summary = json.loads((out / "summary.json").read_text())
    (jump,) = summary["clock_jumps"]
    assert jump["offset_ns"] == OFFSET_S * NS_PER_S
    assert jump["back_ns"] == pytest.approx(SECONDS * NS_PER_S, abs=NS_PER_S // 100)
    truth = room.ground_truth
    assert truth is not None
    later = PoseTrajectory(truth.t_ns + jump["offset_ns"], truth.position, truth.quaternion)
    first, second = (read_trajectory(out / name)[0] for name in ("trajectory.tum", "trajectory_1.tum"))
    # Half a second of prediction is the rule for every gap; nothing later, and nothing before the jump.
    assert first.t_ns[-1] < truth.t_ns[-1] + 0.6 * NS_PER_S
    assert second.t_ns[0] > jump["t_ns"]
    assert len(second.t_ns) >= 10
    seen = first.t_ns <= truth.t_ns[-1]
    first = PoseTrajectory(first.t_ns[seen], first.position[seen], first.quaternion[seen])
    assert error_m(first, truth) < 0.03
    assert error_m(second, later) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["gradient", "haste"])
def test_no_track_crosses_the_jump(
    asyneio: Asyneio, room: EventRecording, tmp_path: Path, tracker: str
) -> None:
    status, _, said = asyneio(
        "track", as_text(room, tmp_path / "twice"), "-o", tmp_path / "tracks", "--tracker", tracker
    )
    assert status == 0
    assert "time jumps back by 3.000 s" in one_line(said)
    stamps, ids = np.loadtxt(
        tmp_path / "tracks" / "tracks.csv", delimiter=",", skiprows=1, usecols=(0, 1), dtype=np.int64
    ).T
    later = stamps > stamps[0] + 4 * NS_PER_S
    assert min(np.unique(ids[later]).size, np.unique(ids[~later]).size) > 50
    assert not np.intersect1d(ids[later], ids[~later]).size


def test_a_jump_of_the_events_alone_stops(read: Run, short: EventRecording, tmp_path: Path) -> None:
    folder = as_text(short, tmp_path / "twice")
    write_uzh_folder(short, tmp_path / "once")
    shutil.copy(tmp_path / "once" / "imu.txt", folder / "imu.txt")
    ran = read(folder)
    assert ran.status == 1
    assert "time jumps back 0 time(s), that of the events 1 time(s), before event 20000" in one_line(ran.said)
    assert not (ran.folder / "trajectory.tum").exists()


def test_a_jump_of_the_samples_alone_stops(read: Run, short: EventRecording, tmp_path: Path) -> None:
    folder = as_text(short, tmp_path / "twice")
    write_uzh_folder(short, tmp_path / "once")
    shutil.copy(tmp_path / "once" / "events.txt", folder / "events.txt")
    ran = read(folder)
    assert ran.status == 1
    assert "imu.txt: time runs backwards by 1995.0 ms at row 401" in one_line(ran.said)


def test_settings_that_bridge_the_pause_stop(asyneio: Asyneio, short: EventRecording, tmp_path: Path) -> None:
    settings = tmp_path / "settings.yaml"
    settings.write_text("health: {lost_inertial_gap_s: 1.5}\n")
    folder = as_text(short, tmp_path / "twice")
    status, _, said = asyneio("run", folder, "-o", tmp_path / "out", "--config", settings)
    assert status == 1
    assert "health.lost_inertial_gap_s is 1.5 s; set it below 1 s" in one_line(said)


def test_a_clock_that_is_set_after_the_first_events(read: Run, short: EventRecording, tmp_path: Path) -> None:
    """Two thousand events and thirty samples of an older clock: dropped, and time stays as in the file."""
    parts = {name: getattr(short, name) for name in ("events", "gyroscope", "accelerometer")}
    first = {name: rows[: 30 if name != "events" else 2000].copy() for name, rows in parts.items()}
    for rows in first.values():
        rows["t_ns"] += 1000 * NS_PER_S
    write_uzh_folder(
        replace(short, **{name: np.concatenate([first[name], rows]) for name, rows in parts.items()}),
        tmp_path / "set",
    )
    ran = read(tmp_path / "set")
    assert "before event 2000: dropped the events before it" in one_line(ran.said)
    assert ran.summary["clock_jumps"] == []
    found = open_recording(tmp_path / "set")
    assert isinstance(found, EventRecording)
    np.testing.assert_array_equal(found.events["t_ns"], short.events["t_ns"])
    np.testing.assert_array_equal(found.gyroscope["t_ns"], short.gyroscope["t_ns"])
    assert found.ground_truth is not None


def test_convert_writes_the_joined_time(asyneio: Asyneio, short: EventRecording, tmp_path: Path) -> None:
    target = tmp_path / "joined.h5"
    status, _, said = asyneio("convert", as_text(short, tmp_path / "twice"), target)
    assert status == 0
    assert "time jumps back by 2.000 s before event 20000" in one_line(said)
    assert "ground truth is not used: time jumps back" in one_line(said)
    found = open_recording(target)
    assert isinstance(found, EventRecording)
    assert found.clock_jumps == ()
    offset = np.repeat([0, 4 * NS_PER_S], 20_000)
    np.testing.assert_array_equal(found.events["t_ns"], np.tile(short.events["t_ns"], 2) + offset)
    assert found.gyroscope.size == 2 * short.gyroscope.size


def test_doctor_reports_the_jump(asyneio: Asyneio, short: EventRecording, tmp_path: Path) -> None:
    _, out, _ = asyneio("doctor", as_text(short, tmp_path / "twice"), "--json")
    checks = {check["check"]: check for check in json.loads(out)["results"]}
    for name in ("event order", "imu order"):
        assert checks[name]["severity"] == "WARNING"
        assert "time jumps back" in checks[name]["measured"]
        assert "a run begins a new segment at each jump" in checks[name]["fix"]
    assert checks["event order"]["values"]["jumps"] == 1
