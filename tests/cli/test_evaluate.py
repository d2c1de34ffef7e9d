"""`asyneio evaluate` from the command line: formats of other tools, hints, and fixes that work."""

from __future__ import annotations

import gzip
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.evaluation import EXTENDED_PROTOCOLS, PROTOCOLS
from asyneio.io import write_tum
from asyneio.types import NS_PER_S, PoseTrajectory
from tests.cli.conftest import Asyneio

S = np.arange(0.0, 20.0, 0.02)


def trajectory(scale: float = 1.0, body: Rotation | None = None, step: int = 1) -> PoseTrajectory:
    p = scale * np.stack([2 * np.sin(0.6 * S), 1.5 * np.cos(0.4 * S), 0.3 * np.sin(S)], axis=1)
    angles = np.stack([0.5 * np.sin(0.4 * S), 0.4 * np.sin(0.9 * S), 0.3 * np.cos(S)], axis=1)
    q = (Rotation.from_euler("zyx", angles) * (body or Rotation.identity())).as_quat()
    t_ns = 1_600_000_000 * NS_PER_S + np.rint(S * NS_PER_S).astype(np.int64)
    return PoseTrajectory(t_ns[::step], p[::step], q[::step])


@pytest.fixture
def estimate(tmp_path: Path) -> Path:
    write_tum(tmp_path / "estimate.tum", trajectory())
    return tmp_path / "estimate.tum"


def test_help_names_every_protocol(asyneio: Asyneio) -> None:
    status, out, _ = asyneio("evaluate", "--help")
    assert status == 0
    lines = [line.strip() for line in out.splitlines()]
    for name, protocol in PROTOCOLS.items():
        assert f"{name:8}{protocol.about}" in lines
    for name, about in EXTENDED_PROTOCOLS.items():
        assert f"{name:11}{about}" in lines


@pytest.mark.parametrize(
    ("scale", "said"), [(1000.0, "truth in millimetres"), (0.001, "estimate in millimetres"), (1.3, "")]
)
def test_units(asyneio: Asyneio, estimate: Path, scale: float, said: str) -> None:
    truth = estimate.with_name("truth.tum")
    write_tum(truth, trajectory(scale))
    status, _, err = asyneio("evaluate", estimate, truth)
    assert status == 0
    assert (said in " ".join(err.split())) if said else err == ""


def test_another_body_frame(asyneio: Asyneio, estimate: Path) -> None:
    truth = estimate.with_name("truth.tum")
    write_tum(truth, trajectory(body=Rotation.from_euler("xyz", [90, 0, 90], degrees=True)))
    said = " ".join(asyneio("evaluate", estimate, truth)[2].split())
    assert "constant rotation of 120.0 deg in the body frame" in said


def test_a_world_that_is_not_upright(asyneio: Asyneio, estimate: Path) -> None:
    turn, found = Rotation.from_euler("x", 90, degrees=True), trajectory()
    turned = PoseTrajectory(
        found.t_ns, turn.apply(found.position), (turn * Rotation.from_quat(found.quaternion)).as_quat()
    )
    truth = estimate.with_name("truth.tum")
    write_tum(truth, turned)
    said = " ".join(asyneio("evaluate", estimate, truth)[2].split())
    assert "tilts the vertical by 90.0 deg" in said
    assert "--protocol se3 aligns it" in said
    status, out, err = asyneio("evaluate", estimate, truth, "--protocol", "se3")
    assert (status, err) == (0, "")
    assert "0.000 cm" in out


@pytest.mark.slow
def test_quaternions_with_w_first_are_named_and_the_cure_works(asyneio: Asyneio, estimate: Path) -> None:
    found = trajectory()
    lines = [
        f"{t / 1e9:.9f} {' '.join(map(repr, [*p, q[3], *q[:3]]))}\n"
        for t, p, q in zip(
            found.t_ns.tolist(), found.position.tolist(), found.quaternion.tolist(), strict=True
        )
    ]
    mine = estimate.with_name("mine.txt")
    mine.write_text("".join(lines))
    said = " ".join(asyneio("evaluate", mine, estimate)[2].split())
    assert "w is first in the quaternions of the estimate" in said
    columns = ("--columns", "t,px,py,pz,qw,qx,qy,qz")
    assert " ".join(columns) in said
    status, out, err = asyneio("evaluate", mine, estimate, *columns)
    assert status == 0
    assert "is first in" not in err
    assert "0.000 deg" in out


