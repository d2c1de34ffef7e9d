"""What the tests of the front end share: a second of simulated events, and hand-made patches."""

from __future__ import annotations

import dataclasses

import pytest

from asyneio.simulation import EVENT_SCENARIOS, EventSimulation, simulate_events


@pytest.fixture(scope="session")
def simulation() -> EventSimulation:
    """One second in a room, slowly: some 400 000 events."""
    return simulate_events(dataclasses.replace(EVENT_SCENARIOS["event_slow"], duration_s=1.0))
