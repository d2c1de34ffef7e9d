"""Small worlds, cameras and stages for the tests of the event simulator."""

import dataclasses

import numpy as np

from asyneio.simulation import EVENT_SCENARIOS, AnalyticMotion, EventScenario, SensorSpec, Sinusoids
from asyneio.simulation.events.pyramid import build_pyramids
from asyneio.simulation.events.source import Stage
from asyneio.simulation.events.view import view_of
from asyneio.simulation.events.world import World
from asyneio.simulation.rig import C_F_C
from asyneio.types import CameraIntrinsics, Distortion, FloatArray

#: A lens with the distortion of the DAVIS240C on a quarter of the pixels.
SMALL = CameraIntrinsics(80.0, 80.0, 49.5, 35.0, 100, 72, Distortion.RADTAN, (-0.37, 0.15, -0.0003, -0.0008))
STRAIGHT = CameraIntrinsics(80.0, 80.0, 49.5, 35.5, 100, 72)

#: A sensor that answers to light alone, at once.
IDEAL = SensorSpec(
    threshold_mismatch=0.03,
    threshold_noise=0.0,
    refractory_s=0.0,
    latency_s=0.0,
    latency_jitter_s=0.0,
    shot_noise_hz=0.0,
    leak_hz=0.0,
    hot_pixels=0,
    bandwidth_hz=0.0,
    readout_hz=0.0,
    bus_hz=0.0,
)


def small_scenario(**changes: object) -> EventScenario:
    """A third of a second of gentle motion in the near world, seen through the small camera."""
    near = EVENT_SCENARIOS["event_near"]
    scenario = dataclasses.replace(near, motion="gentle", motion_scale=0.4, camera=SMALL, duration_s=0.3)
    return dataclasses.replace(scenario, **changes)


def walls(textures: list[FloatArray], depths: list[float], sides: list[float]) -> World:
    """Squares across the world's x axis: texture, distance and length of the sides of each, in metres."""
    corner = np.array([[d, 0.5 * s, -0.5 * s] for d, s in zip(depths, sides, strict=True)])
    edge_u = np.array([[0.0, -s, 0.0] for s in sides])
    edge_v = np.array([[0.0, 0.0, s] for s in sides])
    reach = np.full(3, 100.0)
    return World(corner, edge_u, edge_v, build_pyramids(textures), -reach, reach)


def drifting(velocity: tuple[float, float, float]) -> AnalyticMotion:
    """A camera (mounted at the body) that looks along x and drifts without turning [m/s]."""
    none = np.zeros((6, 1))
    drift = np.array([*velocity, 0.0, 0.0, 0.0])
    return AnalyticMotion(Sinusoids(none, none, none, drift=drift), C_F_C)


def stage_of(world: World, motion: AnalyticMotion, scenario: EventScenario) -> Stage:
    """A stage with the camera at the body."""
    scenario = dataclasses.replace(scenario, T_b_c=np.eye(4))
    return Stage(scenario, motion, world, view_of(scenario.camera))
