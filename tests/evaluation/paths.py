"""Smooth made-up trajectories for the tests of this folder."""

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.evaluation import PoseTrack, Similarity
from asyneio.types import FloatArray, PoseTrajectory

START_NS = 1_600_000_000_000_000_000


def wander(count: int, rate_hz: float, seed: int = 0) -> PoseTrajectory:
    """A path of some metres with turning attitude, at a fixed rate."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(count) / rate_hz
    frequency, phase = rng.uniform(0.1, 0.5, (2, 3)), rng.uniform(0.0, 6.0, (2, 3))
    waves = np.sin(2.0 * np.pi * frequency[:, None] * t_s[None, :, None] + phase[:, None])
    t_ns = START_NS + np.rint(t_s * 1e9).astype(np.int64)
    return PoseTrajectory(t_ns, 1.5 * waves[0], Rotation.from_rotvec(0.8 * waves[1]).as_quat())


def disturbed(path: PoseTrajectory, sigma_m: float, sigma_rad: float, seed: int = 1) -> PoseTrajectory:
    """The same times with independent errors."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(sigma_rad * rng.normal(size=(path.t_ns.size, 3)))
    attitude = Rotation.from_quat(path.quaternion) * turn
    position = path.position + sigma_m * rng.normal(size=path.position.shape)
    return PoseTrajectory(path.t_ns, position, attitude.as_quat())


def moved(path: PoseTrajectory, by: Similarity) -> PoseTrajectory:
    """The path in another world, `p' = scale R p + t`."""
    track = by.apply(track_of(path))
    return PoseTrajectory(path.t_ns, track.position, Rotation.from_matrix(track.C).as_quat())


def track_of(path: PoseTrajectory) -> PoseTrack:
    return PoseTrack(path.position, Rotation.from_quat(path.quaternion).as_matrix())


def poses_of(track: PoseTrack) -> FloatArray:
    """Homogeneous matrices (N,4,4)."""
    T = np.tile(np.eye(4), (len(track.position), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = track.C, track.position
    return T
