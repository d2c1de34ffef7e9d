# SPDX-License-Identifier: Apache-2.0
"""`socket:`: any program that sends frames of `live.protocol` over TCP."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator

import numpy as np

from asyneio.errors import LiveError
from asyneio.io.recording.contents import split_samples
from asyneio.live.chunks import Chunk, Sensor
from asyneio.live.protocol import END, HEADER, HELLO, ROWS, parse_header, parse_hello
from asyneio.live.publisher import listening_socket
from asyneio.live.sources.calibration import CalibrationOptions, sensor_of
from asyneio.types import RecordArray

#: How long [s] a wait for data lasts before the loop looks around.
_LOOK_S = 0.1
#: A sender must send its greeting within this time [s].
_HELLO_S = 5.0
_BUFFER_BYTES = 8 * 2**20


class SocketSource:
    """Listens for a sender; when one goes, the next may come.

    Args:
        host, port: where to listen; port 0: any free one, see `port`.
        rig: calibration.

    Raises:
        LiveError: the address cannot be listened on.
    """

    can_wait = False
    starts_when_read = False

    def __init__(self, host: str, port: int, rig: CalibrationOptions) -> None:
        self._rig = rig
        self._server = listening_socket(host, port)
        self._server.settimeout(_LOOK_S)
        self.port = int(self._server.getsockname()[1])
        self._connection: socket.socket | None = None
        self._size: tuple[int, int] | None = None
        self._connections = 0
        self._complaints: list[str] = []

    def open(self, stop: threading.Event) -> Sensor:
        """See `Source`: waits for the first sender."""
        while not stop.is_set():
            hello = self._accept()
            if hello is not None:
                name, self._size = hello
                return sensor_of(name, self._size, self._rig)
        raise LiveError("stopped before a sender connected")

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | None]:
        """See `Source`."""
        while not stop.is_set():
            if self._connection is None:
                self._accept()
                yield None
                continue
            try:
                found = self._frame(self._connection, stop)
            except (OSError, LiveError) as error:
                self._drop(str(error))
                continue
            if found is None:
                yield None
                continue
            kind, rows = found
            if kind == END:
                return
            if rows is not None:
                yield _chunk(kind, rows)

    def notes(self) -> tuple[str, ...]:
        """See `Source`."""
        again = (f"senders connected {self._connections} times",) if self._connections > 1 else ()
        return (*again, *self._complaints)

    def close(self) -> None:
        """See `Source`."""
        self._drop("")
        self._server.close()

    def _accept(self) -> tuple[str, tuple[int, int]] | None:
        """Wait a moment for a sender with a sensor of the right size; its name and size."""
        try:
            connection, _ = self._server.accept()
        except TimeoutError:
            return None
        try:
            with contextlib.suppress(OSError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            connection.settimeout(_HELLO_S)
            kind, length = parse_header(_received(connection, HEADER.size))
            if kind != HELLO:
                raise LiveError(f"a sender begins with the kind {kind.decode()}, expected a hello (H)")
            name, size = parse_hello(_received(connection, length))
            if self._size not in (None, size):
                raise LiveError(f"a sender has {size[0]} x {size[1]} pixels, the first one had {self._size}")
        except (OSError, LiveError) as error:
            connection.close()
            self._complain(str(error))
            return None
        connection.settimeout(_LOOK_S)
        self._connection = connection
        self._connections += 1
        return name, size

    def _frame(
        self, connection: socket.socket, stop: threading.Event
    ) -> tuple[bytes, RecordArray | None] | None:
        """A frame and its rows; None where none begins in time. Raises OSError: the sender went."""
        try:
            first = connection.recv(1)
        except TimeoutError:
            return None
        if not first:
            raise OSError("the sender closed the connection")
        kind, length = parse_header(first + _received(connection, HEADER.size - 1, stop))
        if kind not in ROWS:
            _received(connection, length, stop)
            return kind, None
        rows = np.empty(length // ROWS[kind].itemsize, dtype=ROWS[kind])
        _fill(connection, rows.view(np.uint8).data, stop)
        return kind, rows

    def _drop(self, reason: str) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if reason:
            self._complain(reason)

    def _complain(self, reason: str) -> None:
        if len(self._complaints) < 20:
            self._complaints.append(f"connection dropped: {reason}")


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


def _received(connection: socket.socket, length: int, stop: threading.Event | None = None) -> bytes:
    data = bytearray(length)
    _fill(connection, memoryview(data), stop)
    return bytes(data)


def _fill(connection: socket.socket, view: memoryview, stop: threading.Event | None = None) -> None:
    """Receive until the view is full; a sender may pause within a frame. Raises OSError: it is gone."""
    done = 0
    while done < len(view):
        try:
            count = connection.recv_into(view[done:])
        except TimeoutError:
            if stop is None or stop.is_set():
                raise OSError("the sender stopped in the middle of a frame") from None
            continue
        if count == 0:
            raise OSError("the sender closed the connection in the middle of a frame")
        done += count