def test_sparse_truth_and_its_cure(asyneio: Asyneio, estimate: Path) -> None:
    truth = estimate.with_name("truth.tum")
    write_tum(truth, trajectory(step=50))
    shifted = trajectory()
    write_tum(estimate, PoseTrajectory(shifted.t_ns + 7_000_000, shifted.position, shifted.quaternion))
    status, _, err = asyneio("evaluate", estimate, truth)
    assert status == 1
    assert "--max-gap 1.1" in err
    assert asyneio("evaluate", estimate, truth, "--max-gap", "1.1")[0] == 0


@pytest.mark.slow
def test_kitti_row_by_row(asyneio: Asyneio, estimate: Path) -> None:
    found = trajectory()
    R = Rotation.from_quat(found.quaternion).as_matrix()
    M = np.concatenate([R, found.position[:, :, None]], axis=2).reshape(-1, 12)
    kitti = estimate.with_name("00.txt")
    np.savetxt(kitti, M)
    for pair in ((kitti, estimate), (estimate, kitti), (kitti, kitti)):
        status, out, _ = asyneio("evaluate", *pair)
        assert status == 0
        assert "0.000 cm" in out
    np.savetxt(kitti, M[:-1])
    status, _, err = asyneio("evaluate", kitti, estimate)
    assert status == 1
    assert "999 in the estimate and 1000 in the ground truth" in err


def test_what_is_no_trajectory_is_told_how_to_be_read(asyneio: Asyneio, estimate: Path) -> None:
    wrong = estimate.with_name("wrong.txt")
    wrong.write_text("".join(f"{k / 100} {k} 2 3 4 5 6 7\n" for k in range(9)))
    for option, pair in (("--columns", (wrong, estimate)), ("--truth-columns", (estimate, wrong))):
        status, _, err = asyneio("evaluate", *pair)
        assert status == 1
        assert "the first line is '0.0 0 2 3 4 5 6 7'" in err
        assert f"Name other columns with {option} t,px,py,pz,qx,qy,qz,qw" in err


@pytest.mark.parametrize("header", ["", "#t x y z\n"])
@pytest.mark.parametrize("protocol", ["posyaw", "se3", "sim3"])
def test_positions_alone_with_the_cure(asyneio: Asyneio, estimate: Path, header: str, protocol: str) -> None:
    true, truth = trajectory(), estimate.with_name("leica.txt")
    rows = [
        f"{t_ns / NS_PER_S:.6f} {' '.join(map(str, p))}"
        for t_ns, p in zip(true.t_ns.tolist(), true.position.tolist(), strict=True)
    ]
    truth.write_text(header + "\n".join(rows) + "\n")
    status, _, err = asyneio("evaluate", estimate, truth)
    assert status == 1
    assert "write 0 0 0 1 after each position" in " ".join(err.split())
    truth.write_text(header + "".join(f"{row} 0 0 0 1\n" for row in rows))
    status, out, _ = asyneio("evaluate", estimate, truth, "--protocol", protocol, "--json")
    assert status == 0
    assert json.loads(out)["position_m"]["rmse"] < 1e-5


def moved(seconds: float) -> PoseTrajectory:
    whole = trajectory()
    return PoseTrajectory(whole.t_ns + round(seconds * NS_PER_S), whole.position, whole.quaternion)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (moved(0.0), ""),
        (moved(2.5), "if about 2.50 s are added to the timestamps of the estimate"),
        (moved(-1.2), "if about -1.20 s are added to the timestamps of the estimate"),
        (
            PoseTrajectory(trajectory().t_ns, trajectory().position * [1, -1, 1], trajectory().quaternion),
            "if one world is mirrored",
        ),
        (
            PoseTrajectory(
                trajectory().t_ns, trajectory().position, trajectory().quaternion * [-1, -1, -1, 1]
            ),
            "are inverted: it contains rotations of the world into the body",
        ),
    ],
)
def test_hints_on_clocks_and_axes(asyneio: Asyneio, estimate: Path, other: PoseTrajectory, said: str) -> None:
    truth = estimate.with_name("truth.tum")
    write_tum(truth, other)
    status, _, err = asyneio("evaluate", estimate, truth)
    assert status == 0
    assert said in err.replace("\n", " ")
    assert bool(said) == ("agree if" in err)


def test_compressed_and_binary_files_are_named(asyneio: Asyneio, estimate: Path) -> None:
    packed = estimate.with_name("packed.tum.gz")
    packed.write_bytes(gzip.compress(estimate.read_bytes()))
    status, _, err = asyneio("evaluate", packed, estimate)
    assert status == 1
    command = err.split("type `")[1].split("`")[0]
    subprocess.run(command, shell=True, check=True)
    assert asyneio("evaluate", packed.with_suffix(""), estimate)[0] == 0
    noise = estimate.with_name("noise.bin")
    noise.write_bytes(np.random.default_rng(0).bytes(4000))
    assert "is not text" in asyneio("evaluate", noise, estimate)[2]
