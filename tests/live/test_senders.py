"""Senders that stall, greet late, or are replaced; sources and outputs that fail at an inconvenient time."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from itertools import islice

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.errors import LiveError
from asyneio.io.recording.event_source import pack_events
from asyneio.live import engine
from asyneio.live.chunks import Break, Chunk, Sensor, Source
from asyneio.live.engine import LiveInterrupted, run_live
from asyneio.live.inbox import EndOfSource, Inbox
from asyneio.live.intake import IntakeThread
from asyneio.live.options import LiveOptions
from asyneio.live.protocol import frame
from asyneio.live.sources import CalibrationOptions
from asyneio.live.sources import sender as sender_module
from asyneio.live.sources import socket as socket_module
from asyneio.live.sources.socket import SocketSource
from asyneio.types import EventRecording
from tests.live.streams import Remember, connected, hello


@pytest.fixture
def source(rig: CalibrationOptions) -> Iterator[SocketSource]:
    opened = SocketSource("127.0.0.1", 0, rig)
    yield opened
    opened.close()


def events_frame(count: int) -> bytes:
    zeros = np.zeros(count, dtype=np.int64)
    return frame(b"E", pack_events(np.arange(count, dtype=np.int64), zeros, zeros, zeros).tobytes())


def items(source: SocketSource, seconds: float) -> list[Chunk | None]:
    """What a source yields within a time."""
    until_s = time.monotonic() + seconds
    found = []
    for item in source.chunks(threading.Event()):
        found.append(item)
        if time.monotonic() > until_s:
            break
    return found


@pytest.mark.slow
def test_a_sender_that_stalls_within_a_frame_is_silent(
    recording: EventRecording, source: SocketSource
) -> None:
    """Silence shows at least every 0.2 s, wherever the data stop; the frame is completed later."""
    whole = events_frame(1000)
    with connected(source.port) as connection:
        connection.sendall(hello(recording) + whole[:5000])
        source.open(threading.Event())
        found = items(source, 1.0)
        assert len(found) >= 5
        assert not any(found)
        connection.sendall(whole[5000:])
        chunks = [item for item in items(source, 0.5) if item is not None]
        assert [chunk.events.size for chunk in chunks] == [1000]


@pytest.mark.slow
def test_a_silent_sender_is_replaced(
    recording: EventRecording, source: SocketSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A host that lost its power closes no connection."""
    monkeypatch.setattr(socket_module, "_SILENT_S", 0.3)
    with connected(source.port) as first:
        first.sendall(hello(recording) + events_frame(3)[:20])
        source.open(threading.Event())
        with connected(source.port) as second:
            second.sendall(hello(recording) + events_frame(7))
            chunks = [item for item in items(source, 1.0) if item is not None]
    assert [chunk.events.size for chunk in chunks] == [7]
    assert any("silent for" in note for note in source.notes())
    assert "senders connected 2 times" in source.notes()


def test_a_sender_without_hello_is_disconnected(
    recording: EventRecording, source: SocketSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender_module, "_HELLO_S", 0.2)
    with connected(source.port), connected(source.port) as second:
        second.sendall(hello(recording))
        source.open(threading.Event())
    assert any("no hello within" in note for note in source.notes())


def test_a_hello_of_any_length_is_rejected(recording: EventRecording, source: SocketSource) -> None:
    with connected(source.port) as connection:
        connection.sendall(frame(b"H", bytes(5000)))
        with connected(source.port) as second:
            second.sendall(hello(recording))
            source.open(threading.Event())
    assert any("expected at most 4096" in note for note in source.notes())


class Scripted:
    """A source that yields given items, and may hang as a driver does."""

    can_wait = True
    starts_when_read = True

    def __init__(self, recording: EventRecording, script: list[Chunk | Break | None], hang_s: float) -> None:
        self._recording, self._script, self._hang_s = recording, script, hang_s
        self.closed = False

    def open(self, stop: threading.Event) -> Sensor:
        assert self._recording.calibration is not None
        return Sensor("test", self._recording.width, self._recording.height, self._recording.calibration)

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | Break | None]:
        yield from self._script
        time.sleep(self._hang_s)

    def notes(self) -> tuple[str, ...]:
        return ()

    def close(self) -> None:
        self.closed = True


def test_a_break_of_a_source_reaches_the_front_end(recording: EventRecording) -> None:
    """The guard accepts any time after it."""
    assert recording.calibration is not None
    far = recording.events[:100].copy()
    far["t_ns"] += 10**15
    script = [Chunk(0.0, recording.events[:100]), Break("the clock was set"), Chunk(0.0, far)]
    source: Source = Scripted(recording, script, 0.0)
    inbox = Inbox(can_wait=True)
    thread = IntakeThread(source, source.open(threading.Event()), inbox)
    thread.start()
    got = [inbox.get(5.0) for _ in range(4)]
    assert isinstance(got[1], Break)
    assert isinstance(got[3], EndOfSource)
    sizes = [item.events.size for item in islice(got, 0, 3, 2) if isinstance(item, Chunk)]
    assert sizes == [100, 100]


@pytest.mark.slow
def test_an_interrupt_does_not_wait_for_a_driver_that_hangs(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A service manager sends SIGTERM once."""
    monkeypatch.setattr(engine, "_DRIVER_S", 0.3)
    seen = Remember()

    def interrupt() -> None:
        while seen.sensor is None:
            time.sleep(0.01)
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGTERM)

    thread = threading.Thread(target=interrupt, daemon=True)
    thread.start()
    source = Scripted(recording, [Chunk(0.0, recording.events[:100])], 20.0)
    started_s = time.monotonic()
    with pytest.raises(LiveInterrupted):
        run_live(source, Config(), [seen])
    thread.join()
    assert seen.ended
    assert source.closed
    assert time.monotonic() - started_s < 15.0


@pytest.mark.slow
def test_outputs_that_began_are_ended_if_one_cannot_begin(recording: EventRecording) -> None:
    class Broken(Remember):
        def begin(self, sensor: Sensor) -> None:
            raise LiveError("no screen")

    first, third = Remember(), Remember()
    with pytest.raises(LiveError, match="no screen"):
        run_live(Scripted(recording, [], 0.0), Config(), [first, Broken(), third])
    assert first.ended
    assert third.sensor is None


@pytest.mark.parametrize(
    "given", [{"max_backlog_s": 0.0}, {"duration_s": -1.0}, {"duration_s": float("inf")}]
)
def test_times_must_be_positive(given: dict[str, float]) -> None:
    with pytest.raises(LiveError, match="expected seconds above 0"):
        LiveOptions(**given)
