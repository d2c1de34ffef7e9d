# SPDX-License-Identifier: Apache-2.0
"""Run a scenario: a recording as a reader would return it, and its ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.simulation.camera import BoolArray, PinholeCamera
from asyneio.simulation.motion import Motion
from asyneio.simulation.motion_styles import draw_motion
from asyneio.simulation.moving import MovingObject, draw_person
from asyneio.simulation.pause import PausedMotion
from asyneio.simulation.rig import C_F_C, calibration_of, simulate_inertial
from asyneio.simulation.scene import draw_landmarks
from asyneio.simulation.tracks.observations import Tracks, Viewer, simulate_tracks
from asyneio.simulation.tracks.scenario import Scenario
from asyneio.simulation.truth import Truth
from asyneio.types import OBSERVATION_DTYPE, FloatArray, IntArray, RecordArray, Recording

#: Number of points on a moving object, more than the number of tracks on it.
_OBJECT_POINTS = 1000


@dataclass(frozen=True)
class Simulation:
    """A simulated run.

    All times of `recording` are in the IMU clock. `landmarks_w` (L,3) [m] are the landmarks.
    `landmark_of_track` (K,) is the landmark of each track id; indices from L on are points of
    `moving_object`. `outlier` (M,) is true for displaced observations.
    """

    scenario: Scenario
    recording: Recording
    truth: Truth
    landmarks_w: FloatArray
    landmark_of_track: IntArray
    outlier: BoolArray
    moving_object: MovingObject | None = None

    @property
    def on_object(self) -> BoolArray:
        """Whether each observation (M,) is on the moving object."""
        landmark = self.landmark_of_track[self.recording.observations["id"]]
        return np.asarray(landmark >= len(self.landmarks_w))

    def observations_in_camera_clock(self) -> RecordArray:
        """The observations in the camera clock, `t_cam = t_imu - timeshift`, for writing files."""
        observations = self.recording.observations.copy()
        observations["t_ns"] -= self.scenario.timeshift_ns
        return observations


def simulate(scenario: Scenario) -> Simulation:
    """Simulate a scenario; the same scenario gives the same arrays.

    Raises:
        SimulationError: the scenario cannot be simulated, or its camera never sees a landmark.
    """
    seeds = np.random.SeedSequence(scenario.seed).spawn(6)
    for_motion, for_scene, for_tracks, for_gyroscope, for_accelerometer, for_object = map(
        np.random.default_rng, seeds
    )
    # The carrier frame is that of the camera, not of the body, so the mounting of the IMU does not change the
    # view.
    mounting = C_F_C @ scenario.T_b_c[:3, :3].T
    motion: Motion = draw_motion(scenario.motion, for_motion, mounting, scenario.motion_scale)
    if scenario.pause_s is not None:
        motion = PausedMotion(motion, *scenario.pause_s)
    landmarks_w = draw_landmarks(scenario.scene, scenario.landmarks, for_scene)
    camera = PinholeCamera.from_intrinsics(scenario.camera)
    moving = draw_person(_OBJECT_POINTS, for_object) if scenario.tracks.moving_share > 0.0 else None
    viewer = Viewer(motion, camera, scenario.T_b_c, landmarks_w, moving)
    tracks = simulate_tracks(
        viewer, scenario.tracks, scenario.camera_offset_s, scenario.duration_s, for_tracks
    )
    inertial = simulate_inertial(scenario, motion, for_gyroscope, for_accelerometer)
    recording = Recording(
        name=f"{scenario.name}-{scenario.seed}",
        observations=_observation_records(scenario.start_ns, tracks),
        gyroscope=inertial.gyroscope,
        accelerometer=inertial.accelerometer,
        calibration=calibration_of(scenario),
        ground_truth=inertial.truth.poses(scenario.ground_truth_rate_hz),
    )
    return Simulation(
        scenario, recording, inertial.truth, landmarks_w, tracks.landmark_of_track, tracks.outlier, moving
    )


def _observation_records(start_ns: int, tracks: Tracks) -> RecordArray:
    records = np.zeros(tracks.t_ns.size, dtype=OBSERVATION_DTYPE)
    records["t_ns"] = start_ns + tracks.t_ns
    records["id"] = tracks.track
    records["u"], records["v"] = tracks.pixels.T
    return records
