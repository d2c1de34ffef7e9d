"""Live runs from a file and over a socket: the poses of `asyneio run`, recovery, recording and replay."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.errors import CalibrationError, LiveError
from asyneio.io import open_recording, read_estimates, read_trajectory
from asyneio.io.hdf5.asyneio_writer import write_events_hdf5
from asyneio.live import intake
from asyneio.live.engine import run_live
from asyneio.live.options import LiveOptions
from asyneio.live.protocol import MAGIC, frame
from asyneio.live.sources import CalibrationOptions, open_source
from asyneio.live.sources.socket import SocketSource
from asyneio.live.spool import Spool
from asyneio.live.summary import LiveSummary
from asyneio.pipeline import RunResult, run_recording
from asyneio.types import NS_PER_S, EventRecording, Health
from tests.live.streams import Remember, assert_same_estimates, connected, data, hello, sending

pytestmark = pytest.mark.slow

#: Tests send faster than a camera: nothing may be shed for that.
PATIENT = LiveOptions(max_backlog_s=1e6)


@pytest.fixture
def source(rig: CalibrationOptions) -> SocketSource:
    return SocketSource("127.0.0.1", 0, rig)


def stream(source: SocketSource, frames: bytes) -> None:
    with connected(source.port) as connection:
        connection.sendall(frames)


def run(source: SocketSource, spool: Spool | None = None) -> tuple[LiveSummary, Remember]:
    seen = Remember()
    return run_live(source, Config(), [seen], spool, PATIENT), seen


def all_of(recording: EventRecording, *streams: bytes) -> bytes:
    return b"".join([hello(recording), *streams, frame(b"Z")])


def test_a_file_gives_the_poses_of_run(recording: EventRecording, wanted: RunResult, tmp_path: Path) -> None:
    write_events_hdf5(recording, tmp_path / "recording.h5")
    seen = Remember()
    source = open_source(f"file:{tmp_path / 'recording.h5'}", CalibrationOptions(), speed=0.0)
    summary = run_live(source, Config(), [seen])
    assert_same_estimates(seen.estimates, wanted.run.estimates)
    assert summary.shed.nothing()
    assert summary.failure == wanted.summary.failure == ""
    assert summary.events == sum(report.tracked.packet.events or 0 for report in seen.steps if report.tracked)
    assert seen.ended


def test_a_socket_gives_the_poses_of_run_and_its_record_replays(
    recording: EventRecording, wanted: RunResult, source: SocketSource, tmp_path: Path
) -> None:
    spool = Spool(tmp_path, Config())
    frames = all_of(recording, *data(recording))
    with sending(lambda: stream(source, frames)):
        summary, seen = run(source, spool)
    assert_same_estimates(seen.estimates, wanted.run.estimates)
    assert summary.shed.nothing()
    assert spool.notes() == ()
    spool.finish(summary)
    replayed = open_recording(tmp_path)
    assert isinstance(replayed, EventRecording)
    np.testing.assert_array_equal(replayed.gyroscope, recording.gyroscope)
    np.testing.assert_array_equal(replayed.events, recording.events)
    assert_same_estimates(run_recording(replayed, Config()).run.estimates, seen.estimates)
    assert_same_estimates(read_estimates(tmp_path / "live" / "estimates.npz"), seen.estimates)
    poses, _ = read_trajectory(tmp_path / "live" / "trajectory.tum")
    np.testing.assert_array_equal(poses.t_ns, [estimate.t_ns for estimate in seen.estimates])
    lines = [json.loads(line) for line in (tmp_path / "live" / "poses.jsonl").read_text().splitlines()]
    assert [line["t_ns"] for line in lines if line["type"] == "pose"] == poses.t_ns.tolist()
    assert json.loads((tmp_path / "live" / "summary.json").read_text())["knots"] == len(seen.estimates)


def healths(seen: Remember) -> list[tuple[Health, int]]:
    """Health and segment, without repetitions."""
    found = [(step.report.health, step.report.segment) for step in seen.steps]
    return [pair for k, pair in enumerate(found) if k == 0 or pair != found[k - 1]]


@pytest.mark.parametrize("shift_s", [-100.0, 3600.0])
def test_a_jump_of_the_clock_starts_a_segment(
    recording: EventRecording, wanted: RunResult, source: SocketSource, tmp_path: Path, shift_s: float
) -> None:
    shift_ns = round(shift_s * NS_PER_S)
    frames = all_of(recording, *data(recording), *data(recording, shift_ns))
    spool = Spool(tmp_path, Config())
    with sending(lambda: stream(source, frames)):
        summary, seen = run(source, spool)
    assert summary.segments == 2
    first = [estimate for estimate in seen.estimates if estimate.segment == 0]
    assert_same_estimates(first, wanted.run.estimates)
    assert (Health.LOST, 0) in healths(seen)
    assert seen.steps[-1].report.health is Health.TRACKING
    assert seen.steps[-1].report.segment == 1
    assert "2 segments" in summary.failure
    # Each stretch replays on its own.
    second = open_recording(tmp_path / "recording_1.h5")
    replayed = run_recording(second, Config()).run.estimates
    assert_same_estimates(replayed, [estimate for estimate in seen.estimates if estimate.segment == 1])


def test_a_sender_that_dies_and_comes_back(
    recording: EventRecording,
    wanted: RunResult,
    source: SocketSource,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(intake, "LONGEST_SILENCE_S", 1.2)
    seen = Remember()

    def wait_for(done: Callable[[], bool], between: Callable[[], None] = lambda: None) -> None:
        deadline = time.monotonic() + 120.0
        while not done():
            assert time.monotonic() < deadline
            between()
            time.sleep(0.05)

    def work() -> None:
        with connected(source.port) as connection:
            connection.sendall(b"".join([hello(recording), *data(recording)]))
            # A slow machine catches up while the sender still says that it is there.
            said = frame(b"T", (0).to_bytes(8, "little"))
            enough = len(wanted.run.estimates) - 1
            wait_for(lambda: len(seen.estimates) >= enough, lambda: connection.sendall(said))
            # It dies in the middle of a frame.
            connection.sendall(frame(b"E", bytes(160))[:50])
        wait_for(lambda: any(step.report.health is Health.LOST for step in seen.steps))
        stream(source, all_of(recording, *data(recording, 20 * NS_PER_S)))

    with sending(work):
        summary = run_live(source, Config(), [seen], None, PATIENT)
    order = healths(seen)
    assert (
        order.index((Health.TRACKING, 0)) < order.index((Health.DEGRADED, 0)) < order.index((Health.LOST, 0))
    )
    assert order[-1] == (Health.TRACKING, 1)
    reasons = [step.report.reason for step in seen.steps]
    assert any(reason.startswith("no data from the source") for reason in reasons)
    assert any("in the middle of a frame" in note for note in summary.notes)


def test_a_gap_in_the_data_degrades_then_loses(recording: EventRecording, source: SocketSource) -> None:
    # Time goes on, but nothing was measured for two seconds.
    frames = all_of(recording, *data(recording), *data(recording, 5 * NS_PER_S))
    with sending(lambda: stream(source, frames)):
        _, seen = run(source)
    order = healths(seen)
    assert (Health.LOST, 0) in order
    assert order[-1] == (Health.TRACKING, 1)
    stamps = [step.report.t_ns for step in seen.steps]
    assert (np.diff(stamps) == 100_000_000).all()


def test_nonsense_does_not_end_the_run(
    recording: EventRecording, wanted: RunResult, source: SocketSource
) -> None:
    wrong_size = frame(b"H", b'{"width": 10, "height": 10}')
    nonsense = [
        b"GET / HTTP/1.1\r\n\r\n" + bytes(100),
        hello(recording) + MAGIC + b"E" + bytes(3) + (17).to_bytes(4, "little"),
        hello(recording) + MAGIC + b"E" + bytes(3) + (2**31).to_bytes(4, "little"),
        hello(recording) + frame(b"Q"),
        frame(b"E", bytes(16)),
        frame(b"H", b"[1, 2]"),
        wrong_size,
        b"",
    ]

    def work() -> None:
        stream(source, hello(recording))
        for frames in nonsense:
            stream(source, frames)
        stream(source, all_of(recording, *data(recording)))

    with sending(work):
        summary, seen = run(source)
    assert_same_estimates(seen.estimates, wanted.run.estimates)
    said = " ".join(summary.notes)
    for part in ("another protocol", "expected a multiple of 16", "at most", "expected one of H", "10 x 10"):
        assert part in said


def test_a_duration_ends_the_run(recording: EventRecording, wanted: RunResult, tmp_path: Path) -> None:
    write_events_hdf5(recording, tmp_path / "recording.h5")
    seen = Remember()
    source = open_source(f"file:{tmp_path / 'recording.h5'}", CalibrationOptions(), speed=0.0)
    run_live(source, Config(), [seen], None, LiveOptions(duration_s=2.0))
    assert 0 < len(seen.estimates) < len(wanted.run.estimates)
    assert_same_estimates(seen.estimates, wanted.run.estimates[: len(seen.estimates)])


def test_a_file_at_its_own_pace_takes_as_long(recording: EventRecording, tmp_path: Path) -> None:
    write_events_hdf5(recording, tmp_path / "recording.h5")
    source = open_source(f"file:{tmp_path / 'recording.h5'}", CalibrationOptions(), speed=2.0)
    assert not source.can_wait
    summary = run_live(source, Config(), [Remember()], None, LiveOptions(max_backlog_s=1e6, duration_s=2.0))
    assert summary.wall_s > 0.75


def test_no_calibration_is_said(recording: EventRecording) -> None:
    source = SocketSource("127.0.0.1", 0, CalibrationOptions())
    with (
        sending(lambda: stream(source, hello(recording))),
        pytest.raises(CalibrationError, match="--calibration"),
    ):
        run_live(source, Config())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("camera", "expected file:PATH"),
        ("udp:5555", "expected file:PATH"),
        ("socket:port", "expected a number"),
        ("socket:127.0.0.1:99999", "expected a number"),
        ("dv:", "expected a number"),
    ],
)
def test_sources_that_do_not_exist(text: str, said: str) -> None:
    pytest.importorskip("dv_processing")
    with pytest.raises(LiveError, match=said):
        open_source(text, CalibrationOptions())


def test_a_port_in_use_is_said(source: SocketSource, rig: CalibrationOptions) -> None:
    with pytest.raises(LiveError, match="cannot listen"):
        SocketSource("127.0.0.1", source.port, rig)
