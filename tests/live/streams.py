"""Senders of the socket protocol, an output that remembers, and comparisons."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from asyneio.io.recording.event_source import SAMPLE_DTYPE
from asyneio.live.chunks import Sensor
from asyneio.live.protocol import frame
from asyneio.live.step import LiveStep
from asyneio.types import Estimate, EventRecording, RecordArray

STEP_NS = 20_000_000


class Remember:
    """An output that keeps all steps."""

    def __init__(self) -> None:
        self.steps: list[LiveStep] = []
        self.sensor: Sensor | None = None
        self.ended = False

    def begin(self, sensor: Sensor) -> None:
        self.sensor = sensor

    def step(self, step: LiveStep) -> None:
        self.steps.append(step)

    def end(self) -> None:
        self.ended = True

    def notes(self) -> tuple[str, ...]:
        return ()

    @property
    def estimates(self) -> list[Estimate]:
        return [estimate for step in self.steps for estimate in step.estimates]


def hello(recording: EventRecording) -> bytes:
    return frame(
        b"H", json.dumps({"width": recording.width, "height": recording.height, "name": "test"}).encode()
    )


def data(recording: EventRecording, shift_ns: int = 0, until_s: float = 1e9) -> Iterator[bytes]:
    """Frames of a recording in order of time, with stamps moved."""
    assert np.array_equal(recording.gyroscope["t_ns"], recording.accelerometer["t_ns"])
    samples = np.zeros(recording.gyroscope.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = recording.gyroscope["t_ns"]
    samples["gyroscope"], samples["accelerometer"] = (
        recording.gyroscope["xyz"],
        recording.accelerometer["xyz"],
    )
    first = min(int(samples["t_ns"][0]), int(recording.events["t_ns"][0]))
    last = max(int(samples["t_ns"][-1]), int(recording.events["t_ns"][-1]))
    for start in range(first, min(last, first + round(until_s * 1e9)) + 1, STEP_NS):
        for kind, rows in ((b"I", samples), (b"E", recording.events)):
            yield frame(kind, _moved(_part(rows, start), shift_ns).tobytes())


def _part(rows: RecordArray, start: int) -> RecordArray:
    return rows[slice(*np.searchsorted(rows["t_ns"], [start, start + STEP_NS]))]


def _moved(rows: RecordArray, shift_ns: int) -> RecordArray:
    rows = np.array(rows)
    rows["t_ns"] += shift_ns
    return rows


@contextmanager
def sending(work: Callable[[], None]) -> Iterator[None]:
    """Run a sender beside the block; what it raises is raised here."""
    raised: list[BaseException] = []

    def guarded() -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=guarded, daemon=True)
    thread.start()
    yield
    thread.join(timeout=30.0)
    assert not thread.is_alive()
    if raised:
        raise raised[0]


def connected(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=30.0)


def assert_same_estimates(found: list[Estimate], wanted: list[Estimate]) -> None:
    """To the bit."""
    assert [estimate.t_ns for estimate in found] == [estimate.t_ns for estimate in wanted]
    for a, b in zip(found, wanted, strict=True):
        for name in ("T_w_b", "velocity_w", "bias_gyroscope", "bias_accelerometer", "covariance"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
