"""The protocol `streaming` against values computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.errors import EvaluationError
from asyneio.evaluation import AlignmentKind, Similarity
from asyneio.evaluation.alignment import yaw_rotation
from asyneio.evaluation.streaming import evaluate_streaming, newest_available
from asyneio.types import PoseTrajectory
from tests.evaluation.paths import START_NS, moved, wander

MS = 1_000_000


def straight(times_ms: list[int]) -> PoseTrajectory:
    """1 m/s along x without rotation."""
    t_ns = START_NS + np.array(times_ms, dtype=np.int64) * MS
    position = np.zeros((t_ns.size, 3))
    position[:, 0] = np.array(times_ms) * 1e-3
    return PoseTrajectory(t_ns, position, np.tile([0.0, 0.0, 0.0, 1.0], (t_ns.size, 1)))


def test_latency_is_an_error_of_the_distance_travelled() -> None:
    """Estimates at 0, 100, 200 ms, available 30 ms later; truth every 50 ms.

    At 0: none. At 50, 100: estimate of 0. At 150, 200: that of 100. At 250: that of 200 ms.
    """
    estimate = straight([0, 100, 200])
    truth = straight([0, 50, 100, 150, 200, 250])
    found = evaluate_streaming(estimate, estimate.t_ns + 30 * MS, truth, AlignmentKind.NONE, max_gap_s=0.06)
    errors = np.array([0.05, 0.1, 0.05, 0.1, 0.05])
    assert (found.compared, found.waiting) == (5, 1)
    assert found.position_m.mean == pytest.approx(errors.mean())
    assert found.position_m.rmse == pytest.approx(np.sqrt((errors**2).mean()))
    assert found.position_m.max == pytest.approx(0.1)
    assert found.age_s.mean == pytest.approx(errors.mean())
    assert found.orientation_deg.max == 0.0


def test_the_alignment_does_not_hide_latency() -> None:
    """A perfect estimate in another world: the errors are those of its latency alone."""
    truth = wander(2000, 200.0)
    estimate = PoseTrajectory(truth.t_ns[::10], truth.position[::10], truth.quaternion[::10])
    other = moved(estimate, Similarity(1.0, yaw_rotation(2.0), np.array([3.0, -1.0, 0.5])))
    late = [evaluate_streaming(other, other.t_ns + delay * MS, truth) for delay in (0, 200)]
    same_world = evaluate_streaming(estimate, estimate.t_ns + 200 * MS, truth, AlignmentKind.NONE)
    assert late[1].position_m.rmse == pytest.approx(same_world.position_m.rmse, rel=1e-6)
    assert late[0].position_m.rmse < 0.3 * late[1].position_m.rmse


def test_newest_available_by_hand() -> None:
    """The second estimate arrives after the third, and is never used."""
    available = np.array([10, 40, 30, 60])
    found = newest_available(available, np.array([9, 10, 29, 30, 45, 60, 99]))
    assert found.tolist() == [-1, 0, 0, 2, 2, 3, 3]


def test_availability_before_its_time_is_rejected() -> None:
    estimate = straight([0, 100])
    with pytest.raises(EvaluationError, match="not before its own time"):
        evaluate_streaming(estimate, estimate.t_ns - 1, straight([0, 50, 100]))


def test_an_estimate_that_comes_too_late() -> None:
    estimate = straight([0, 50])
    with pytest.raises(EvaluationError, match="after the last true pose"):
        evaluate_streaming(estimate, estimate.t_ns + 10**10, straight([0, 50, 100]), AlignmentKind.NONE)
