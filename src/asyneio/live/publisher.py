# SPDX-License-Identifier: Apache-2.0
"""Lines of JSON to standard output and to programs that connect over TCP; no reader can hold up the run."""

from __future__ import annotations

import queue
import socket
import threading
from collections.abc import Callable
from typing import IO

from asyneio.errors import LiveError
from asyneio.live.chunks import Sensor
from asyneio.live.lines import step_lines
from asyneio.live.step import LiveStep

#: Largest number of lines that wait for a reader; a slower reader misses the oldest.
_MOST_LINES = 1000
#: A reader that takes nothing for so long [s] is disconnected.
_STALLED_S = 10.0


class _Writer:
    """A thread that writes lines for one reader."""

    def __init__(self, write: Callable[[bytes], None], name: str) -> None:
        self._write = write
        self._lines: queue.Queue[bytes | None] = queue.Queue(_MOST_LINES)
        self.missed = 0
        self.gone = False
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def put(self, line: bytes | None) -> None:
        """Add a line, without waiting; None ends the thread once all is written."""
        while True:
            try:
                self._lines.put_nowait(line)
                return
            except queue.Full:
                try:
                    self._lines.get_nowait()
                    self.missed += 1
                except queue.Empty:
                    continue

    def end(self) -> None:
        """Write what waits, for two seconds at most."""
        self.put(None)
        self._thread.join(timeout=2.0)

    def _work(self) -> None:
        while (line := self._lines.get()) is not None:
            try:
                self._write(line)
            except OSError:
                self.gone = True
                return


class LineOutput:
    """Lines of JSON into an open file, such as standard output."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._writer: _Writer | None = None

    def begin(self, sensor: Sensor) -> None:
        """See `Output`."""
        self._writer = _Writer(self._write, "lines")

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        assert self._writer is not None
        for line in step_lines(step):
            self._writer.put(line.encode())

    def end(self) -> None:
        """See `Output`."""
        if self._writer is not None:
            self._writer.end()

    def _write(self, line: bytes) -> None:
        self._stream.write(line.decode())
        self._stream.flush()


class SocketOutput:
    """Lines of JSON to every program that connects.

    Args:
        host, port: where to listen; port 0: any free one.

    Raises:
        LiveError: the address cannot be listened on.
    """

    def __init__(self, host: str, port: int) -> None:
        self._server = listening_socket(host, port)
        self.port = int(self._server.getsockname()[1])
        self._writers: list[tuple[socket.socket, _Writer]] = []
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._accept, name="listen", daemon=True)

    def begin(self, sensor: Sensor) -> None:
        """See `Output`."""
        self._thread.start()

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        lines = [line.encode() for line in step_lines(step)]
        with self._lock:
            for connection, writer in self._writers:
                for line in lines:
                    writer.put(line)
                if writer.gone:
                    connection.close()
            self._writers = [pair for pair in self._writers if not pair[1].gone]

    def end(self) -> None:
        """See `Output`."""
        self._server.close()
        with self._lock:
            for connection, writer in self._writers:
                writer.end()
                connection.close()
            self._writers = []

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._server.accept()
            except OSError:
                return
            connection.settimeout(_STALLED_S)
            with self._lock:
                self._writers.append((connection, _Writer(connection.sendall, "reader")))


def listening_socket(host: str, port: int) -> socket.socket:
    """A TCP socket that listens. Raises LiveError: the address is in use, or is not one of this machine."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family, backlog=8)
    except (OSError, OverflowError) as error:
        raise LiveError(
            f"cannot listen at {host}:{port}: {getattr(error, 'strerror', None) or error}; choose an address "
            "of this machine and a port from 1024 to 65535 that no other program uses"
        ) from error
