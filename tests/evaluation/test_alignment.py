"""Alignments recover known transforms, are optimal, agree with evo, and refuse what they cannot determine."""

import numpy as np
import pytest
from evo.core.geometry import umeyama_alignment
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation import AlignmentKind, Similarity, align
from asyneio.evaluation.alignment import align_posyaw, align_umeyama, yaw_of, yaw_rotation
from tests.evaluation.paths import disturbed, track_of, wander

vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)
PATH = track_of(wander(60, 10.0))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(rotvec=vectors, t=vectors, scale=st.floats(0.2, 5.0), yaw=st.floats(-3.1, 3.1))
def test_known_transforms_are_recovered(rotvec: np.ndarray, t: np.ndarray, scale: float, yaw: float) -> None:
    tilted = Rotation.from_rotvec(rotvec).as_matrix()
    for kind, known in (
        (AlignmentKind.SIM3, Similarity(scale, tilted, t)),
        (AlignmentKind.SE3, Similarity(1.0, tilted, t)),
        (AlignmentKind.POSYAW, Similarity(1.0, yaw_rotation(yaw), t)),
        (AlignmentKind.ORIGIN, Similarity(1.0, yaw_rotation(yaw), t)),
    ):
        found = align(kind, PATH, known.apply(PATH))
        assert abs(found.scale - known.scale) < 1e-9
        np.testing.assert_allclose(found.R, known.R, atol=1e-9)
        np.testing.assert_allclose(found.t, known.t, atol=1e-8)


def test_none_changes_nothing() -> None:
    same = align(AlignmentKind.NONE, PATH, track_of(wander(60, 10.0, seed=5))).apply(PATH)
    np.testing.assert_array_equal(same.position, PATH.position)
    np.testing.assert_array_equal(same.C, PATH.C)


@pytest.mark.parametrize("with_scale", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_umeyama_agrees_with_evo(with_scale: bool, seed: int) -> None:
    path = wander(80, 10.0, seed)
    estimate, truth = disturbed(path, 0.2, 0.0, seed).position, 1.3 * path.position + 0.4
    R, t, scale = umeyama_alignment(estimate.T, truth.T, with_scale)
    found = align_umeyama(estimate, truth, with_scale)
    assert abs(found.scale - scale) < 1e-10
    np.testing.assert_allclose(found.R, R, atol=1e-10)
    np.testing.assert_allclose(found.t, t, atol=1e-10)


def test_a_planar_path_is_not_fitted_by_a_reflection() -> None:
    flat = PATH.position * [1.0, 1.0, 0.0]
    mirrored = flat * [1.0, -1.0, 0.0] + np.random.default_rng(3).normal(size=flat.shape) * 0.01
    found = align_umeyama(flat, mirrored, with_scale=False)
    assert abs(np.linalg.det(found.R) - 1.0) < 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_posyaw_is_the_least_squares_solution(seed: int) -> None:
    path = wander(50, 10.0, seed)
    tilt = Rotation.from_rotvec([0.1, -0.2, 0.7]).as_matrix()
    estimate, truth = disturbed(path, 0.3, 0.0, seed).position, path.position @ tilt.T
    found = align_posyaw(estimate, truth)

    def cost(yaw: float) -> float:
        turned = (estimate - estimate.mean(axis=0)) @ yaw_rotation(yaw).T
        return float(((turned - truth + truth.mean(axis=0)) ** 2).sum())

    yaw = float(yaw_of(found.R))
    best = minimize_scalar(cost, bounds=(yaw - 1.0, yaw + 1.0), method="bounded", options={"xatol": 1e-10})
    assert abs(best.x - yaw) < 1e-6
    np.testing.assert_allclose(found.R @ estimate.mean(axis=0) + found.t, truth.mean(axis=0), atol=1e-12)


def test_yaw_of_maximises_the_trace() -> None:
    C = Rotation.random(20, random_state=4).as_matrix()
    sweep = np.linspace(-np.pi, np.pi, 20001)
    for rotation, yaw in zip(C, yaw_of(C), strict=True):
        # trace(Rz(a)^T C) without forming the product.
        trace = np.cos(sweep) * (rotation[0, 0] + rotation[1, 1]) + np.sin(sweep) * (
            rotation[1, 0] - rotation[0, 1]
        )
        assert abs(np.angle(np.exp(1j * (sweep[np.argmax(trace)] - yaw)))) < 1e-3


def test_undetermined_alignments_are_refused() -> None:
    line = np.linspace(0.0, 1.0, 20)[:, None] * [1.0, 2.0, 3.0]
    with pytest.raises(EvaluationError, match="not on a line"):
        align_umeyama(line, line, with_scale=False)
    with pytest.raises(EvaluationError, match="2 positions"):
        align_umeyama(PATH.position[:2], PATH.position[:2], with_scale=True)
    upright = line * [0.0, 0.0, 1.0]
    with pytest.raises(EvaluationError, match="do not determine a yaw"):
        align_posyaw(upright, PATH.position[:20])
