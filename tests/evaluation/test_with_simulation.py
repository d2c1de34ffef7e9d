"""The simulator's truth is what the consistency check asks for, and evaluates to itself."""

import dataclasses

import numpy as np
import pytest

from asyneio.evaluation import PROTOCOLS, NeesBlock, evaluate, nees, pose_trajectory
from asyneio.simulation import SCENARIOS, Simulation, simulate
from asyneio.types import Estimate


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate(dataclasses.replace(SCENARIOS["moderate"], duration_s=6.0))


def perfect_estimates(run: Simulation) -> list[Estimate]:
    t_ns = run.truth.start_ns + np.arange(1, 110, dtype=np.int64) * 53_000_001
    truth = run.truth.at(t_ns)
    fields = [name.name for name in dataclasses.fields(truth) if name.name != "t_ns"]
    return [
        Estimate(t_ns=int(t), covariance=np.eye(24), **{name: getattr(truth, name)[i] for name in fields})
        for i, t in enumerate(t_ns)
    ]


@pytest.mark.slow
def test_the_truth_has_no_error_against_itself(run: Simulation) -> None:
    found = nees(perfect_estimates(run), run.truth.at)
    assert all(found.values[block].max() < 1e-20 for block in NeesBlock)


def test_an_error_of_one_sigma_is_seen_in_its_own_block(run: Simulation) -> None:
    estimates = perfect_estimates(run)
    shifted = [dataclasses.replace(e, bias_gyroscope=e.bias_gyroscope + np.eye(3)[1]) for e in estimates]
    found = nees(shifted, run.truth.at)
    np.testing.assert_allclose(found.values[NeesBlock.BIAS_GYROSCOPE], 1.0)
    assert found.values[NeesBlock.BIAS_ACCELEROMETER].max() < 1e-20


def test_the_ground_truth_of_a_recording_is_dense_enough_to_judge_by(run: Simulation) -> None:
    assert run.recording.ground_truth is not None
    result = evaluate(
        pose_trajectory(perfect_estimates(run)), run.recording.ground_truth, PROTOCOLS["posyaw"]
    )
    assert result.unassociated == 0
    # Linear interpolation over 5 ms: at most a dt^2 / 8, 5 micrometres at 1.5 m/s^2.
    assert result.position_m.max < 1e-5
    assert result.orientation_deg.max < 1e-2
