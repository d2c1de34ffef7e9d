"""Protocols fit on what they say, and figures come out as plain values."""

import dataclasses
import json
import os
from pathlib import Path

import numpy as np
import pytest
from evo.core.trajectory import PoseTrajectory3D
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation import PROTOCOLS, AlignmentKind, Protocol, Similarity, evaluate, protocol_named
from asyneio.evaluation.alignment import yaw_rotation
from asyneio.types import PoseTrajectory
from tests.evaluation.paths import disturbed, moved, poses_of, track_of, wander

TRUTH = wander(4000, 200.0)
SPARSE = wander(400, 20.0)
WORLD = Similarity(1.0, yaw_rotation(2.0), np.array([3.0, -1.0, 0.5]))


def drifting() -> PoseTrajectory:
    """An estimate in its own world, with noise and an error that grows after eight seconds."""
    noisy = disturbed(SPARSE, 0.02, 0.01)
    late = np.maximum(np.arange(400) / 20.0 - 8.0, 0.0)
    return moved(
        dataclasses.replace(noisy, position=noisy.position + late[:, None] * [0.05, 0.0, 0.0]), WORLD
    )


@pytest.mark.parametrize("name", ["posyaw", "se3", "sim3", "hku", "uslam", "origin"])
def test_a_perfect_estimate_in_another_world_has_no_error(name: str) -> None:
    result = evaluate(moved(SPARSE, WORLD), TRUTH, PROTOCOLS[name])
    assert result.associated == 400
    assert result.position_m.max < 2e-9
    assert result.orientation_deg.max < 1e-5
    np.testing.assert_allclose(result.alignment.R, WORLD.R.T, atol=1e-9)
    assert result.protocol.name == name


@pytest.mark.parametrize(
    ("name", "scale", "first", "last"),
    [("se3", False, 0, 400), ("sim3", True, 0, 400), ("hku", False, 0, 101), ("uslam", False, 60, 161)],
)
def test_windows_and_fits_agree_with_evo(name: str, scale: bool, first: int, last: int) -> None:
    estimate = drifting()
    result = evaluate(estimate, TRUTH, PROTOCOLS[name])
    stamps = np.arange(400) / 20.0
    ours, theirs = (
        PoseTrajectory3D(poses_se3=list(poses_of(track_of(path))), timestamps=stamps)
        for path in (estimate, SPARSE)
    )
    window = [
        PoseTrajectory3D(poses_se3=path.poses_se3[first:last], timestamps=stamps[first:last])
        for path in (ours, theirs)
    ]
    R, t, factor = window[0].align(window[1], correct_scale=scale)
    aligned = factor * ours.positions_xyz @ R.T + t
    error = np.linalg.norm(aligned - SPARSE.position, axis=1)
    np.testing.assert_allclose(result.position_error_m, error, atol=1e-9)
    path_m = np.linalg.norm(np.diff(SPARSE.position, axis=0), axis=1).sum()
    assert result.path_length_m == pytest.approx(path_m)
    assert result.mpe_percent == pytest.approx(100.0 * error.mean() / path_m)


def test_protocols_differ_where_the_error_is_late() -> None:
    estimate = drifting()
    rmse = {
        name: evaluate(estimate, TRUTH, PROTOCOLS[name]).position_m.rmse for name in ("se3", "hku", "uslam")
    }
    assert rmse["se3"] < rmse["hku"]
    assert rmse["se3"] < rmse["uslam"]


def test_posyaw_keeps_an_error_of_tilt_that_se3_hides() -> None:
    tilt = Similarity(1.0, Rotation.from_rotvec([0.05, 0.0, 0.0]).as_matrix())
    tilted = moved(SPARSE, tilt)
    assert evaluate(tilted, TRUTH, PROTOCOLS["se3"]).orientation_deg.max < 1e-5
    kept = evaluate(tilted, TRUTH, PROTOCOLS["posyaw"]).orientation_deg.mean
    assert kept == pytest.approx(np.rad2deg(0.05), rel=0.05)


