"""What goes wrong in a real recording, added to a simulated one: objects that move, tracks that lie, an IMU
that spikes or saturates. The static tracks and the truth stay as they were.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from asyneio.simulation.camera import PinholeCamera
from asyneio.simulation.motion import Motion
from asyneio.simulation.simulate import Simulation
from asyneio.simulation.tracks import Viewer, simulate_tracks
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, FloatArray, IntArray, RecordArray, Recording

_POINTS = 400


@dataclass(frozen=True)
class MovingObject:
    """A rigid object that moves through the scene without turning.

    `share`: of all tracks alive, those on it while it is in view. It goes to and fro along the unit
    `direction_w` (3,) at constant `speed` [m/s], turning every `reverse_s`; at the start it is `distance`
    metres in front of the camera's mean pose, and it is `size * distance` wide. `follow` adds that fraction
    of the camera's own displacement: motion parallel to the camera's, which no epipolar line reveals.
    """

    share: float = 1.0 / 3.0
    speed: float = 0.7
    direction_w: tuple[float, float, float] = (0.0, 1.0, 0.0)
    distance: float = 2.0
    size: float = 0.6
    reverse_s: float = 2.0
    follow: float = 0.0
    start_s: float = 0.0

    def offset_w(self, t_s: FloatArray) -> FloatArray:
        """Displacement (N,3) [m] at times (N,) [s] of its own motion."""
        phase = np.maximum(t_s - self.start_s, 0.0) / self.reverse_s
        triangle = np.abs((phase + 0.5) % 2.0 - 1.0) - 0.5
        direction = np.asarray(self.direction_w) / np.linalg.norm(self.direction_w)
        return np.outer(self.speed * self.reverse_s * triangle, direction)


@dataclass(frozen=True)
class _Seen:
    """The camera's motion as seen from the moving object: what `simulate_tracks` needs of a `Motion`."""

    motion: Motion
    body: MovingObject
    origin_w: FloatArray

    def T_w_b(self, t_s: ArrayLike) -> FloatArray:
        T = self.motion.T_w_b(t_s).copy()
        t = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
        follow = self.body.follow * (T[:, :3, 3] - self.origin_w)
        T[:, :3, 3] -= self.body.offset_w(t) + follow
        return T

    def velocity_w(self, t_s: ArrayLike) -> FloatArray:
        return self.motion.velocity_w(t_s)

    def acceleration_w(self, t_s: ArrayLike) -> FloatArray:
        return self.motion.acceleration_w(t_s)

    def angular_velocity_b(self, t_s: ArrayLike) -> FloatArray:
        return self.motion.angular_velocity_b(t_s)

    def angular_acceleration_b(self, t_s: ArrayLike) -> FloatArray:
        return self.motion.angular_acceleration_b(t_s)


def with_moving_object(simulation: Simulation, body: MovingObject, seed: int = 0) -> tuple[Recording, IntArray]:
    """The recording with tracks on a moving object added, and the ids of those tracks.

    Raises:
        SimulationError: the camera never sees the object.
    """
    scenario, truth = simulation.scenario, simulation.truth
    rng = np.random.default_rng([seed, 77])
    begin = max(scenario.camera_offset_s, body.start_s)
    T_w_c = truth.motion.T_w_b(np.linspace(begin, scenario.duration_s, 50)) @ scenario.T_b_c
    axis = T_w_c[:, :3, 2].mean(axis=0)
    centre = T_w_c[:, :3, 3].mean(axis=0) + body.distance * axis / np.linalg.norm(axis)
    points = centre + 0.5 * body.size * body.distance * rng.uniform(-1.0, 1.0, (_POINTS, 3))
    seen = _Seen(truth.motion, body, truth.motion.T_w_b([begin])[0, :3, 3])
    viewer = Viewer(seen, PinholeCamera.from_intrinsics(scenario.camera), scenario.T_b_c, points)
    alive = round(scenario.tracks.features_alive * body.share / (1.0 - body.share))
    spec = replace(scenario.tracks, features_alive=alive, outlier_fraction=0.0)
    tracks = simulate_tracks(viewer, spec, begin, scenario.duration_s, rng)
    first_id = int(simulation.recording.observations["id"].max()) + 1
    added = np.zeros(tracks.t_ns.size, dtype=OBSERVATION_DTYPE)
    added["t_ns"] = scenario.start_ns + tracks.t_ns
    added["id"] = first_id + tracks.track
    added["u"], added["v"] = tracks.pixels.T
    merged = np.concatenate([simulation.recording.observations, added])
    merged = merged[np.argsort(merged["t_ns"], kind="stable")]
    return replace(simulation.recording, observations=merged), np.unique(added["id"])


def with_wrong_tracks(
    recording: Recording, share: float, speed_px_s: tuple[float, float], seed: int = 0
) -> tuple[Recording, IntArray]:
    """The recording with that share of its tracks sliding away, each in a direction of its own, and their ids.

    A corner that slides along an edge does 5-20 px/s; a track of nothing at all, 30-150 px/s.
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


def with_spikes(samples: RecordArray, share: float, size: float, seed: int = 0) -> RecordArray:
    """A stream of which that share of single samples is off by `size`, on a random axis and to a random side."""
    rng = np.random.default_rng([seed, 79])
    out = samples.copy()
    hit = np.flatnonzero(rng.random(len(out)) < share)
    out["xyz"][hit, rng.integers(0, 3, len(hit))] += size * rng.choice([-1.0, 1.0], len(hit))
    return out


def saturated(samples: RecordArray, limit: float) -> RecordArray:
    """A stream clipped at +-`limit` on every axis."""
    out = samples.copy()
    out["xyz"] = np.clip(out["xyz"], -limit, limit)
    return out
