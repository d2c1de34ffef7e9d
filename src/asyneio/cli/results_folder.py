# SPDX-License-Identifier: Apache-2.0
"""The folder of results while a run writes into it: created, locked, without temporary files afterwards."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from asyneio.io.parsing.atomic import make_folder, remove_empty, remove_temporary
from asyneio.io.parsing.folder_lock import folder_lock

#: Folder of the checkpoints inside the folder of results.
CHECKPOINT_FOLDER = ".checkpoint"
#: Time after which an interrupt is repeated [s].
_AGAIN_S = 0.02


@contextmanager
def results_folder(folder: Path) -> Iterator[None]:
    """Inside the block, the folder exists and belongs to this process; SIGTERM is handled like Ctrl-C, and
    neither is lost.

    Temporary files of a killed run are removed at the beginning, the folder itself at the end if it is empty.

    Raises:
        RecordingError: another process writes into the folder, or it cannot be written.
    """
    make_folder(folder)
    try:
        with folder_lock(folder), _interrupts():
            remove_temporary(folder)
            yield
    finally:
        remove_empty(folder)


@contextmanager
def _interrupts() -> Iterator[None]:
    """Inside the block, SIGTERM and Ctrl-C raise KeyboardInterrupt; without effect outside the main thread.

    Python only prints an exception that is raised in a `__del__`, and kernels that are being compiled release
    many objects: there, the interrupt is repeated a little later.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        while frame is not None:
            if frame.f_code.co_name == "__del__":
                again = threading.Timer(_AGAIN_S, signal.raise_signal, (number,))
                again.daemon = True
                again.start()
                return
            frame = frame.f_back
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # A shell ignores SIGINT in what it starts in the background; that stays.
    handled = [signal.SIGTERM]
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        handled.append(signal.SIGINT)
    before = {number: signal.signal(number, interrupt) for number in handled}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