def test_yaw_error_per_metre_and_scale() -> None:
    # Attitude turned by two degrees about z while positions stay: the fit cannot absorb it.
    attitude = Rotation.from_rotvec([0.0, 0.0, np.deg2rad(2.0)]) * Rotation.from_quat(SPARSE.quaternion)
    turned = dataclasses.replace(SPARSE, quaternion=attitude.as_quat(), position=0.9 * SPARSE.position)
    result = evaluate(turned, TRUTH, PROTOCOLS["sim3"])
    assert result.yaw_error_deg_per_m == pytest.approx(2.0 / result.path_length_m, rel=1e-6)
    assert result.scale_error_percent == pytest.approx(-10.0)
    assert result.alignment.scale == pytest.approx(1.0 / 0.9)


def test_results_are_plain_values_for_json() -> None:
    result = evaluate(drifting(), TRUTH, PROTOCOLS["posyaw"])
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert plain["protocol"] == {"name": "posyaw", "kind": "posyaw", "window_s": None}
    assert plain["position_m"]["rmse"] == result.position_m.rmse
    assert [entry["unit"] for entry in plain["relative"]] == ["s", "m", "m", "m"]
    assert plain["relative"][0]["translation_percent"] is None
    assert "position_error_m" not in plain
    full = json.loads(json.dumps(result.to_dict(series=True), allow_nan=False))
    assert len(full["position_error_m"]) == len(full["t_ns"]) == 400
    assert full["t_ns"][0] == SPARSE.t_ns[0]


def test_a_body_at_rest_has_no_figures_per_metre() -> None:
    still = dataclasses.replace(SPARSE, position=np.ones((400, 3)))
    result = evaluate(still, dataclasses.replace(TRUTH, position=np.zeros((4000, 3))), PROTOCOLS["origin"])
    assert result.position_m.max < 1e-12
    assert np.isnan(result.mpe_percent)
    assert result.to_dict()["mpe_percent"] is None
    with pytest.raises(EvaluationError, match="use the alignment 'origin'"):
        evaluate(still, TRUTH, PROTOCOLS["posyaw"])


def test_one_estimate_can_be_evaluated_at_the_origin() -> None:
    single = PoseTrajectory(SPARSE.t_ns[:1], SPARSE.position[:1] + 1.0, SPARSE.quaternion[:1])
    result = evaluate(single, TRUTH, PROTOCOLS["origin"])
    assert result.position_m.max < 1e-12
    assert result.relative == ()


def test_short_runs_and_unknown_names_are_refused() -> None:
    short = PoseTrajectory(SPARSE.t_ns[:50], SPARSE.position[:50], SPARSE.quaternion[:50])
    with pytest.raises(EvaluationError, match=r"'uslam' fits on 3\.0-8\.0 s, where 0 of 50"):
        evaluate(short, TRUTH, PROTOCOLS["uslam"])
    with pytest.raises(EvaluationError, match="'rpg' is unknown; expected one of posyaw"):
        protocol_named("rpg")
    assert protocol_named("hku") == Protocol("hku", AlignmentKind.SE3, (0.0, 5.0))


def test_motion_capture_with_gaps() -> None:
    root = Path(os.environ.get("ASYNEIO_DATA", Path(__file__).parents[3] / "shared" / "data"))
    path = root / "tumvi_calib" / "groundtruth.tum"
    if not path.exists():
        pytest.skip(f"{path} is missing; set ASYNEIO_DATA to the folder that holds tumvi_calib")
    table = np.loadtxt(path)
    # Differences to the first stamp survive doubles well enough for interpolation at 120 Hz.
    t_ns = np.rint((table[:, 0] - table[0, 0]) * 1e9).astype(np.int64)
    truth = PoseTrajectory(t_ns, table[:, 1:4], table[:, 4:8])
    regular = np.arange(t_ns[0], t_ns[-1], 10_000_000)
    near = np.clip(np.searchsorted(t_ns, regular), 0, t_ns.size - 1)
    estimate = moved(PoseTrajectory(regular, table[near, 1:4], table[near, 4:8]), WORLD)
    result = evaluate(estimate, truth, PROTOCOLS["posyaw"])
    gaps = np.diff(t_ns)
    expected = np.floor(gaps[gaps > 50_000_000] / 10_000_000).sum()
    assert abs(result.unassociated - expected) <= np.count_nonzero(gaps > 50_000_000)
    # The estimate is the truth up to 8 ms late, of a hand-held motion of about one metre a second.
    assert 1e-4 < result.position_m.rmse < 0.02
    assert 5.0 < result.path_length_m < 100.0
