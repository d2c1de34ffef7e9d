"""`asyneio track`, and the simulation of events."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.cli.main import main
from asyneio.io import open_recording, write_uzh_folder
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import EVENT_DTYPE, EventRecording, Recording
from tests.cli.conftest import Asyneio
from tests.io.event_recordings import make_event_recording
from tests.io.recordings import START_NS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a second of events in a room, written by `asyneio simulate`."""
    folder = tmp_path_factory.mktemp("simulated") / "room"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys,
            "argv",
            ["asyneio", "simulate", "event_slow", "-o", str(folder), "--duration", "0.6", "--seed", "3"],
        )
        with pytest.raises(SystemExit) as stop:
            main()
    assert stop.value.code in (0, None)
    return folder


@pytest.mark.slow
def test_simulated_events_are_a_recording(simulated: Path) -> None:
    recording = open_recording(simulated)
    assert isinstance(recording, EventRecording)
    assert recording.calibration is not None
    assert recording.ground_truth is not None
    assert recording.events.size > 10_000
    assert recording.gyroscope.size == pytest.approx(600, abs=2)


@pytest.mark.slow
def test_simulated_events_in_hdf5(asyneio: Asyneio, tmp_path: Path) -> None:
    arguments = ("--duration", "0.1", "--seed", "3", "--format", "hdf5")
    status, out, err = asyneio("simulate", "event_fast", "-o", tmp_path / "room", *arguments)
    assert (status, out) == (0, "")
    assert "Mev (camera: " in err
    found = open_recording(tmp_path / "room")
    wanted = simulate_events(replace(EVENT_SCENARIOS["event_fast"], duration_s=0.1, seed=3)).recording
    assert isinstance(found, EventRecording)
    for name in ("t_ns", "x", "y", "p"):
        np.testing.assert_array_equal(found.events[name], wanted.events[name])


def test_tracks_are_a_tracks_folder(
    asyneio: Asyneio, simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asyneio.viz.tracks._FRAMES", 3)
    status, out, err = asyneio("track", simulated, "-o", tmp_path / "out", "--animation")
    assert status == 0, err
    for wanted in ("gradient, with gyroscope", "features alive", "Mev/s", "life", "at the border"):
        assert wanted in out
    for name in ("tracks.csv", "tracks.png", "tracks.gif", "tracks_summary.json"):
        assert f"wrote {tmp_path / 'out' / name}" in err
    assert (tmp_path / "out" / "tracks.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "out" / "tracks.gif").read_bytes().startswith(b"GIF89a")
    events, tracks = open_recording(simulated), open_recording(tmp_path / "out")
    assert isinstance(events, EventRecording)
    assert isinstance(tracks, Recording)
    summary = json.loads((tmp_path / "out" / "tracks_summary.json").read_text())
    assert summary["events"] == events.events.size == summary["statistics"]["events"]
    assert summary["observations"] == tracks.observations.size > 100
    assert summary["tracks"] == np.unique(tracks.observations["id"]).size
    np.testing.assert_array_equal(tracks.gyroscope, events.gyroscope)
    # A tracks folder is read in the IMU clock, like the gyroscope.
    assert tracks.observations["t_ns"][0] >= events.events["t_ns"][0] + tracks.calibration.timeshift_ns
    header, row = (tmp_path / "out" / "tracks.csv").read_text().splitlines()[:2]
    assert header == "t_ns,id,u,v"
    assert row.split(",")[0] == str(tracks.observations["t_ns"][0] - tracks.calibration.timeshift_ns)


def test_json_and_no_gyroscope(asyneio: Asyneio, simulated: Path, tmp_path: Path) -> None:
    status, out, _ = asyneio("track", simulated, "-o", tmp_path / "out", "--no-gyroscope", "--json")
    assert status == 0
    printed = json.loads(out)
    assert printed == json.loads((tmp_path / "out" / "tracks_summary.json").read_text())
    assert printed["gyroscope_used"] is False
    assert printed["life_s"]["quartile"] <= printed["life_s"]["median"] <= printed["life_s"]["longest"]


@pytest.mark.slow
def test_the_other_tracker(asyneio: Asyneio, simulated: Path, tmp_path: Path) -> None:
    for name in ("gradient", "haste"):
        status, out, err = asyneio("track", simulated, "-o", tmp_path / name, "--tracker", name)
        assert status == 0, err
        assert name in out
    ours, other = ((tmp_path / name / "tracks.csv").read_bytes() for name in ("gradient", "haste"))
    assert ours != other


def test_nothing_to_follow_is_an_error_and_leaves_no_tracks(
    asyneio: Asyneio, tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = make_event_recording(rng, count=500)
    write_uzh_folder(recording, tmp_path / "noise")
    (tmp_path / "out").mkdir()
    for stale in ("tracks.csv", "tracks.png"):
        (tmp_path / "out" / stale).write_text("of an earlier run")
    status, out, err = asyneio("track", tmp_path / "noise", "-o", tmp_path / "out")
    assert status == 1
    assert "0 observations" in out
    assert err.splitlines()[-1].startswith("asyneio: no features were tracked in the 500 events")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["tracks_summary.json"]


def test_without_matplotlib_the_extra_is_named(
    asyneio: Asyneio, simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asyneio.viz.available", lambda: False)
    status, _, err = asyneio("track", simulated, "-o", tmp_path / "out")
    assert status == 0
    assert "pip install 'asyneio[report]'" in err
    assert not (tmp_path / "out" / "tracks.png").exists()


def test_errors_are_one_paragraph(
    asyneio: Asyneio, tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tracks").mkdir()
    write_uzh_folder(make_event_recording(rng, count=500), tmp_path / "events")
    (tmp_path / "wrong.yaml").write_text("frontend: {trackers: haste}\n")
    for arguments, message in (
        (("track", "absent"), "asyneio: absent does not exist"),
        (("track", "events", "--config", "wrong.yaml"), "wrong.yaml: unknown setting frontend.trackers"),
        (("simulate", "event_calm", "-o", "x"), "event_slow, event_room"),
        (("simulate", "event_slow", "-o", "x", "--duration", "-1"), "expected"),
    ):
        status, out, err = asyneio(*arguments)
        assert (status, out) == (1, "")
        assert message in err
        assert len([line for line in err.splitlines() if line.strip()]) == 1
    assert asyneio("track", "events", "--tracker", "fast")[0] == 2


def test_a_tracks_folder_is_refused(asyneio: Asyneio, tmp_path: Path, simulated: Path) -> None:
    assert asyneio("simulate", "gentle", "-o", tmp_path / "tracks", "--duration", "1")[0] == 0
    status, _, err = asyneio("track", tmp_path / "tracks", "-o", tmp_path / "out")
    assert status == 1
    assert "is a tracks folder" in err.splitlines()[-1]
    assert not (tmp_path / "out").exists()


def test_an_empty_recording(asyneio: Asyneio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    empty = EventRecording(
        "empty", np.empty(0, dtype=EVENT_DTYPE), 240, 180, *(np.empty(0),) * 2, notes=(f"since {START_NS}",)
    )
    monkeypatch.setattr("asyneio.io.open_recording", lambda *_: empty)
    status, _, err = asyneio("track", "events", "-o", tmp_path / "out")
    assert status == 1
    assert "note: since" in err
    assert err.splitlines()[-1] == "asyneio: events contains no events"
