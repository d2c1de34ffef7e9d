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


@contextmanager
def results_folder(folder: Path) -> Iterator[None]:
    """Inside the block, the folder exists and belongs to this process; SIGTERM is handled like Ctrl-C.

    Temporary files of a killed run are removed at the beginning, the folder itself at the end if it is empty.

    Raises:
        RecordingError: another process writes into the folder, or it cannot be written.
    """
    make_folder(folder)
    try:
        with folder_lock(folder), _interrupted_by_sigterm():
            remove_temporary(folder)
            yield
    finally:
        remove_empty(folder)


@contextmanager
def _interrupted_by_sigterm() -> Iterator[None]:
    """Inside the block, SIGTERM raises KeyboardInterrupt; without effect outside the main thread."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
