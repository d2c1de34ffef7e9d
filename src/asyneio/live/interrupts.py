# SPDX-License-Identifier: Apache-2.0
"""Signals that end a live run between two steps."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """Number of signals so far."""

    count = 0


@contextmanager
def ending_softly(end: Callable[[], None]) -> Iterator[Interrupts]:
    """Inside the block, the first Ctrl-C or SIGTERM calls `end`; the second one raises KeyboardInterrupt.

    An interrupted step would leave the estimator in an inconsistent state. Outside the main thread, where no
    signal arrives, nothing is changed.
    """
    seen = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield seen
        return

    def handle(number: int, frame: FrameType | None) -> None:
        seen.count += 1
        if seen.count > 1:
            raise KeyboardInterrupt
        end()

    before: list[Any] = [signal.signal(number, handle) for number in _SIGNALS]
    try:
        yield seen
    finally:
        for number, handler in zip(_SIGNALS, before, strict=True):
            signal.signal(number, handler)
