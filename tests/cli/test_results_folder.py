"""Interrupts while a folder of results is written."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from asyneio.cli.results_folder import results_folder


class Released:
    """An object during whose release a signal arrives."""

    def __init__(self, number: int) -> None:
        self._number = number

    def __del__(self) -> None:
        signal.raise_signal(self._number)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_an_object_is_released_is_not_lost(
    number: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Python ignores exceptions of `__del__`, and prints a traceback."""

    def work() -> None:
        Released(number)
        for _ in range(500):
            time.sleep(0.01)

    before = signal.getsignal(signal.SIGINT)
    with results_folder(tmp_path), pytest.raises(KeyboardInterrupt):
        work()
    assert signal.getsignal(signal.SIGINT) is before
    assert "Traceback" not in capfd.readouterr().err
