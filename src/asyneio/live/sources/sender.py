# SPDX-License-Identifier: Apache-2.0
"""One connection of the socket protocol: frames, as they become complete."""

from __future__ import annotations

import contextlib
import socket
import time

import numpy as np

from asyneio.errors import LiveError
from asyneio.live.protocol import END, HEADER, HELLO, ROWS, parse_header, parse_hello
from asyneio.types import RecordArray

#: How long [s] a wait for data lasts.
_LOOK_S = 0.1
#: A sender must send its hello within this time [s].
_HELLO_S = 5.0
_BUFFER_BYTES = 8 * 2**20


class Sender:
    """A connected sender, which may pause anywhere, also within a frame.

    Attributes:
        hello: name and size (width, height) of its sensor; None until it has sent them.

    Args:
        connection: an accepted connection.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        connection.settimeout(_LOOK_S)
        self._connected_s = self._heard_s = time.perf_counter()
        self.hello: tuple[str, tuple[int, int]] | None = None
        self._await_header()

    def read(self) -> tuple[bytes, RecordArray] | None:
        """Kind and rows of the next frame; None if none is complete within 0.1 s.

        A hello sets `hello` and has no rows.

        Raises:
            OSError: the connection is closed.
            LiveError: the data are no frames of the protocol, or there is no hello.
        """
        until_s = time.perf_counter() + _LOOK_S
        while time.perf_counter() < until_s:
            if not self._receive():
                break
            if self._done == len(self._view) and (frame := self._completed()) is not None:
                return frame
        if self.hello is None and time.perf_counter() - self._connected_s > _HELLO_S:
            raise LiveError(f"a sender connected and sent no hello within {_HELLO_S:.0f} s")
        return None

    def silence_s(self) -> float:
        """Seconds since data arrived."""
        return time.perf_counter() - self._heard_s

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def _await_header(self) -> None:
        self._kind: bytes | None = None
        self._view, self._done = memoryview(bytearray(HEADER.size)), 0

    def _receive(self) -> bool:
        """Receive a part of the frame; whether there was one."""
        try:
            count = self._connection.recv_into(self._view[self._done :])
        except TimeoutError:
            return False
        if count == 0:
            within = self._kind is not None or self._done > 0
            raise OSError("the sender closed the connection" + " in the middle of a frame" * within)
        self._heard_s = time.perf_counter()
        self._done += count
        return True

    def _completed(self) -> tuple[bytes, RecordArray] | None:
        """The frame, if it is complete and not only its header."""
        if self._kind is None:
            self._kind, length = parse_header(self._view)
            if self.hello is None and self._kind != HELLO:
                raise LiveError(f"a sender begins with the kind {self._kind.decode()}, expected a hello (H)")
            dtype = ROWS.get(self._kind, np.dtype(np.uint8))
            self._rows = np.empty(length // dtype.itemsize, dtype=dtype)
            self._view, self._done = memoryview(self._rows.view(np.uint8).data), 0
            if length:
                return None
        kind, rows = self._kind, self._rows
        self._await_header()
        if kind == HELLO:
            self.hello = parse_hello(rows.tobytes())
        return kind, rows if kind not in (HELLO, END) else rows[:0]
