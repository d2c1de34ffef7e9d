# SPDX-License-Identifier: Apache-2.0
"""`estimates.npz`: all estimates without loss: poses, velocity, biases, covariance.

| array | shape | meaning |
|---|---|---|
| t_ns | (N,) int64 | time, IMU clock |
| segment | (N,) int64 | number of the segment; each has its own world frame |
| T_w_b | (N,4,4) | body to world |
| velocity_w | (N,3) | m/s, world |
| angular_velocity_b | (N,3) | rad/s, body |
| generalized_acceleration | (N,6) | angular rad/s^2, linear m/s^2, body |
| bias_gyroscope, bias_accelerometer | (N,3) | rad/s, m/s^2 |
| covariance | (N,24,24) | error state, blocks of three in the order of `state_blocks` |
| state_blocks | (8,) text | names of the blocks |
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import atomic_file
from asyneio.io.parsing.safe_npz import read_npz
from asyneio.state import DOF
from asyneio.types import STATE_BLOCKS, Estimate, FloatArray, PoseTrajectory, split_segments

_SHAPES: dict[str, tuple[int, ...]] = {
    "T_w_b": (4, 4),
    "velocity_w": (3,),
    "angular_velocity_b": (3,),
    "generalized_acceleration": (6,),
    "bias_gyroscope": (3,),
    "bias_accelerometer": (3,),
    "covariance": (DOF, DOF),
}


def stack_estimates(estimates: Sequence[Estimate]) -> dict[str, FloatArray]:
    """The float fields of all estimates as arrays with a leading axis of length N (shapes as above)."""
    return {
        name: np.array([getattr(estimate, name) for estimate in estimates], dtype=np.float64).reshape(
            -1, *shape
        )
        for name, shape in _SHAPES.items()
    }


def write_estimates(path: Path, estimates: Sequence[Estimate]) -> None:
    """Write the file, complete or not at all, without pickled objects.

    Raises:
        RecordingError: the file cannot be written.
    """
    t_ns = np.array([estimate.t_ns for estimate in estimates], dtype=np.int64)
    with atomic_file(path) as stream:
        np.savez(
            stream,
            allow_pickle=False,
            t_ns=t_ns,
            segment=np.array([estimate.segment for estimate in estimates], dtype=np.int64),
            state_blocks=np.array(STATE_BLOCKS),
            **stack_estimates(estimates),
        )


def read_estimates(path: Path) -> list[Estimate]:
    """Read the file.

    Raises:
        RecordingError: unreadable, an array is missing or has another shape, or the state order differs.
    """
    arrays = _load(path)
    blocks = tuple(map(str, arrays["state_blocks"].reshape(-1).tolist()))
    if blocks != STATE_BLOCKS:
        raise RecordingError(f"{path} orders the state as {blocks}; this version uses {STATE_BLOCKS}")
    t_ns, segment = arrays["t_ns"], arrays["segment"]
    for name, found in (("t_ns", t_ns), ("segment", segment)):
        if found.dtype != np.int64 or found.ndim != 1 or found.shape != t_ns.shape:
            raise RecordingError(
                f"{path}: {name} is {found.dtype} of shape {found.shape}; expected int64 (N,)"
            )
    for name, shape in _SHAPES.items():
        found = arrays[name]
        if found.dtype != np.float64 or found.shape != (t_ns.size, *shape):
            raise RecordingError(
                f"{path}: {name} is {found.dtype} of shape {found.shape}; expected float64 "
                f"of shape {(t_ns.size, *shape)}"
            )
    return [
        Estimate(t_ns=stamp, segment=number, **{name: arrays[name][index] for name in _SHAPES})
        for index, (stamp, number) in enumerate(zip(t_ns.tolist(), segment.tolist(), strict=True))
    ]


def to_trajectory(estimates: Sequence[Estimate]) -> PoseTrajectory:
    """Poses of the estimates as a trajectory with unit quaternions, w not negative.

    Raises:
        RecordingError: the estimates belong to several segments, which have different world frames.
    """
    if len(split_segments(estimates)) > 1:
        raise RecordingError("estimates of several segments; expected one: their world frames differ")
    if not estimates:
        return PoseTrajectory(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 4)))
    T_w_b = np.array([estimate.T_w_b for estimate in estimates])
    return PoseTrajectory(
        t_ns=np.array([estimate.t_ns for estimate in estimates], dtype=np.int64),
        position=T_w_b[:, :3, 3].copy(),
        quaternion=Rotation.from_matrix(T_w_b[:, :3, :3]).as_quat(canonical=True),
    )


def _load(path: Path) -> dict[str, np.ndarray]:
    """All arrays of the archive. Raises RecordingError: unreadable, or an array is missing."""
    names = ("t_ns", "segment", "state_blocks", *_SHAPES)
    arrays = read_npz(path, "an estimates.npz, as `asyneio run` writes it")
    missing = [name for name in names if name not in arrays]
    if missing:
        raise RecordingError(f"{path} lacks the arrays {', '.join(missing)}; expected an estimates.npz")
    return arrays
