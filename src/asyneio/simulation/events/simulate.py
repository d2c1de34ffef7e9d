# SPDX-License-Identifier: Apache-2.0
"""Run an event scenario: a recording as a reader would return it, and its ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from asyneio.simulation.events.point_truth import PointTruth
from asyneio.simulation.events.readout import ReadoutCounts
from asyneio.simulation.events.scenario import EventScenario
from asyneio.simulation.events.source import Seeds, Stage, event_chunks, set_stage
from asyneio.simulation.events.world import World
from asyneio.simulation.rig import InertialRun, calibration_of, simulate_inertial
from asyneio.simulation.truth import Truth
from asyneio.types import EVENT_DTYPE, NS_PER_S, EventRecording, RecordArray


@dataclass(frozen=True)
class EventSimulation:
    """A simulated run.

    Attributes:
        scenario: the simulated scenario.
        recording: events in the camera clock, everything else in the IMU clock.
        truth: true states of the body.
        world: world of textured rectangles.
        points: ground truth for points and feature tracks.
        readout: counts of the sensor's readout; None if the events were given.
    """

    scenario: EventScenario
    recording: EventRecording
    truth: Truth
    world: World
    points: PointTruth
    readout: ReadoutCounts | None = None


def stream_events(scenario: EventScenario, counts: ReadoutCounts | None = None) -> Iterator[RecordArray]:
    """Events of a scenario (EVENT_DTYPE, camera clock, ascending), in chunks of some milliseconds.

    The memory used does not depend on the duration. The chunks together are the events of `simulate_events`.

    Args:
        scenario: the scenario.
        counts: updated as events leave the sensor or are lost in its readout.

    Raises:
        SimulationError: the scenario cannot be simulated.
    """
    seeds = Seeds.of(scenario.seed)
    yield from event_chunks(set_stage(scenario, seeds), seeds.sensor, counts)


def simulate_events(scenario: EventScenario, events: RecordArray | None = None) -> EventSimulation:
    """Simulate a scenario; the same scenario gives the same arrays.

    Args:
        scenario: the scenario.
        events: events of the same scenario from an earlier `stream_events`; the other parts take about a
            second.

    Raises:
        SimulationError: the scenario cannot be simulated.
    """
    seeds = Seeds.of(scenario.seed)
    stage = set_stage(scenario, seeds)
    inertial = _inertial(scenario, stage, seeds)
    readout = None
    if events is None:
        readout = ReadoutCounts()
        chunks = event_chunks(stage, seeds.sensor, readout)
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


def _inertial(scenario: EventScenario, stage: Stage, seeds: Seeds) -> InertialRun:
    """The real samples of a recorded motion, otherwise simulated ones."""
    real = scenario.recorded.samples if scenario.recorded else None
    if real is None:
        return simulate_inertial(
            scenario,
            stage.motion,
            np.random.default_rng(seeds.gyroscope),
            np.random.default_rng(seeds.accelerometer),
        )
    end_ns = scenario.start_ns + round(scenario.duration_s * NS_PER_S)
    truth = Truth(scenario.start_ns, end_ns, stage.motion, real.bias_gyroscope, real.bias_accelerometer)
    return InertialRun(real.gyroscope, real.accelerometer, truth)
