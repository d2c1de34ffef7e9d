"""Factor of preintegrated increments and propagated poses, against differences and an analytic motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from asyneio.factors import preintegration
from asyneio.factors.preintegration import (
    Increment,
    preintegration_jacobian,
    preintegration_residual,
    propagated_pose,
    propagated_pose_jacobian,
)
from asyneio.factors.propagated_rates import propagated_velocity, shifted_increments
from asyneio.inertial.gp_preintegration import gp_preintegration
from asyneio.inertial.increments import Increments, SampleNoise

from ..inertial.windows import START, shaken, window_of
from .jacobian_checker import check_jacobian
from .knots import PAIR_BLOCKS, Knot, random_pair

GRAVITY = np.array([0.0, 0.0, -9.81])
CASES = [(0.05, 1.0), (0.2, 1.0), (0.4, 2.5), (1e-3, 1.0)]


def random_increments(seed: int, change: float = 0.02) -> tuple[Increments, np.ndarray]:
    """Increments of no motion at all, so that no term vanishes, and the biases they were computed with."""
    rng = np.random.default_rng(seed)
    C = Rotation.from_rotvec(rng.normal(size=3) * 0.3).as_matrix()
    d_bias = rng.normal(size=(9, 6))
    return Increments(C, rng.normal(size=3), rng.normal(size=3), d_bias), change * rng.normal(size=6)


def as_kernels_take(knot: Knot) -> preintegration.Knot:
    return preintegration.Knot(knot.C, knot.r, np.ascontiguousarray(knot.varpi[0, 3:]), knot.bias)


def factor_of(a: Knot, b: Knot, found: Increments, reference: np.ndarray, dt: float):  # type: ignore[no-untyped-def]
    """Arguments that the residual and its Jacobian share."""
    return as_kernels_take(a), as_kernels_take(b), Increment(*found, reference, dt), GRAVITY


def residual_of(a: Knot, b: Knot, found: Increments, reference: np.ndarray, dt: float) -> np.ndarray:
    out = np.empty(9)
    preintegration_residual(*factor_of(a, b, found, reference, dt), out)
    return out


@pytest.mark.parametrize(("dt", "scale"), CASES)
@pytest.mark.parametrize("seed", range(3))
def test_residual_jacobian(seed: int, dt: float, scale: float) -> None:
    """With a change of bias large enough that its own second-order terms count."""
    k0, k1 = random_pair(np.random.default_rng(seed), dt, scale)
    found, reference = random_increments(seed)
    reference += k0.bias - 0.2
    jacobian = np.empty((9, 48))
    preintegration_jacobian(*factor_of(k0, k1, found, reference, dt), jacobian)

    def f(d: np.ndarray) -> np.ndarray:
        return residual_of(k0.perturbed(d[:24]), k1.perturbed(d[24:]), found, reference, dt)

    # Rows differ in unit and size: compare group by group.
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        check_jacobian(
            f"preintegration rows {rows.start}", jacobian[rows], lambda d, r=rows: f(d)[r], PAIR_BLOCKS
        )
    assert np.abs(np.delete(jacobian, np.r_[0:6, 9:12, 18:30, 33:36], axis=1)).max() == 0.0


def true_knot(t: float, seed: int, bias: np.ndarray) -> Knot:
    motion = shaken(seed)
    T = motion.T_w_b(t)[0]
    varpi = np.zeros((2, 6))
    varpi[0, 3:] = T[:3, :3].T @ motion.velocity_w(t)[0]
    return Knot(T, varpi, bias)


def single(found: Increments) -> Increments:
    return Increments(*(part[0] for part in found))


@pytest.mark.parametrize("seed", range(3))
def test_true_knots_have_no_residual(seed: int) -> None:
    window = window_of(shaken(seed), 0.2, 500.0)
    found = gp_preintegration(window, np.zeros(6), SampleNoise(1e-9, 1e-8))
    a, b = (true_knot(START + t, seed, np.zeros(6)) for t in (0.0, 0.2))
    assert np.abs(residual_of(a, b, single(found.end()), np.zeros(6), 0.2)).max() < 1e-7


@pytest.mark.parametrize("seed", range(3))
def test_bias_correction_is_that_of_first_order(seed: int) -> None:
    """Against increments computed anew with the other bias: halving the change quarters the error."""
    window, noise = window_of(shaken(seed), 0.2, 500.0), SampleNoise(1e-9, 1e-8)
    found = single(gp_preintegration(window, np.zeros(6), noise).end())
    a, b = (true_knot(START + t, seed, np.zeros(6)) for t in (0.0, 0.2))
    errors = []
    for size in (0.1, 0.05):
        bias = size * np.array([1.0, -0.5, 0.8, 1.0, 2.0, -1.0])
        knot = Knot(a.T, a.varpi, bias)
        anew = single(gp_preintegration(window, bias, noise).end())
        corrected = residual_of(knot, b, found, np.zeros(6), 0.2)
        errors.append(np.abs(corrected - residual_of(knot, b, anew, bias, 0.2)).max())
    assert errors[0] < 1e-3
    np.testing.assert_allclose(errors[0] / errors[1], 4.0, rtol=0.2)


def propagation_of(
    knot: Knot, found: Increments, reference: np.ndarray, tau: float
) -> tuple[preintegration.Knot, Increment]:
    """Arguments that `propagated_pose` and its Jacobian share."""
    return as_kernels_take(knot), Increment(*found, reference, tau)


def pose_of(knot: Knot, found: Increments, reference: np.ndarray, tau: float) -> np.ndarray:
    T = np.eye(4)
    C, r = np.empty((3, 3)), np.empty(3)
    propagated_pose(*propagation_of(knot, found, reference, tau), GRAVITY, C, r)
    T[:3, :3], T[:3, 3] = C, r
    return T


@pytest.mark.slow
@pytest.mark.parametrize(("dt", "scale"), CASES)
@pytest.mark.parametrize("seed", range(3))
def test_propagated_pose_jacobian(seed: int, dt: float, scale: float) -> None:
    knot, _ = random_pair(np.random.default_rng(seed), dt, scale)
    found, reference = random_increments(seed)
    reference += knot.bias - 0.2
    d_eps, d_nu, d_bias = np.empty((6, 6)), np.empty((6, 3)), np.empty((6, 6))
    propagated_pose_jacobian(*propagation_of(knot, found, reference, dt), d_eps, d_nu, d_bias)
    T_inv = np.linalg.inv(pose_of(knot, found, reference, dt))

    def f(d: np.ndarray) -> np.ndarray:
        delta = np.concatenate([d[:6], np.zeros(3), d[6:9], np.zeros(6), d[9:]])
        xi = np.real(logm(T_inv @ pose_of(knot.perturbed(delta), found, reference, dt)))
        return np.array([xi[2, 1], xi[0, 2], xi[1, 0], *xi[:3, 3]])

    blocks = [("eps", 6), ("nu", 3), ("biases", 6)]
    analytic = np.hstack([d_eps, d_nu, d_bias])
    for rows in (slice(0, 3), slice(3, 6)):
        check_jacobian(
            f"propagated pose rows {rows.start}", analytic[rows], lambda d, r=rows: f(d)[r], blocks
        )


@pytest.mark.parametrize("shift", [0.0, 0.01])
@pytest.mark.parametrize(("dt", "scale"), CASES)
def test_propagated_velocity_is_the_derivative_by_time(dt: float, scale: float, shift: float) -> None:
    """The increments change with their rates; also at times to which they have been shifted."""
    rng = np.random.default_rng(3)
    knot, _ = random_pair(rng, dt, scale)
    found, reference = random_increments(3)
    reference += knot.bias - 0.2
    rates = rng.normal(size=3), rng.normal(size=(3, 6))

    def later(seconds: float) -> Increments:
        out = Increments(np.empty((3, 3)), found.nu, np.empty(3), np.empty((9, 6)))
        increment = Increment(*found, reference, dt)
        shifted_increments(increment, *rates, seconds, out.C, out.r, out.d_bias)
        return out

    at = later(shift)
    velocity = np.empty(6)
    propagated_velocity(*propagation_of(knot, at, reference, dt + shift), *rates, GRAVITY, velocity)
    T_inv = np.linalg.inv(pose_of(knot, at, reference, dt + shift))

    def f(d: np.ndarray) -> np.ndarray:
        moved = pose_of(knot, later(shift + float(d[0])), reference, dt + shift + float(d[0]))
        xi = np.real(logm(T_inv @ moved))
        return np.array([xi[2, 1], xi[0, 2], xi[1, 0], *xi[:3, 3]])

    check_jacobian("propagated pose", velocity[:, None], f, [("time", 1)])


@pytest.mark.parametrize("tau", [0.0, 0.0712, 0.2])
def test_propagated_pose_follows_the_motion(tau: float) -> None:
    """One knot and the increments at tau give the pose at tau (29)."""
    motion = shaken(2)
    found = gp_preintegration(window_of(motion, 0.2, 500.0), np.zeros(6), SampleNoise(1e-9, 1e-8))
    pose = pose_of(true_knot(START, 2, np.zeros(6)), single(found.at(np.array([tau]))), np.zeros(6), tau)
    np.testing.assert_allclose(pose, motion.T_w_b(START + tau)[0], atol=1e-8)
