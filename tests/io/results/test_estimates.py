"""`estimates.npz`."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import read_estimates, to_trajectory, write_estimates, write_tum
from asyneio.io.results.estimates import stack_estimates
from asyneio.types import STATE_BLOCKS, Estimate, PoseTrajectory
from tests.io.recordings import START_NS, make_estimate, straight_path


@pytest.fixture
def estimates(rng: np.random.Generator) -> list[Estimate]:
    return [make_estimate(START_NS + index * 50_000_000, rng) for index in range(5)]


def test_estimates_round_trip_to_the_last_bit(tmp_path: Path, estimates: list[Estimate]) -> None:
    write_estimates(tmp_path / "e.npz", estimates)
    found = read_estimates(tmp_path / "e.npz")
    assert [estimate.t_ns for estimate in found] == [estimate.t_ns for estimate in estimates]
    for name, values in stack_estimates(estimates).items():
        np.testing.assert_array_equal(stack_estimates(found)[name], values)
    with np.load(tmp_path / "e.npz") as archive:
        assert tuple(archive["state_blocks"]) == STATE_BLOCKS


def test_same_estimates_same_bytes(tmp_path: Path, estimates: list[Estimate]) -> None:
    write_estimates(tmp_path / "a.npz", estimates)
    write_estimates(tmp_path / "b.npz", estimates)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_no_estimates_are_an_empty_file(tmp_path: Path) -> None:
    write_estimates(tmp_path / "e.npz", [])
    assert read_estimates(tmp_path / "e.npz") == []
    assert to_trajectory([]).position.shape == (0, 3)


def test_poses_of_estimates(estimates: list[Estimate]) -> None:
    truth = straight_path(1.0)
    found = to_trajectory(estimates)
    assert isinstance(found, PoseTrajectory)
    np.testing.assert_allclose(found.position, truth.position[:25:5], atol=5e-3)
    np.testing.assert_allclose(found.quaternion, truth.quaternion[:25:5], atol=1e-9)


def damage(path: Path, **changes: np.ndarray | None) -> None:
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays = {name: changes.get(name, value) for name, value in arrays.items()}
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"covariance": None}, "lacks the arrays covariance"),
        ({"velocity_w": np.zeros((4, 3))}, r"velocity_w is float64 of shape \(4, 3\)"),
        ({"t_ns": np.zeros(5)}, "t_ns is float64"),
        ({"state_blocks": np.array(["rho", "phi"])}, "orders the state as"),
    ],
)
def test_other_archives_are_refused(
    tmp_path: Path, estimates: list[Estimate], changes: dict[str, np.ndarray | None], message: str
) -> None:
    write_estimates(tmp_path / "e.npz", estimates)
    damage(tmp_path / "e.npz", **changes)
    with pytest.raises(RecordingError, match=message):
        read_estimates(tmp_path / "e.npz")


def test_pickled_objects_are_refused(tmp_path: Path, estimates: list[Estimate]) -> None:
    write_estimates(tmp_path / "e.npz", estimates)
    damage(tmp_path / "e.npz", velocity_w=np.array([{"a": 1}] * 5, dtype=object))
    with pytest.raises(RecordingError, match="lacks the arrays velocity_w"):
        read_estimates(tmp_path / "e.npz")


@pytest.mark.parametrize("keep", [0, 10, 300])
def test_truncated_archive_is_refused(tmp_path: Path, estimates: list[Estimate], keep: int) -> None:
    write_estimates(tmp_path / "e.npz", estimates)
    (tmp_path / "e.npz").write_bytes((tmp_path / "e.npz").read_bytes()[:keep])
    with pytest.raises(RecordingError, match="not a readable"):
        read_estimates(tmp_path / "e.npz")


@pytest.mark.slow
def test_archive_bomb_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "e.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t_ns.npy", bytes(2**26))
    with pytest.raises(RecordingError, match="its arrays declare 67108864 bytes, but the file has"):
        read_estimates(tmp_path / "e.npz")


def test_failed_write_leaves_the_old_file(tmp_path: Path, estimates: list[Estimate]) -> None:
    target = tmp_path / "t.tum"
    write_tum(target, to_trajectory(estimates))
    before = target.read_bytes()
    broken = PoseTrajectory(np.arange(3), np.zeros((2, 3)), np.zeros((2, 4)))
    with pytest.raises(ValueError, match="zip"):
        write_tum(target, broken)
    assert target.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["t.tum"]


def test_unwritable_target_is_our_error(tmp_path: Path, estimates: list[Estimate]) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot write"):
        write_estimates(tmp_path / "file" / "e.npz", estimates)
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordingError, match="cannot write"):
        write_estimates(tmp_path / "folder", estimates)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]
