"""Errors against evo, and against values that can be worked out by hand."""

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core.trajectory import PosePath3D
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation import PoseTrack, Similarity, Statistics
from asyneio.evaluation.alignment import yaw_rotation
from asyneio.evaluation.metrics import (
    orientation_errors_deg,
    position_errors,
    relative_errors_by_distance,
    relative_errors_by_time,
    scale_error_percent,
    travelled,
    yaw_errors_deg,
)
from tests.evaluation.paths import disturbed, poses_of, track_of, wander

PATH = wander(300, 20.0)
TRUTH = track_of(PATH)
ESTIMATE = track_of(disturbed(PATH, 0.1, 0.05))


def evo_statistics(metric: evo_metrics.PE) -> dict[str, float]:
    metric.process_data(
        (PosePath3D(poses_se3=list(poses_of(TRUTH))), PosePath3D(poses_se3=list(poses_of(ESTIMATE))))
    )
    return dict(metric.get_all_statistics())


def check(ours: Statistics, theirs: dict[str, float]) -> None:
    for name in ("rmse", "mean", "median", "max"):
        assert abs(getattr(ours, name) - theirs[name]) < 1e-9 * max(1.0, theirs[name])


def test_absolute_errors_agree_with_evo() -> None:
    relation = evo_metrics.PoseRelation
    check(
        Statistics.of(position_errors(ESTIMATE, TRUTH)),
        evo_statistics(evo_metrics.APE(relation.translation_part)),
    )
    check(
        Statistics.of(orientation_errors_deg(ESTIMATE, TRUTH)),
        evo_statistics(evo_metrics.APE(relation.rotation_angle_deg)),
    )


@pytest.mark.parametrize("frames", [1, 7, 20])
def test_relative_errors_by_time_agree_with_evo(frames: int) -> None:
    ours = relative_errors_by_time(ESTIMATE, TRUTH, PATH.t_ns, frames / 20.0)
    assert ours is not None
    assert ours.pairs == 300 - frames
    for relation, statistics in (
        (evo_metrics.PoseRelation.translation_part, ours.translation_m),
        (evo_metrics.PoseRelation.rotation_angle_deg, ours.rotation_deg),
    ):
        check(
            statistics,
            evo_statistics(evo_metrics.RPE(relation, frames, evo_metrics.Unit.frames, all_pairs=True)),
        )


@pytest.mark.parametrize("delta_m", [1.0, 3.0])
def test_relative_errors_by_distance_agree_with_evo(delta_m: float) -> None:
    ours = relative_errors_by_distance(ESTIMATE, TRUTH, delta_m)
    assert ours is not None
    relation = evo_metrics.PoseRelation
    for part, statistics in (
        (relation.translation_part, ours.translation_m),
        (relation.rotation_angle_deg, ours.rotation_deg),
    ):
        rpe = evo_metrics.RPE(
            part,
            delta_m,
            evo_metrics.Unit.meters,
            rel_delta_tol=0.1,
            all_pairs=True,
            pairs_from_reference=True,
        )
        check(statistics, evo_statistics(rpe))
    path = travelled(TRUTH.position)
    assert ours.pairs > 100
    assert ours.translation_percent == pytest.approx(100.0 * ours.translation_m.mean / delta_m, rel=0.1)
    assert ours.rotation_deg_per_m == pytest.approx(ours.rotation_deg.mean / delta_m, rel=0.1)
    assert path[-1] > delta_m


def test_relative_errors_do_not_see_a_change_of_world() -> None:
    world = Similarity(1.0, Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix(), np.array([5.0, 1.0, -2.0]))
    ours = relative_errors_by_distance(world.apply(TRUTH), TRUTH, 1.0)
    assert ours is not None
    assert ours.translation_m.max < 1e-12
    # Near zero an angle read off a rotation matrix is good to the root of the machine's precision at worst.
    assert ours.rotation_deg.max < 1e-5


def test_distances_longer_than_the_run_give_no_pairs() -> None:
    assert relative_errors_by_distance(ESTIMATE, TRUTH, 1e4) is None
    assert relative_errors_by_time(ESTIMATE, TRUTH, PATH.t_ns, 1e4) is None
    with pytest.raises(EvaluationError, match="expected a positive distance"):
        relative_errors_by_distance(ESTIMATE, TRUTH, 0.0)


def test_yaw_errors_are_signed_angles_about_the_world_z() -> None:
    turned = PoseTrack(TRUTH.position, yaw_rotation(np.deg2rad(-7.0)) @ TRUTH.C)
    np.testing.assert_allclose(yaw_errors_deg(turned, TRUTH), 7.0)
    np.testing.assert_allclose(orientation_errors_deg(turned, TRUTH), 7.0)
    tilted = PoseTrack(TRUTH.position, Rotation.from_rotvec([0.1, 0.0, 0.0]).as_matrix() @ TRUTH.C)
    np.testing.assert_allclose(yaw_errors_deg(tilted, TRUTH), 0.0, atol=1e-9)


def test_path_length_and_scale() -> None:
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 0]])
    np.testing.assert_allclose(travelled(square), [0, 2, 4, 6, 8])
    large = Similarity(1.25, np.eye(3), np.ones(3)).apply(TRUTH)
    assert scale_error_percent(large, TRUTH) == pytest.approx(25.0)
    line = PoseTrack(np.linspace(0, 1, 5)[:, None] * [1.0, 0, 0], TRUTH.C[:5])
    assert np.isnan(scale_error_percent(line, line))
