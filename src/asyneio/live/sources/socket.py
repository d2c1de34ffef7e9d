# SPDX-License-Identifier: Apache-2.0
"""`socket:`: any program that sends frames of `live.protocol` over TCP."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from asyneio.errors import LiveError
from asyneio.io.recording.contents import split_samples
from asyneio.live.chunks import Chunk, Sensor
from asyneio.live.protocol import END, HELLO
from asyneio.live.publisher import listening_socket
from asyneio.live.sources.calibration import CalibrationOptions, sensor_of
from asyneio.live.sources.sender import Sender
from asyneio.types import RecordArray

#: How long [s] a wait for a sender lasts.
_LOOK_S = 0.1
#: A sender that is silent for this time [s] is replaced by another one that connects.
_SILENT_S = 2.0
_MOST_COMPLAINTS = 20


class SocketSource:
    """Listens for one sender at a time. See `live.chunks.Source`.

    Attributes:
        port: at which it listens.

    Args:
        host, port: where to listen; port 0: any free one.
        rig: calibration.

    Raises:
        LiveError: the address cannot be listened on.
    """

    can_wait = False
    starts_when_read = False

    def __init__(self, host: str, port: int, rig: CalibrationOptions) -> None:
        self._rig = rig
        self._server = listening_socket(host, port)
        self.port = int(self._server.getsockname()[1])
        self._sender: Sender | None = None
        self._size: tuple[int, int] | None = None
        self._greeted = 0
        self._complaints: list[str] = []

    def open(self, stop: threading.Event) -> Sensor:
        """See `Source`: waits for the first sender."""
        while not stop.is_set():
            self._next()
            if self._sender is not None and self._sender.hello is not None:
                name, self._size = self._sender.hello
                return sensor_of(name, self._size, self._rig)
        raise LiveError("stopped before a sender connected")

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | None]:
        """See `Source`."""
        while not stop.is_set():
            kind, rows = self._next() or (HELLO, None)
            if kind == END:
                return
            yield None if rows is None else _chunk(kind, rows)

    def notes(self) -> tuple[str, ...]:
        """See `Source`."""
        again = (f"senders connected {self._greeted} times",) if self._greeted > 1 else ()
        return (*again, *self._complaints)

    def close(self) -> None:
        """See `Source`."""
        self._drop("")
        self._server.close()

    def _next(self) -> tuple[bytes, RecordArray | None] | None:
        """The next frame of the present sender; None if none is complete in time."""
        if self._sender is None or self._sender.silence_s() > _SILENT_S:
            self._accept()
        if self._sender is None:
            return None
        greeted = self._sender.hello is not None
        try:
            frame = self._sender.read()
            if frame is None or frame[0] != HELLO:
                return frame
            self._check_size()
        except (OSError, LiveError) as error:
            self._drop(str(error))
            return None
        self._greeted += not greeted
        return HELLO, None

    def _accept(self) -> None:
        """Wait a moment for a sender, which replaces a silent one."""
        self._server.settimeout(_LOOK_S if self._sender is None else 0.0)
        try:
            connection, _ = self._server.accept()
        except (TimeoutError, BlockingIOError, ConnectionAbortedError):
            return
        if self._sender is not None:
            silence_s = self._sender.silence_s()
            self._drop(f"the sender was silent for {silence_s:.1f} s, and another one connected")
        self._sender = Sender(connection)

    def _check_size(self) -> None:
        assert self._sender is not None
        assert self._sender.hello is not None
        _, size = self._sender.hello
        if self._size not in (None, size):
            raise LiveError(f"a sender has {size[0]} x {size[1]} pixels, the first one had {self._size}")

    def _drop(self, reason: str) -> None:
        if self._sender is not None:
            self._sender.close()
            self._sender = None
        if reason and len(self._complaints) < _MOST_COMPLAINTS:
            self._complaints.append(f"connection closed: {reason}")


def _chunk(kind: bytes, rows: RecordArray) -> Chunk:
    now_s = time.perf_counter()
    match kind:
        case b"E":
            return Chunk(now_s, events=rows)
        case b"G":
            return Chunk(now_s, gyroscope=rows)
        case b"A":
            return Chunk(now_s, accelerometer=rows)
        case b"T":
            return Chunk(now_s, complete_ns=int(rows[-1]) if rows.size else None)
    samples = split_samples(rows, "")
    return Chunk(now_s, gyroscope=samples.gyroscope, accelerometer=samples.accelerometer)
