# SPDX-License-Identifier: Apache-2.0
"""Ready-made scenarios, of tracks and of events, by name."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from asyneio.errors import SimulationError
from asyneio.simulation.events.scenario import EVENT_SCENARIOS, EventScenario
from asyneio.simulation.tracks.scenario import SCENARIOS, RigScenario, Scenario

_AnyScenario = TypeVar("_AnyScenario", bound=RigScenario)


def scenario_named(name: str) -> Scenario | EventScenario:
    """The ready-made scenario with this name.

    Raises:
        SimulationError: the name is unknown; the message lists all names.
    """
    found: Scenario | EventScenario | None = SCENARIOS.get(name) or EVENT_SCENARIOS.get(name)
    if found is None:
        raise SimulationError(
            f"scenario {name!r} is unknown; expected one of {', '.join([*SCENARIOS, *EVENT_SCENARIOS])}"
        )
    return found


def with_seed_and_duration(
    scenario: _AnyScenario, seed: int | None, duration_s: float | None
) -> _AnyScenario:
    """The scenario with another seed and another duration [s]; None keeps that of the scenario.

    Raises:
        SimulationError: the duration is not positive, or longer than a day.
    """
    scenario = scenario if seed is None else replace(scenario, seed=seed)
    return scenario if duration_s is None else replace(scenario, duration_s=duration_s)
