# SPDX-License-Identifier: Apache-2.0
"""Outlier tracks added to a simulated recording: tracks on a moving object, or tracks that drift.

Tests and `benchmarks/outliers.py` use this module to measure outlier rejection; no command does. The tracks
of the static scene, the inertial samples and the ground truth are unchanged, so runs with and without
outliers differ only in the outliers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.simulation.camera import PinholeCamera
from asyneio.simulation.motion import AnalyticMotion, Sinusoids
from asyneio.simulation.moving import MovingObject
from asyneio.simulation.tracks.observations import Viewer, simulate_tracks
from asyneio.simulation.tracks.simulate import Simulation
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, FloatArray, IntArray, Recording

_POINTS = 400
#: Amplitude of an object that moves back and forth [m].
_AMPLITUDE_M = 0.5


def swaying_object(
    simulation: Simulation, speed: float, direction_w: FloatArray, distance: float, seed: int = 0
) -> MovingObject:
    """A box in front of the camera's mean pose that moves back and forth by half a metre.

    Args:
        simulation: simulation whose camera sees the box.
        speed: maximum speed [m/s].
        direction_w: (3,) direction of the motion, of any length.
        distance: distance of its centre from the camera's mean position [m]; its width is 0.6 times that.
        seed: seed of the points on it and of its phase at the start.
    """
    scenario = simulation.scenario
    rng = np.random.default_rng([seed, 76])
    times = np.linspace(scenario.camera_offset_s, scenario.duration_s, 50)
    T_w_c = simulation.truth.motion.T_w_b(times) @ scenario.T_b_c
    axis = T_w_c[:, :3, 2].mean(axis=0)
    amplitude, frequency, phase = np.zeros((6, 1)), np.zeros((6, 1)), np.zeros((6, 1))
    amplitude[:3, 0] = _AMPLITUDE_M * direction_w / np.linalg.norm(direction_w)
    frequency[:3] = speed / (2.0 * np.pi * _AMPLITUDE_M)
    phase[:3] = rng.uniform(0.0, 2.0 * np.pi)
    offset = np.zeros(6)
    offset[:3] = T_w_c[:, :3, 3].mean(axis=0) + distance * axis / np.linalg.norm(axis)
    points = rng.uniform(-0.3 * distance, 0.3 * distance, (_POINTS, 3))
    return MovingObject(AnalyticMotion(Sinusoids(amplitude, frequency, phase, offset)), points)


def with_object(
    simulation: Simulation, moving: MovingObject, share: float, seed: int = 0
) -> tuple[Recording, IntArray]:
    """Add tracks on a moving object, `share` of all live tracks; returns the recording and their ids.

    Raises:
        SimulationError: the camera never sees the object.
    """
    scenario = simulation.scenario
    camera = PinholeCamera.from_intrinsics(scenario.camera)
    # Without a scene, there are tracks only while the object is in view.
    nowhere = np.full((1, 3), np.nan)
    viewer = Viewer(simulation.truth.motion, camera, scenario.T_b_c, nowhere, moving)
    alive = round(scenario.tracks.features_alive * share / (1.0 - share))
    spec = replace(scenario.tracks, features_alive=alive, outlier_fraction=0.0, moving_share=1.0)
    rng = np.random.default_rng([seed, 77])
    tracks = simulate_tracks(viewer, spec, scenario.camera_offset_s, scenario.duration_s, rng)
    added = np.zeros(tracks.t_ns.size, dtype=OBSERVATION_DTYPE)
    added["t_ns"] = scenario.start_ns + tracks.t_ns
    added["id"] = tracks.track + simulation.recording.observations["id"].max() + 1
    added["u"], added["v"] = tracks.pixels.T
    merged = np.concatenate([simulation.recording.observations, added])
    merged = merged[np.argsort(merged["t_ns"], kind="stable")]
    return replace(simulation.recording, observations=merged), np.unique(added["id"])


def with_wrong_tracks(
    recording: Recording, share: float, speed_px_s: tuple[float, float], seed: int = 0
) -> tuple[Recording, IntArray]:
    """Make this share of the tracks drift, each with its own velocity; returns the recording and their ids.

    A corner that slides along an edge drifts at 5 to 20 px/s, a false track at 30 to 150 px/s.
    """
    rng = np.random.default_rng([seed, 78])
    observations = recording.observations.copy()
    ids, first, track = np.unique(observations["id"], return_index=True, return_inverse=True)
    wrong = rng.random(len(ids)) < share
    angle = rng.uniform(0.0, 2.0 * np.pi, len(ids))
    speed = np.where(wrong, rng.uniform(*speed_px_s, len(ids)), 0.0)
    age = (observations["t_ns"] - observations["t_ns"][first][track]) / NS_PER_S
    observations["u"] += age * (speed * np.cos(angle))[track]
    observations["v"] += age * (speed * np.sin(angle))[track]
    return replace(recording, observations=observations), ids[wrong]
