# SPDX-License-Identifier: Apache-2.0
"""Protocols of `asyneio evaluate` that need velocities, or the times at which poses were available."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from asyneio.evaluation import EvslamResult, StreamingResult
    from asyneio.io.results.live_poses import LivePoses
    from asyneio.types import PoseTrajectory

    Result = EvslamResult | StreamingResult


@dataclass(frozen=True)
class Extended:
    """What to compare: paths, the largest gap across which ground truth is interpolated [s] (None: that of
    the protocol), a constant latency [s] if no file contains one, and columns of files without a header."""

    estimate: Path
    truth: Path
    max_gap_s: float | None = None
    latency_s: float | None = None
    columns: str = ""
    truth_columns: str = ""


def evaluate_extended(name: str, job: Extended, as_json: bool) -> None:
    """Apply a protocol to each segment and print the result.

    Raises:
        RecordingError: a file cannot be read, or has no velocities.
        EvaluationError: no availability is known, or the two cannot be compared.
    """
    apply: Callable[[Extended], dict[int, Result]] = {"evslam": _evslam, "streaming": _streaming}[name]
    _show(f"{job.estimate} against {job.truth}", apply(job), as_json)


def _evslam(job: Extended) -> dict[int, Result]:
    from asyneio.cli import console
    from asyneio.errors import EvaluationError
    from asyneio.evaluation import evaluate_evslam
    from asyneio.evaluation.evslam import MAX_GAP_S
    from asyneio.io import read_moving_poses
    from asyneio.io.results.velocities import read_velocity_columns

    if job.columns:
        raise EvaluationError(
            "--columns does not apply to the protocol 'evslam', whose columns are fixed; omit it"
        )
    max_gap_s = MAX_GAP_S if job.max_gap_s is None else job.max_gap_s
    exact = read_velocity_columns(job.truth) if _is_text(job.truth) else None
    if exact is None:
        console.say("note: true velocities are central differences of the true positions over 0.2 s")
        truth, velocity = _truth(job), None
    else:
        truth, velocity = exact.poses, exact.velocity_b
    return {
        number: evaluate_evslam(part.poses, part.velocity_b, truth, velocity, max_gap_s)
        for number, part in read_moving_poses(job.estimate).items()
    }


def _streaming(job: Extended) -> dict[int, Result]:
    from asyneio.evaluation import evaluate_streaming

    max_gap_s = 0.05 if job.max_gap_s is None else job.max_gap_s
    truth = _truth(job)
    return {
        number: evaluate_streaming(part.poses, part.available_ns, truth, max_gap_s=max_gap_s)
        for number, part in _available(job).items()
    }


def _available(job: Extended) -> dict[int, LivePoses]:
    """Poses with the times at which they were available. Raises EvaluationError: these are unknown."""
    import numpy as np

    from asyneio.errors import EvaluationError
    from asyneio.io import read_live_poses
    from asyneio.io.results.live_poses import LIVE_POSES_FILE, LivePoses
    from asyneio.io.trajectory_source import read_estimated
    from asyneio.types import NS_PER_S

    lines = job.estimate / LIVE_POSES_FILE if job.estimate.is_dir() else job.estimate
    if job.latency_s is None:
        if lines.suffix == ".jsonl" and lines.is_file():
            return read_live_poses(lines)
        raise EvaluationError(
            f"{job.estimate} does not contain when each pose was available, which the protocol "
            "streaming needs; "
            f"expected {LIVE_POSES_FILE} of `asyneio live --record` (DIR/live) at the pace of the "
            "sensors, or a "
            "constant latency: --latency SECONDS"
        )
    if lines.suffix == ".jsonl" and not job.estimate.is_dir():
        segments = {number: part.poses for number, part in read_live_poses(lines).items()}
    else:
        segments = read_estimated(job.estimate, job.columns).segments
    latency_ns = round(job.latency_s * NS_PER_S)
    return {
        number: LivePoses(poses, np.zeros((poses.t_ns.size, 3)), poses.t_ns + latency_ns)
        for number, poses in segments.items()
    }


def _is_text(path: Path) -> bool:
    """True for a text file of poses, in which there may be velocities."""
    return path.is_file() and path.suffix in (".txt", ".tum")


def _truth(job: Extended) -> PoseTrajectory:
    """The ground truth. Raises RecordingError: none, or without times."""
    from asyneio.cli import console
    from asyneio.errors import RecordingError
    from asyneio.io.trajectory_source import read_reference

    reference = read_reference(job.truth, job.truth_columns)
    if not reference.timed:
        raise RecordingError(f"{job.truth} has poses without timestamps; this protocol needs them")
    for note in reference.notes:
        console.say(f"note: {note}")
    return reference.longest


def _show(title: str, results: dict[int, Result], as_json: bool) -> None:
    import json

    from asyneio.cli import console

    if as_json:
        plain = [{"segment": number, **result.to_dict()} for number, result in results.items()]
        typer.echo(json.dumps(plain[0] if len(plain) == 1 else {"segments": plain}, indent=2))
        return
    rows: list[tuple[str, str]] = []
    for number, result in results.items():
        if len(results) > 1:
            rows.append((f"segment {number}", "aligned separately"))
        rows += _rows(result)
    console.table(title, rows)


def _rows(result: Result) -> list[tuple[str, str]]:
    """Rows of one segment."""
    from asyneio.evaluation import EvslamResult

    position = result.position_m
    errors = [
        ("position error, RMSE (ATE)", f"{100.0 * position.rmse:.3f} cm"),
        ("position error, max", f"{100.0 * position.max:.3f} cm"),
    ]
    if isinstance(result, EvslamResult):
        auc = result.velocity_auc
        return [
            ("aligned by", "evslam: SE(3)"),
            ("compared", f"{result.associated} of {result.reference} reference times"),
            *errors,
            (
                "velocity AUC, 1 is exact",
                f"{auc:.4f}" if auc == auc else "undetermined: the body never moves",
            ),
        ]
    return [
        ("aligned by", "streaming: position and yaw, equal times"),
        ("compared", f"{result.compared} true poses, {result.waiting} before the first available pose"),
        ("age of the newest pose, mean", f"{1e3 * result.age_s.mean:.1f} ms"),
        ("age of the newest pose, max", f"{1e3 * result.age_s.max:.1f} ms"),
        *errors,
        ("orientation error, RMSE", f"{result.orientation_deg.rmse:.3f} deg"),
    ]
