"""Progress bars: rate and time left on a terminal, nothing elsewhere."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest
from rich.console import Console

from asyneio.cli import progress


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """Record what a terminal would receive; the clock advances by half a second at every reading."""
    sent = io.StringIO()
    now = iter(0.7 * n for n in range(10_000))

    def terminal(**_: object) -> Console:
        return Console(file=sent, force_terminal=True, width=120, get_time=lambda: next(now))

    monkeypatch.setattr(progress, "Console", terminal)
    return sent


@pytest.mark.slow
def test_share_with_a_rate(shown: io.StringIO) -> None:
    with progress.share_progress("tracking", 100.0, "Mev/s") as advance:
        for k in range(5):
            advance(k / 4)
            time.sleep(0.12)
    assert "tracking" in shown.getvalue()
    assert "Mev/s" in shown.getvalue()


@pytest.mark.slow
def test_reading_counts_the_bytes_of_files_and_folders(shown: io.StringIO, tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"0" * 2_000_000)
    for path in (tmp_path, tmp_path / "a.bin"):
        with progress.reading_progress(path) as advance:
            for share in (0.0, 0.5, 1.0):
                advance(share)
                time.sleep(0.12)
        assert "MB/s" in shown.getvalue()
    with progress.reading_progress(tmp_path / "absent") as advance:
        advance(1.0)


@pytest.mark.slow
def test_what_was_done_before_has_no_rate(shown: io.StringIO) -> None:
    with progress.event_progress("converting", 10_000_000) as advance:
        advance(9_000_000)
        time.sleep(0.12)
        advance(9_000_000)
        time.sleep(0.12)
    assert "Mev/s" not in shown.getvalue()
    with progress.task_progress("schemes") as tell:
        for k in range(4):
            tell(10 + k, 20, 2)
            time.sleep(0.12)
    assert "13/20" in shown.getvalue()
    assert "/s, 2 failed" in shown.getvalue()


def test_without_a_terminal_nothing_is_sent(capsys: pytest.CaptureFixture[str]) -> None:
    with progress.share_progress("tracking", 1.0, "Mev") as advance:
        advance(1.0)
    assert capsys.readouterr() == ("", "")
