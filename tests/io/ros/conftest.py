"""A recording and the messages of a bag with it."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.types import EventRecording
from tests.io.event_recordings import make_event_recording
from tests.io.ros.bags import Record, recording_records


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    return make_event_recording(np.random.default_rng(11), 3000)


@pytest.fixture(scope="module")
def records(recording: EventRecording) -> list[Record]:
    return recording_records(recording)
