"""Every factor's analytic Jacobian with respect to both knots, against central differences (1e-6)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from asyneio.factors.bias import bias_factor
from asyneio.factors.gp_inertial import (
    accelerometer_jacobian,
    accelerometer_residual,
    gyroscope_jacobian,
    gyroscope_residual,
)
from asyneio.factors.gp_prior import gp_prior_coefficients, gp_prior_factor
from asyneio.factors.local_frame import local_to_knots
from asyneio.factors.marginal_prior import knot_difference
from asyneio.factors.reprojection import (
    Row,
    anchored,
    bearing_row,
    extrinsic_rotation_row,
    landmark_direction,
    reprojection_residual,
    reprojection_row,
    rig_of,
)
from asyneio.geometry.tuples import ORIGIN, matrix_of
from asyneio.state import EPS_0, LOCAL_DOF, XI_DOT_0
from asyneio.trajectory.interpolation import (
    interval_local,
    query_pose,
    query_pose_jacobian,
    weighted,
)
from asyneio.trajectory.model import WNOJ, MotionModel
from asyneio.trajectory.motion_prior import interpolation_weights
from asyneio.trajectory.step import local_variable, row_times_step_jacobian, step_pose
from tests.models import every_model, every_space

from .jacobian_checker import check_jacobian
from .knots import KNOT_BLOCKS, PAIR_BLOCKS, Knot, hat6, random_pair

GRAVITY = np.array([0.0, 0.0, -9.81])
# (interval, scale of the motion): ordinary, long, violent (rotation near 2.5 rad in one interval), tiny
CASES = [(0.05, 1.0), (0.2, 1.0), (0.4, 2.5), (1e-3, 1.0)]


def local_of(k0: Knot, k1: Knot, space: int) -> np.ndarray:
    out = np.empty((5, 6))
    interval_local(k0.C, k0.r, k0.varpi, k1.C, k1.r, k1.varpi, space, out)
    return out


def chain_of(k0: Knot, k1: Knot, space: int) -> np.ndarray:
    out = np.empty((48, 48))
    local_to_knots(k0.C, k0.r, k0.varpi, k1.C, k1.r, k1.varpi, space, out)
    return out


def weights_at(fraction: float, dt: float, prior: int) -> np.ndarray:
    out = np.empty((3, 5))
    interpolation_weights(fraction * dt, dt, prior, out)
    return out


def pair(seed: int, dt: float, scale: float) -> tuple[Knot, Knot]:
    return random_pair(np.random.default_rng(seed), dt, scale)


@pytest.mark.parametrize(("dt", "scale"), CASES)
@pytest.mark.parametrize("seed", range(3))
@every_space
def test_local_coordinates(space: int, seed: int, dt: float, scale: float) -> None:
    k0, k1 = pair(seed, dt, scale)

    def f(d: np.ndarray) -> np.ndarray:
        return local_of(k0.perturbed(d[:24]), k1.perturbed(d[24:]), space).ravel()

    check_jacobian("interval chain", chain_of(k0, k1, space)[6:36], f, PAIR_BLOCKS)


@pytest.mark.parametrize(("dt", "scale"), CASES)
@every_model
def test_gp_prior(model: MotionModel, dt: float, scale: float) -> None:
    k0, k1 = pair(7, dt, scale)
    density = np.array([1.0, 2.0, 3.0, 0.5, 0.7, 4.0])
    coefficients = np.empty((3, 5))
    gp_prior_coefficients(dt, model.prior, coefficients)
    jacobian = np.zeros((18, 48))
    for a in range(3):
        for b in range(5):
            for i in range(6):
                jacobian[6 * a + i, 6 + 6 * b + i] = coefficients[a, b] / density[i]

    def f(d: np.ndarray) -> np.ndarray:
        out = np.empty((3, 6))
        local = local_of(k0.perturbed(d[:24]), k1.perturbed(d[24:]), model.space)
        gp_prior_factor(local, coefficients, density, out)
        return out.ravel()

    # Rows differ by powers of dt: compare row group by row group.
    analytic = jacobian @ chain_of(k0, k1, model.space)
    rows_of_prior = 3 if model.prior == WNOJ else 2
    assert not analytic[6 * rows_of_prior :].any()
    assert not f(np.zeros(48))[6 * rows_of_prior :].any()
    for a in range(rows_of_prior):
        rows = slice(6 * a, 6 * a + 6)
        check_jacobian(f"gp prior row {a}", analytic[rows], lambda d, rows=rows: f(d)[rows], PAIR_BLOCKS)


@pytest.mark.parametrize(("dt", "scale"), CASES)
@pytest.mark.parametrize("fraction", [0.0, 0.31, 0.9, 1.0])
@every_model
def test_gyroscope(model: MotionModel, dt: float, scale: float, fraction: float) -> None:
    k0, k1 = pair(3, dt, scale)
    w = weights_at(fraction, dt, model.prior)
    value = np.array([0.3, -1.0, 2.0])
    jacobian = np.empty((3, 48))
    gyroscope_jacobian(local_of(k0, k1, model.space), w, fraction, jacobian)

    def f(d: np.ndarray) -> np.ndarray:
        a, b = k0.perturbed(d[:24]), k1.perturbed(d[24:])
        out = np.empty(3)
        gyroscope_residual(value, local_of(a, b, model.space), w, np.stack([a.bias, b.bias]), fraction, out)
        return out

    check_jacobian("gyroscope", jacobian @ chain_of(k0, k1, model.space), f, PAIR_BLOCKS)


@pytest.mark.parametrize(("dt", "scale"), CASES)
@pytest.mark.parametrize("fraction", [0.0, 0.31, 0.9, 1.0])
@every_model
def test_accelerometer(model: MotionModel, dt: float, scale: float, fraction: float) -> None:
    k0, k1 = pair(4, dt, scale)
    w = weights_at(fraction, dt, model.prior)
    value = np.array([0.3, -1.0, 9.0])
    jacobian = np.empty((3, 48))
    accelerometer_jacobian(k0.C, local_of(k0, k1, model.space), w, fraction, GRAVITY, model.space, jacobian)

    def f(d: np.ndarray) -> np.ndarray:
        a, b = k0.perturbed(d[:24]), k1.perturbed(d[24:])
        out = np.empty(3)
        bias = np.stack([a.bias, b.bias])
        local = local_of(a, b, model.space)
        accelerometer_residual(value, a.C, local, w, bias, fraction, GRAVITY, model.space, out)
        return out

    check_jacobian("accelerometer", jacobian @ chain_of(k0, k1, model.space), f, PAIR_BLOCKS)


FRACTION = 0.37
XY = np.array([0.1, -0.2])
ROOT = np.array([[200.0, 3.0], [0.0, 180.0]])


@dataclass
class Sight:
    """A landmark seen between two knots `dt` apart, in front of the camera; base frame is the world."""

    model: MotionModel
    dt: float
    anchor: Knot
    k0: Knot
    k1: Knot
    T_bc: np.ndarray
    kappa: np.ndarray
    tangent: np.ndarray
    rho: float

    @property
    def weights(self) -> np.ndarray:
        return weights_at(FRACTION, self.dt, self.model.prior)

    @property
    def local(self) -> np.ndarray:
        return local_of(self.k0, self.k1, self.model.space)

    def direction(self, late: float = 0.0, turn: np.ndarray | None = None) -> tuple[Any, ...]:
        """Query rotation, rig, landmark, point and direction, `late` intervals later, camera rotated by
        `turn` (3,)."""
        C, r = np.empty((3, 3)), np.empty(3)
        weights = weights_at(FRACTION + late, self.dt, self.model.prior)
        query_pose(self.k0.C, self.k0.r, self.local, weights[0], self.model.space, C, r)
        C_bc = self.T_bc[:3, :3]
        if turn is not None:
            C_bc = C_bc @ expm_of(np.append(turn, np.zeros(3)))[:3, :3]
        rig = rig_of(C_bc, self.T_bc[:3, 3])
        # The origin of the world is moved to the query.
        landmark = anchored(
            matrix_of(self.anchor.C), tuple(self.anchor.r - r), rig, tuple(self.kappa), self.rho
        )
        return C, rig, landmark, *landmark_direction(landmark, matrix_of(C), ORIGIN, rig)

    def residual(self, late: float = 0.0, turn: np.ndarray | None = None) -> np.ndarray:
        *_, h = self.direction(late, turn)
        visible, *out = reprojection_residual(h, XY[None], ROOT[None], 0)
        assert visible
        return np.array(out)

    def rows(self) -> list[Row]:
        C, rig, landmark, x_b, h = self.direction()
        return [reprojection_row(*ROOT[m], landmark, matrix_of(C), ORIGIN, rig, x_b, h) for m in range(2)]

    def by_query(self) -> np.ndarray:
        """Rows (2,6) by the pose of the query."""
        return np.array([np.ravel(row.query) for row in self.rows()])

    def pose_jacobian(self) -> tuple[np.ndarray, np.ndarray]:
        d_eps, d_xi = np.empty((6, 6)), np.empty((6, 6))
        query_pose_jacobian(self.local, self.weights[0], self.model.space, d_eps, d_xi)
        return d_eps, d_xi


def sight(model: MotionModel, dt: float, scale: float, rho: float) -> Sight:
    rng = np.random.default_rng(11)
    k0, k1 = pair(5, dt, scale)
    # The anchor is somewhere near, so that the landmark is in front.
    anchor = Knot(k0.T @ expm_of(0.2 * rng.normal(size=6)), np.zeros((2, 6)), np.zeros(6))
    T_bc = expm_of(0.3 * rng.normal(size=6))
    C_bc, r_bc = np.ascontiguousarray(T_bc[:3, :3]), np.ascontiguousarray(T_bc[:3, 3])
    weights = weights_at(FRACTION, dt, model.prior)
    kappa, tangent = bearing_in_front(anchor, k0, k1, C_bc, r_bc, rho, weights, model.space)
    return Sight(model, dt, anchor, k0, k1, T_bc, kappa, tangent, rho)


def every_sight(test: Any) -> Any:
    """Every model, several intervals and depths."""
    for marked in (
        every_model,
        pytest.mark.parametrize("rho", [0.0, 0.4, 5.0]),
        pytest.mark.parametrize(("dt", "scale"), CASES),
    ):
        test = marked(test)
    return test


@every_sight
def test_reprojection_by_anchor_and_landmark(model: MotionModel, dt: float, scale: float, rho: float) -> None:
    seen = sight(model, dt, scale, rho)
    _, rig, *_ = seen.direction()

    def f(d: np.ndarray) -> np.ndarray:
        anchor = seen.anchor.perturbed(np.concatenate([d[:6], np.zeros(18)]))
        return replace(
            seen, anchor=anchor, rho=rho + d[6], kappa=seen.kappa + seen.tangent @ d[7:9]
        ).residual()

    analytic = [
        [*np.ravel(row.anchor), row.by_rho, *bearing_row(row, rig, seen.tangent[None], 0)]
        for row in seen.rows()
    ]
    blocks = [("anchor", 6), ("inverse depth", 1), ("bearing", 2)]
    check_jacobian("reprojection", np.array(analytic), f, blocks)


@every_sight
def test_reprojection_by_both_knots(model: MotionModel, dt: float, scale: float, rho: float) -> None:
    seen = sight(model, dt, scale, rho)

    def f(d: np.ndarray) -> np.ndarray:
        return replace(seen, k0=seen.k0.perturbed(d[:24]), k1=seen.k1.perturbed(d[24:])).residual()

    (d_eps, d_xi), by_query = seen.pose_jacobian(), seen.by_query()
    assert_rows_are_moved(by_query, seen.local, seen.weights[0], model.space, d_xi)
    by_local = np.zeros((2, LOCAL_DOF))
    by_local[:, EPS_0 : EPS_0 + 6] = by_query @ d_eps
    for b, w in enumerate(seen.weights[0]):
        by_local[:, XI_DOT_0 + 6 * b : XI_DOT_0 + 6 * b + 6] = w * by_query @ d_xi
    analytic = by_local @ chain_of(seen.k0, seen.k1, model.space)
    check_jacobian("reprojection", analytic, f, PAIR_BLOCKS)


@every_sight
def test_reprojection_by_time_offset_and_rotation(
    model: MotionModel, dt: float, scale: float, rho: float
) -> None:
    """The offset in units of the interval, so that one step suits all lengths."""
    seen = sight(model, dt, scale, rho)
    _, rig, landmark, _, h = seen.direction()
    _, d_xi = seen.pose_jacobian()
    xi_dot = np.empty(6)
    weighted(seen.local, seen.weights[1], xi_dot)
    by_offset = dt * seen.by_query() @ d_xi @ xi_dot
    by_rotation = np.array([extrinsic_rotation_row(row, landmark, rig, h) for row in seen.rows()])
    check_jacobian(
        "reprojection",
        np.column_stack([by_offset, by_rotation]),
        lambda d: seen.residual(float(d[0]), d[1:]),
        [("time offset", 1), ("extrinsic rotation", 3)],
    )


def assert_rows_are_moved(
    rows: np.ndarray, local: np.ndarray, w: np.ndarray, space: int, d_xi: np.ndarray
) -> None:
    """The window multiplies rows without forming the matrix, and takes its steps in tuples."""
    weights = w[None, None].repeat(2, axis=1)
    phi, rho = local_variable(local, weights, 0, 0)
    step, r = step_pose(phi, rho, space)
    C_expected, r_expected = np.empty((3, 3)), np.empty(3)
    query_pose(np.eye(3), np.zeros(3), local, w, space, C_expected, r_expected)
    np.testing.assert_allclose(np.array(step), C_expected, atol=1e-14)
    np.testing.assert_allclose(np.array(r), r_expected, atol=1e-14 * max(1.0, np.abs(r_expected).max()))
    for row in rows:
        moved = row_times_step_jacobian((tuple(row[:3]), tuple(row[3:])), phi, rho, step, space)
        np.testing.assert_allclose(np.ravel(moved), row @ d_xi, atol=1e-12 * np.abs(rows).max())


def expm_of(xi: np.ndarray) -> np.ndarray:
    return Knot(np.eye(4), np.zeros((2, 6)), np.zeros(6)).perturbed(np.concatenate([xi, np.zeros(18)])).T


def bearing_in_front(anchor, k0, k1, C_bc, r_bc, rho, w, space):  # type: ignore[no-untyped-def]
    """A unit bearing whose point lies in front of the query camera, with an orthonormal tangent basis."""
    rng = np.random.default_rng(2)
    C, r = np.empty((3, 3)), np.empty(3)
    query_pose(k0.C, k0.r, local_of(k0, k1, space), w[0], space, C, r)
    for _ in range(500):
        kappa = rng.normal(size=3)
        kappa /= np.linalg.norm(kappa)
        rig = rig_of(C_bc, r_bc)
        landmark = anchored(matrix_of(anchor.C), tuple(anchor.r - r), rig, tuple(kappa), rho)
        _, h = landmark_direction(landmark, matrix_of(C), ORIGIN, rig)
        if h[2] > 0.7:
            q, _ = np.linalg.qr(np.column_stack([kappa, rng.normal(size=(3, 2))]))
            return kappa, np.ascontiguousarray(q[:, 1:])
    raise AssertionError("no bearing found")


def test_landmark_behind_is_a_status() -> None:
    for depth in (-0.5, 0.0, np.nan):
        answer = reprojection_residual((0.1, 0.1, depth), np.zeros((1, 2)), np.eye(2)[None], 0)
        assert answer == (False, 0.0, 0.0)


def test_bias() -> None:
    walk = np.array([1e-5, 2e-5, 3e-5, 1e-3, 2e-3, 3e-3])
    dt = 0.05
    b = 0.1 * np.random.default_rng(0).normal(size=(2, 6))

    def f(d: np.ndarray) -> np.ndarray:
        out = np.empty(6)
        bias_factor(b[0] + d[:6], b[1] + d[6:], walk, dt, out)
        return out

    info = np.diag(1.0 / (walk * np.sqrt(dt)))
    check_jacobian("bias", np.hstack([-info, info]), f, [("b_k", 6), ("b_k+1", 6)])


def test_marginal_prior_is_linear_in_delta() -> None:
    k0, _ = pair(9, 0.1, 1.0)

    def f(d: np.ndarray) -> np.ndarray:
        k = k0.perturbed(d)
        out = np.empty(24)
        knot_difference(k0.C, k0.r, k0.varpi, k0.bias, k.C, k.r, k.varpi, k.bias, out)
        return out

    check_jacobian("marginal prior", np.eye(24), f, KNOT_BLOCKS)
    delta = 0.3 * np.random.default_rng(1).normal(size=24)
    np.testing.assert_allclose(f(delta), delta, atol=1e-12)
    assert hat6(delta[:6]).shape == (4, 4)
