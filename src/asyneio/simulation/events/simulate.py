"""Run an event scenario: a recording as a reader would deliver it, and the truth behind it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from asyneio.simulation.events.point_truth import PointTruth
from asyneio.simulation.events.readout import ReadoutCounts
from asyneio.simulation.events.scenario import EventScenario
from asyneio.simulation.events.source import Stage, event_chunks, set_stage
from asyneio.simulation.events.world import World
from asyneio.simulation.rig import InertialRun, calibration_of, simulate_inertial
from asyneio.simulation.truth import Truth
from asyneio.types import EVENT_DTYPE, NS_PER_S, EventRecording, RecordArray


@dataclass(frozen=True)
class EventSimulation:
    """A simulated run: `recording` (events in the camera clock, all else in the IMU clock), the true states
    of the body, the world, the truth for points and feature tracks, and what became of the events in the
    readout of the sensor (None where events were given)."""

    scenario: EventScenario
    recording: EventRecording
    truth: Truth
    world: World
    points: PointTruth
    readout: ReadoutCounts | None = None


def stream_events(scenario: EventScenario, counts: ReadoutCounts | None = None) -> Iterator[RecordArray]:
    """Events of a scenario (EVENT_DTYPE, camera clock, ascending), some milliseconds in each chunk.

    The memory it needs does not depend on the duration. Together the chunks are the events of
    `simulate_events`. `counts` are added to as events leave the sensor or are lost in its readout.

    Raises:
        SimulationError: the scenario is impossible.
    """
    seeds = _seeds(scenario)
    yield from event_chunks(set_stage(scenario, seeds), seeds[2], counts)


def simulate_events(scenario: EventScenario, events: RecordArray | None = None) -> EventSimulation:
    """Simulate a scenario; the same scenario gives the same arrays.

    Args:
        scenario: what to simulate.
        events: those of the same scenario, where they were made before (by `stream_events`); all else is made
            in a second.

    Raises:
        SimulationError: the scenario is impossible.
    """
    seeds = _seeds(scenario)
    stage = set_stage(scenario, seeds)
    inertial = _inertial(scenario, stage, seeds)
    readout = None
    if events is None:
        readout = ReadoutCounts()
        chunks = event_chunks(stage, seeds[2], readout)
        events = np.concatenate([np.empty(0, dtype=EVENT_DTYPE), *chunks])
    recording = EventRecording(
        name=f"{scenario.name}-{scenario.seed}",
        events=events,
        width=scenario.camera.width,
        height=scenario.camera.height,
        gyroscope=inertial.gyroscope,
        accelerometer=inertial.accelerometer,
        camera=scenario.camera,
        calibration=calibration_of(scenario),
        ground_truth=inertial.truth.poses(scenario.ground_truth_rate_hz),
    )
    points = PointTruth(
        stage.motion,
        stage.world,
        scenario.camera,
        scenario.T_b_c,
        scenario.start_ns - scenario.timeshift_ns,
    )
    return EventSimulation(scenario, recording, inertial.truth, stage.world, points, readout)


def _inertial(scenario: EventScenario, stage: Stage, seeds: list[np.random.SeedSequence]) -> InertialRun:
    """The real samples of a recorded motion, or simulated ones."""
    real = scenario.recorded.samples if scenario.recorded else None
    if real is None:
        return simulate_inertial(
            scenario, stage.motion, np.random.default_rng(seeds[3]), np.random.default_rng(seeds[4])
        )
    end_ns = scenario.start_ns + round(scenario.duration_s * NS_PER_S)
    truth = Truth(scenario.start_ns, end_ns, stage.motion, real.bias_gyroscope, real.bias_accelerometer)
    return InertialRun(real.gyroscope, real.accelerometer, truth)


def _seeds(scenario: EventScenario) -> list[np.random.SeedSequence]:
    """One for motion, world, sensor, gyroscope, accelerometer and the person each."""
    return np.random.SeedSequence(scenario.seed).spawn(6)
