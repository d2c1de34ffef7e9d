# SPDX-License-Identifier: Apache-2.0
"""Lines of JSON to standard output and to programs that connect over TCP; no reader can hold up the run."""

from __future__ import annotations

import os
import queue
import select
import socket
import threading
import time
from collections.abc import Callable
from typing import IO

from asyneio.errors import LiveError
from asyneio.live.chunks import Sensor
from asyneio.live.lines import step_lines
from asyneio.live.step import LiveStep

#: Largest number of lines that wait for a reader (about 3 MB); a slower reader misses the oldest.
_MOST_LINES = 1000
#: Largest number of readers of a socket; further ones are disconnected.
_MOST_READERS = 20
#: A reader that takes nothing for this time [s] is disconnected.
_STALLED_S = 10.0
#: How long [s] the end of a run waits until readers have taken what waits.
_LAST_S = 2.0


class _Writer:
    """A thread that writes lines for one reader.

    Attributes:
        missed: number of lines that were left out because the reader was too slow.
        error: why nothing more can be written; None while it can.
    """

    def __init__(self, write: Callable[[bytes], None], name: str) -> None:
        self._write = write
        self._lines: queue.Queue[bytes | None] = queue.Queue(_MOST_LINES)
        self.missed = 0
        self.error: OSError | None = None
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def put(self, line: bytes | None) -> None:
        """Add a line without waiting; None ends the thread after the lines that wait."""
        while self.error is None:
            try:
                self._lines.put_nowait(line)
                return
            except queue.Full:
                try:
                    self._lines.get_nowait()
                    self.missed += 1
                except queue.Empty:
                    continue

    def join(self, until_s: float) -> None:
        """Wait for the end of the thread until a time of `time.perf_counter`."""
        self._thread.join(timeout=max(until_s - time.perf_counter(), 0.0))
        self.missed += self._lines.qsize() - 1 if self._thread.is_alive() else 0

    def _work(self) -> None:
        while (line := self._lines.get()) is not None:
            try:
                self._write(line)
            except OSError as error:
                self.error = error
                return


class LineOutput:
    """Lines of JSON into an open file, such as standard output.

    A file with a descriptor is written without Python's buffer: a thread that waits for a reader would hold
    the lock of the buffer, and the process could not end.
    """

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._descriptor = _descriptor_of(stream)
        self._writer: _Writer | None = None

    def begin(self, sensor: Sensor) -> None:
        """See `Output`."""
        self._stream.flush()
        self._writer = _Writer(self._write, "lines")

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        assert self._writer is not None
        for line in step_lines(step):
            self._writer.put(line.encode())

    def end(self) -> None:
        """See `Output`."""
        if self._writer is not None:
            self._writer.put(None)
            self._writer.join(time.perf_counter() + _LAST_S)

    def notes(self) -> tuple[str, ...]:
        """See `Output`."""
        if self._writer is None:
            return ()
        if isinstance(self._writer.error, BrokenPipeError):
            return ("standard output was closed by its reader: the later lines are missing there",)
        return (self.failure,) if self.failure else _missed_note(self._writer.missed, "standard output")

    @property
    def failure(self) -> str:
        """Why lines are missing that a reader was ready to take; empty if there is no such reason."""
        error = self._writer.error if self._writer is not None else None
        if error is None or isinstance(error, BrokenPipeError):
            return ""
        return f"cannot write to standard output: {error.strerror or error}; the later lines are missing"

    def _write(self, line: bytes) -> None:
        if self._descriptor is None:
            self._stream.write(line.decode())
            self._stream.flush()
            return
        view = memoryview(line)
        while view:
            try:
                view = view[os.write(self._descriptor, view) :]
            except BlockingIOError:
                select.select([], [self._descriptor], [], 1.0)


class SocketOutput:
    """Lines of JSON to every program that connects; what a program sends is ignored.

    Attributes:
        port: at which it listens.

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
        self._missed = self._rejected = 0
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
                if writer.error is not None:
                    self._missed += writer.missed
                    connection.close()
            self._writers = [pair for pair in self._writers if pair[1].error is None]

    def end(self) -> None:
        """See `Output`."""
        self._server.close()
        until_s = time.perf_counter() + _LAST_S
        with self._lock:
            for _, writer in self._writers:
                writer.put(None)
            for connection, writer in self._writers:
                writer.join(until_s)
                self._missed += writer.missed
                connection.close()
            self._writers = []

    def notes(self) -> tuple[str, ...]:
        """See `Output`."""
        rejected = (
            (f"{self._rejected} reader(s) were disconnected: at most {_MOST_READERS} at a time",)
            if self._rejected
            else ()
        )
        return (*_missed_note(self._missed, "the socket"), *rejected)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._server.accept()
            except OSError:
                return
            with self._lock:
                if len(self._writers) >= _MOST_READERS:
                    self._rejected += 1
                    connection.close()
                    continue
                connection.settimeout(_STALLED_S)
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


def _descriptor_of(stream: IO[str]) -> int | None:
    """Number of the open file behind a stream; None if there is none."""
    try:
        return stream.fileno()
    except (OSError, ValueError, AttributeError):
        return None


def _missed_note(missed: int, where: str) -> tuple[str, ...]:
    return (f"{missed} line(s) were left out for a slow reader of {where}",) if missed else ()
