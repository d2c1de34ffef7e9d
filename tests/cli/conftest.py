"""A fixture that calls the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from asyneio.cli.main import main

Asyneio = Callable[..., tuple[int, str, str]]


@pytest.fixture
def asyneio(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Asyneio:
    """Call the command line: exit status, standard output, standard error."""
    monkeypatch.setenv("COLUMNS", "100")

    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["asyneio", *map(str, arguments)])
        try:
            main()
            status = 0
        except SystemExit as stop:
            status = int(stop.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call
