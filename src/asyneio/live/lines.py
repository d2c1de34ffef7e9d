# SPDX-License-Identifier: Apache-2.0
"""Steps as lines of JSON, for other programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from scipy.spatial.transform import Rotation

from asyneio.live.step import LiveStep
from asyneio.pipeline.json_text import to_json
from asyneio.types import NS_PER_S, Estimate, FloatArray


def step_lines(step: LiveStep) -> Iterator[str]:
    """A line of type `pose` for each estimate; without any, one of type `state`. Each ends with a newline."""
    state = _state(step)
    if not step.estimates:
        yield to_json({"type": "state", "t_ns": step.report.t_ns, **_attitude(step), **state})
    for estimate in step.estimates:
        # An estimate of a knot before the end of the packet is older by the difference.
        age_s = max(step.report.t_ns - estimate.t_ns, 0) / NS_PER_S
        timing = {"latency_s": step.latency_s + age_s}
        yield to_json({"type": "pose", "t_ns": estimate.t_ns, **_pose(estimate), **state, **timing})


def _pose(estimate: Estimate) -> dict[str, Any]:
    covariance = estimate.covariance
    return {
        "position": estimate.T_w_b[:3, 3].tolist(),
        "quaternion": quaternion(estimate.T_w_b[:3, :3]),
        "velocity": estimate.velocity_w.tolist(),
        "angular_velocity": estimate.angular_velocity_b.tolist(),
        "bias_gyroscope": estimate.bias_gyroscope.tolist(),
        "bias_accelerometer": estimate.bias_accelerometer.tolist(),
        "pose_covariance": covariance[:6, :6].tolist(),
        "velocity_covariance": covariance[9:12, 9:12].tolist(),
    }


def _state(step: LiveStep) -> dict[str, Any]:
    report = step.report
    return {
        "health": str(report.health),
        "reason": report.reason,
        "segment": report.segment,
        "stationary": report.stationary,
        "latency_s": step.latency_s,
        "processing_s": step.processing_s,
        "backlog_s": step.backlog_s,
        "shed": asdict(step.shed),
    }


def _attitude(step: LiveStep) -> dict[str, Any]:
    attitude = step.report.attitude
    return {} if attitude is None else {"attitude": quaternion(attitude.C_w_b)}


def quaternion(C: FloatArray) -> list[float]:
    """A rotation (3,3) as x y z w, w not negative."""
    return [float(v) for v in Rotation.from_matrix(C).as_quat(canonical=True)]
