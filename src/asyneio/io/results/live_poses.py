# SPDX-License-Identifier: Apache-2.0
"""`poses.jsonl`: the lines that `asyneio live` prints and records, with the latency of each pose."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asyneio.errors import RecordingError
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory

LIVE_POSES_FILE = "poses.jsonl"
_FIELDS = {"position": 3, "quaternion": 4, "velocity": 3}


@dataclass(frozen=True)
class LivePoses:
    """One segment: N poses, `velocity_w` (N,3) [m/s] in the world, `available_ns` (N,) when each was
    published, in the clock of the poses."""

    poses: PoseTrajectory
    velocity_w: FloatArray
    available_ns: IntArray


def read_live_poses(path: Path) -> dict[int, LivePoses]:
    """Read the poses by segment. Lines of another type, and an incomplete last line, are ignored.

    A pose is available at its time plus its latency, which is measured on the wall clock: that is the time in
    the clock of the sensors if the data arrived at their own pace.

    Raises:
        RecordingError: unreadable, a damaged line, or no poses.
    """
    try:
        lines = path.read_bytes().split(b"\n")[:-1]
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    segments: dict[int, list[dict[str, Any]]] = {}
    for number, line in enumerate(lines, start=1):
        pose = _pose(path, number, line)
        if pose is not None:
            segments.setdefault(pose["segment"], []).append(pose)
    if not segments:
        raise RecordingError(f"{path} contains no lines of type pose; expected the output of `asyneio live`")
    return {segment: _stack(poses) for segment, poses in segments.items()}


def _pose(path: Path, number: int, line: bytes) -> dict[str, Any] | None:
    """The fields of a pose; None for a line of another type. Raises RecordingError: damaged."""
    try:
        fields = json.loads(line)
        if fields["type"] != "pose":
            return None
        found: dict[str, Any] = {name: int(fields[name]) for name in ("t_ns", "segment")}
        found["latency_ns"] = round(float(fields["latency_s"]) * NS_PER_S)
        for name, size in _FIELDS.items():
            found[name] = [float(value) for value in fields[name]]
            if len(found[name]) != size:
                raise ValueError(f"{name} has {len(found[name])} numbers, expected {size}")
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise RecordingError(
            f"line {number} of {path} is not a line of `asyneio live` ({error}); expected JSON with "
            "type, t_ns, "
            "segment, position, quaternion, velocity and latency_s: remove that line"
        ) from error
    return found


def _stack(poses: list[dict[str, Any]]) -> LivePoses:
    position, quaternion, velocity = (np.array([pose[name] for pose in poses]) for name in _FIELDS)
    t_ns, latency_ns = (
        np.array([pose[name] for pose in poses], dtype=np.int64) for name in ("t_ns", "latency_ns")
    )
    return LivePoses(PoseTrajectory(t_ns, position, quaternion), velocity, t_ns + latency_ns)
