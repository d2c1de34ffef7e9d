"""A recording to convert, in small pieces."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.types import EventRecording
from tests.io.event_recordings import make_event_recording


@pytest.fixture
def recording(rng: np.random.Generator) -> EventRecording:
    return make_event_recording(rng, 3000)


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.io.conversion.convert.PIECE_EVENTS", 100)
