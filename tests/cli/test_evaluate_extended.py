"""`asyneio evaluate --protocol evslam` and `streaming`, against values computed by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.io import read_moving_poses, write_estimates, write_tum
from asyneio.types import NS_PER_S, Estimate, PoseTrajectory
from tests.cli.conftest import Asyneio
from tests.evaluation.test_evslam import helix
from tests.io.recordings import START_NS, make_estimate

MS = 1_000_000


def write_columns(path: Path, poses: PoseTrajectory, velocity: np.ndarray, separator: str = " ") -> Path:
    """Eleven columns, as EvSLAM publishes its ground truth."""
    rows = np.hstack([poses.position, poses.quaternion, velocity])
    lines = (
        separator.join([f"{t / 1e9:.9f}", *(f"{value:.9f}" for value in row)])
        for t, row in zip(poses.t_ns.tolist(), rows.tolist(), strict=True)
    )
    path.write_text("\n".join(lines) + "\n")
    return path


def on_a_line(times_ms: list[int], segment: int = 0) -> list[Estimate]:
    """0.5 m/s along x, turning about z at 0.2 rad/s."""
    return [replace(make_estimate(START_NS + t * MS), segment=segment) for t in times_ms]


def write_lines(path: Path, estimates: list[Estimate], latency_s: float) -> Path:
    """As `asyneio live` prints them, among states."""
    lines = [json.dumps({"type": "state", "t_ns": START_NS, "health": "initializing", "segment": 0})]
    for estimate in estimates:
        pose = {"type": "pose", "t_ns": estimate.t_ns, "segment": estimate.segment, "latency_s": latency_s}
        pose |= {"position": estimate.T_w_b[:3, 3].tolist(), "quaternion": [0.0, 0.0, 0.0, 1.0]}
        lines.append(json.dumps(pose | {"velocity": estimate.velocity_w.tolist(), "health": "tracking"}))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + '\n{"type": "po')
    return path


def straight_truth(path: Path, step_ms: int, count: int) -> Path:
    t_ns = START_NS + step_ms * MS * np.arange(count, dtype=np.int64)
    position = np.zeros((count, 3))
    position[:, 0] = 0.5 * (t_ns - START_NS) / NS_PER_S
    write_tum(path, PoseTrajectory(t_ns, position, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))))
    return path


def test_evslam_from_eleven_columns(asyneio: Asyneio, tmp_path: Path) -> None:
    """Velocities that are too large by a quarter: an error of 0.25 everywhere, so an area of 0.75."""
    truth, velocity = helix()
    estimate = write_columns(tmp_path / "estimate.txt", truth, 1.25 * velocity)
    exact = write_columns(tmp_path / "truth.txt", truth, velocity)
    status, out, err = asyneio("evaluate", estimate, exact, "--protocol", "evslam", "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert found["protocol"]["name"] == "evslam"
    assert (found["reference"], found["associated"], found["velocity_times"]) == (80, 80, 80)
    assert found["velocity_auc"] == pytest.approx(0.75, abs=1e-4)
    assert found["position_m"]["rmse"] < 1e-6
    write_tum(tmp_path / "poses.tum", truth)
    status, out, err = asyneio("evaluate", estimate, tmp_path / "poses.tum", "--protocol", "evslam")
    assert status == 0
    assert "central differences" in err
    assert "80 of 80 reference times" in out


def test_evslam_from_a_run(asyneio: Asyneio, tmp_path: Path) -> None:
    """The body turns at 0.2 rad/s on the path y = 0.1 sin(x); the estimate has no velocity along y."""
    estimates = on_a_line([50 * k for k in range(100)])
    for estimate in estimates:
        estimate.T_w_b[1, 3] = 0.1 * np.sin(estimate.T_w_b[0, 3])
    write_estimates(tmp_path / "estimates.npz", estimates)
    (part,) = read_moving_poses(tmp_path).values()
    angle = 0.2 * 4.95
    np.testing.assert_allclose(part.velocity_b[0], [0.5, 0.0, 0.0], atol=1e-12)
    expected = [0.5 * np.cos(angle), -0.5 * np.sin(angle), 0.0]
    np.testing.assert_allclose(part.velocity_b[-1], expected, atol=1e-9)
    write_tum(tmp_path / "truth.tum", part.poses)
    status, out, _ = asyneio("evaluate", tmp_path, tmp_path / "truth.tum", "-p", "evslam", "--json")
    assert status == 0
    found = json.loads(out)
    assert found["position_m"]["rmse"] < 1e-6
    x = 0.5 * np.arange(0.1, 4.85, 0.1)
    missing, speed = 0.05 * np.abs(np.cos(x)), np.hypot(0.5, 0.05 * np.cos(x))
    assert found["velocity_auc"] == pytest.approx((speed - missing).sum() / speed.sum(), abs=1e-3)


def test_evslam_without_velocities(asyneio: Asyneio, tmp_path: Path) -> None:
    truth, velocity = helix()
    write_tum(tmp_path / "poses.tum", truth)
    vins = write_columns(tmp_path / "vins.csv", truth, velocity, ",")
    for estimate in (tmp_path / "poses.tum", vins):
        status, _, err = asyneio("evaluate", estimate, tmp_path / "poses.tum", "--protocol", "evslam")
        assert status == 1
        assert "has no velocities; expected a results folder" in err
    status, _, err = asyneio("evaluate", tmp_path, tmp_path / "poses.tum", "--protocol", "evslam")
    assert status == 1
    assert "contains no velocities; expected estimates.npz or poses.jsonl" in err


def test_streaming_from_a_live_run(asyneio: Asyneio, tmp_path: Path) -> None:
    """Poses every 100 ms, 30 ms late; truth every 50 ms: the newest pose is 50 or 100 ms old."""
    times = [100 * k for k in range(20)]
    write_lines(tmp_path / "live" / "poses.jsonl", on_a_line(times), 0.030)
    truth = straight_truth(tmp_path / "truth.tum", 50, 39)
    for source in (tmp_path / "live", tmp_path / "live" / "poses.jsonl"):
        status, out, err = asyneio("evaluate", source, truth, "--protocol", "streaming", "--json")
        assert status == 0, err
        found = json.loads(out)
        assert (found["compared"], found["waiting"]) == (38, 1)
        assert found["age_s"]["mean"] == pytest.approx(0.075)
        assert found["position_m"]["mean"] == pytest.approx(0.5 * 0.075, abs=1e-6)
        assert found["position_m"]["max"] == pytest.approx(0.05, abs=1e-6)


def test_streaming_with_a_constant_latency(asyneio: Asyneio, tmp_path: Path) -> None:
    """Two segments; 60 ms late, the newest pose is 100 ms old at each true pose, 150 ms with 110 ms."""
    estimates = on_a_line([100 * k for k in range(20)]) + on_a_line([3000 + 100 * k for k in range(9)], 1)
    write_estimates(tmp_path / "estimates.npz", estimates)
    truth = straight_truth(tmp_path / "truth.tum", 50, 80)
    command = ("evaluate", tmp_path, truth, "--protocol", "streaming")
    status, _, err = asyneio(*command)
    assert status == 1
    assert "does not contain when each pose was available" in err
    assert "--latency SECONDS" in err
    status, out, _ = asyneio(*command, "--latency", "0.06", "--json")
    assert status == 0
    segments = json.loads(out)["segments"]
    assert [part["segment"] for part in segments] == [0, 1]
    # Until the second segment begins, its poses are not available: 62 true poses wait.
    assert [part["waiting"] for part in segments] == [2, 62]
    status, out, _ = asyneio(*command, "--latency", "0.06")
    assert "age of the newest pose, mean" in out
    assert "segment 1" in out


@pytest.mark.parametrize(
    ("line", "problem"),
    [("{", "line 1"), ("[]", "line 1"), ('{"type": "pose", "t_ns": 1}', "'segment'")],
)
def test_damaged_lines(asyneio: Asyneio, tmp_path: Path, line: str, problem: str) -> None:
    (tmp_path / "poses.jsonl").write_text(line + "\n")
    truth = straight_truth(tmp_path / "truth.tum", 50, 10)
    status, _, err = asyneio("evaluate", tmp_path / "poses.jsonl", truth, "-p", "streaming")
    assert status == 1
    assert problem in err
    assert "is not a line of `asyneio live`" in err


def test_options_that_do_not_apply(asyneio: Asyneio, tmp_path: Path) -> None:
    truth = straight_truth(tmp_path / "truth.tum", 50, 10)
    status, _, err = asyneio("evaluate", truth, truth, "--latency", "0.1")
    assert status == 1
    assert "--latency does not apply to the protocol 'posyaw'" in err
    status, _, err = asyneio("evaluate", truth, truth, "-p", "evslam", "--columns", "t,px,py,pz,qx,qy,qz,qw")
    assert status == 1
    assert "--columns does not apply" in err
