# SPDX-License-Identifier: Apache-2.0
"""Rerun's viewer in a process of its own, which only this machine can reach."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from typing import IO

#: The viewer forgets the oldest data beyond this, in its window and in its server for later windows.
MEMORY_LIMIT, _SERVER_LIMIT = "1GB", "100MB"
_HOST = "127.0.0.1"
#: How long [s] a viewer may take to listen, and how long it must run then: without a screen it ends.
_PATIENCE_S, _ALIVE_S = 30.0, 1.5


@dataclass(frozen=True)
class Viewer:
    """A running viewer: the URL of its server, and its process."""

    url: str
    process: subprocess.Popen[bytes]

    def end(self) -> None:
        """End it at once."""
        if sys.platform == "win32":
            self.process.kill()
        else:
            os.killpg(self.process.pid, signal.SIGKILL)  # rerun_cli starts a process of its own.


def start_viewer() -> Viewer:
    """Start a viewer. Its window stays after the end of the run.

    rerun's own `spawn` finds its program only on the PATH, and the server of that viewer accepts connections
    from the network.

    Raises:
        RuntimeError: it did not start; the message is the viewer's own.
    """
    with socket.create_server((_HOST, 0)) as probe:
        port = int(probe.getsockname()[1])
    command = [sys.executable, "-m", "rerun_cli", "--bind", _HOST, "--port", str(port)]
    limits = ["--memory-limit", MEMORY_LIMIT, "--server-memory-limit", _SERVER_LIMIT]
    hints = ["--hide-welcome-screen", "--expect-data-soon"]
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as log:
        process = subprocess.Popen(
            [*command, *limits, *hints],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=log,
            start_new_session=True,  # Ctrl-C ends the run, and the window stays.
        )
        viewer = Viewer(f"rerun+http://{_HOST}:{port}/proxy", process)
        _wait_for(viewer, port, log)
    return viewer


def _wait_for(viewer: Viewer, port: int, log: IO[str]) -> None:
    """Wait until the viewer listens and stays."""
    started_s = time.perf_counter()
    listening_s: float | None = None
    while listening_s is None or time.perf_counter() - listening_s < _ALIVE_S:
        if viewer.process.poll() is not None:
            raise RuntimeError(_reason(log) or f"it ended with status {viewer.process.returncode}")
        if listening_s is None and _listens(port):
            listening_s = time.perf_counter()
        if listening_s is None and time.perf_counter() - started_s > _PATIENCE_S:
            viewer.end()
            raise RuntimeError(f"it does not listen after {_PATIENCE_S:.0f} s")
        time.sleep(0.05)


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((_HOST, port)) == 0


def _reason(log: IO[str]) -> str:
    """The last line of the viewer's messages, without the places in its source."""
    log.seek(0)
    lines = [line.strip() for line in log if line.strip()]
    if not lines:
        return ""
    return (lines[-1].rpartition(".rs:")[2].partition(": ")[2] or lines[-1]).rstrip(".")
