"""Lie kernels against 50-digit oracles on a logarithmic sweep of the angle, 1e-12 ... pi.

Closed forms lose digits by cancellation at small angles (a coupling block can be wrong by per cents at 1e-5),
so the error is measured block by block, (phi, rho) x (phi, rho), each relative to its own size: a large block
cannot hide a wrong small one.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.geometry import se3, so3
from tests.geometry import mp_oracle as oracle

FloatArray = NDArray[np.float64]

#: Relative error of values and first derivatives, of rates and their derivatives.
VALUE, SECOND = 1e-13, 1e-12

ANGLES = (
    *(10.0**e for e in range(-12, -4)),
    *(m * 10.0**e for e in (-4, -3, -2, -1) for m in (1.0, 3.0)),
    *(0.19999, 0.20001, 0.99, 1.01, 1.99, 2.01, 3.0, math.pi - 1e-3, math.pi - 1e-6),
)
RHO_SIZES = (1e-3, 1.0, 10.0)
TWICE = (math.pi + 1e-3, 4.0, 5.5, 6.28)


class Sample(NamedTuple):
    """A tangent vector with two others to multiply and differentiate with, all (6,)."""

    xi: FloatArray
    u: FloatArray
    v: FloatArray


def samples(angle: float) -> list[Sample]:
    """One sample a size of rho, with a direction of its own: an axis, a diagonal, a random one."""
    rng = np.random.default_rng(int(1e9 * angle) + 7)
    axes = np.eye(3)[rng.integers(3)], np.array([1.0, 1.0, -1.0]) / math.sqrt(3), rng.normal(size=3)
    out = []
    for size, axis in zip(RHO_SIZES, axes, strict=True):
        rho = rng.normal(size=3)
        phi = axis * (angle / np.linalg.norm(axis))
        xi = np.concatenate([phi, rho * (size / np.linalg.norm(rho))])
        out.append(Sample(xi, rng.normal(size=6), rng.normal(size=6)))
    return out


@cache
def first_oracles(angle: float) -> list[tuple[FloatArray, ...]]:
    """Exact J, J^{-1}, d(J v)/d xi and d(J^{-1} v)/d xi of each sample."""
    out = []
    for sample in samples(angle):
        xi, v = oracle.vector(sample.xi), oracle.vector(sample.v)
        J = oracle.right_jacobian(xi)
        exact = (J, J**-1, oracle.d_right_jacobian_times(xi, v), oracle.d_right_jacobian_inverse_times(xi, v))
        out.append(tuple(map(oracle.to_array, exact)))
    return out


def block_error(found: FloatArray, exact: FloatArray) -> float:
    """Largest relative error of the 3-blocks of a vector or matrix; a block that is 0 must be 0 exactly.

    A linear solve at 50 digits leaves 1e-50 where the truth is 0: less than 1e-40 of the whole is 0.
    """
    worst, nothing = 0.0, 1e-40 * np.linalg.norm(exact)
    for i in range(0, found.shape[0], 3):
        for j in range(0, found.shape[1], 3) if found.ndim == 2 else (0,):
            part = (slice(i, i + 3), slice(j, j + 3))[: found.ndim]
            difference, size = np.linalg.norm(found[part] - exact[part]), np.linalg.norm(exact[part])
            if size > nothing:
                worst = max(worst, float(difference / size))
            elif found[part].any():
                return math.inf
    return worst


each_angle = pytest.mark.parametrize("angle", ANGLES, ids=lambda a: f"{a:.6g}")


@each_angle
def test_so3_values(angle: float) -> None:
    for sample in samples(angle):
        phi, out = sample.xi[:3], np.empty((3, 3))
        exact = oracle.vector(phi)
        J = oracle.right_jacobian(exact)
        J_left = oracle.right_jacobian([-x for x in exact])
        so3.so3_exp(phi, out)
        assert block_error(out, oracle.to_array(oracle.group_exp(exact))) < VALUE
        for kernel, value in (
            (so3.so3_right_jacobian, J),
            (so3.so3_right_jacobian_inverse, J**-1),
            (so3.so3_left_jacobian_inverse, J_left**-1),
        ):
            kernel(phi, out)
            assert block_error(out, oracle.to_array(value)) < VALUE, kernel.__name__


@each_angle
def test_se3_exponential_and_adjoints(angle: float) -> None:
    for sample in samples(angle):
        C, r, out = np.empty((3, 3)), np.empty(3), np.empty((6, 6))
        se3.se3_exp(sample.xi, C, r)
        T = oracle.group_exp(oracle.vector(sample.xi))
        assert block_error(C, oracle.to_array(T[:3, :3])) < VALUE
        assert block_error(r, oracle.to_array(list(T[:3, 3]))) < VALUE
        se3.adjoint(C, r, out)
        assert block_error(out, oracle.to_array(oracle.adjoint(T))) < VALUE
        se3.adjoint_inverse(C, r, out)
        assert block_error(out, oracle.to_array(oracle.adjoint(T**-1))) < VALUE

        bracket = np.empty(6)
        se3.bracket(sample.xi, sample.v, bracket)
        exact = oracle.bracket(oracle.vector(sample.xi), oracle.vector(sample.v))
        assert block_error(bracket, oracle.to_array(exact)) < VALUE


@each_angle
def test_logarithms(angle: float) -> None:
    for sample in samples(angle):
        T = oracle.group_exp(oracle.vector(sample.xi))
        phi, xi = np.empty(3), np.empty(6)
        C, r = oracle.to_array(T[:3, :3]), oracle.to_array(list(T[:3, 3]))
        so3.so3_log(C, phi)
        assert block_error(phi, oracle.to_array(oracle.so3_log(T[:3, :3]))) < VALUE
        se3.se3_log(C, r, xi)
        assert block_error(xi, oracle.to_array(oracle.se3_log(T))) < VALUE
        assert block_error(oracle.to_array(oracle.se3_log(T)), sample.xi) < 1e-15


@pytest.mark.slow
@each_angle
def test_right_jacobian_and_inverse(angle: float) -> None:
    out = np.empty((6, 6))
    for sample, (J, J_inverse, _, _) in zip(samples(angle), first_oracles(angle), strict=True):
        se3.right_jacobian(sample.xi, out)
        assert block_error(out, J) < VALUE
        se3.right_jacobian_inverse(sample.xi, out)
        assert block_error(out, J_inverse) < VALUE


@pytest.mark.slow
@each_angle
def test_first_directional_derivatives(angle: float) -> None:
    out, d_xi = np.empty(6), np.empty((6, 6))
    for sample, (J, J_inverse, d_J, d_J_inverse) in zip(samples(angle), first_oracles(angle), strict=True):
        se3.right_jacobian_times(sample.xi, sample.v, d_xi, out)
        assert block_error(out, J @ sample.v) < VALUE
        assert block_error(d_xi, d_J) < VALUE
        se3.right_jacobian_inverse_times(sample.xi, sample.v, d_xi, out)
        assert block_error(out, J_inverse @ sample.v) < VALUE
        assert block_error(d_xi, d_J_inverse) < VALUE


@pytest.mark.slow
@each_angle
@pytest.mark.parametrize("inverse", [False, True], ids=["J", "J_inverse"])
def test_rates_and_second_directional_derivatives(angle: float, inverse: bool) -> None:
    kernel = se3.right_jacobian_inverse_rate_times if inverse else se3.right_jacobian_rate_times
    derivative = oracle.d_right_jacobian_inverse_times if inverse else oracle.d_right_jacobian_times
    jacobian = oracle.right_jacobian_inverse if inverse else oracle.right_jacobian
    pick = ANGLES.index(angle) % 3
    sample = samples(angle)[pick]
    xi, u, v = map(oracle.vector, sample)
    rate = oracle.along(jacobian, xi, u)  # D_xi[J] u
    exact = {
        "out": rate * oracle.MP.matrix(v),
        "d_xi": oracle.along(lambda x: derivative(x, v), xi, u),
        "d_v": rate,
    }
    d_xi, d_u, d_v, out = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    kernel(sample.xi, sample.u, sample.v, d_xi, d_u, d_v, out)
    found = {"out": out[:, None], "d_xi": d_xi, "d_v": d_v}
    errors = {name: block_error(found[name], oracle.to_array(exact[name])) for name in exact}
    errors["d_u"] = block_error(d_u, first_oracles(angle)[pick][3 if inverse else 2])
    assert max(errors.values()) < SECOND, errors


@pytest.mark.parametrize("angle", TWICE)
def test_right_jacobian_reaches_two_pi(angle: float) -> None:
    """The Jacobian proper is used for increments that have not been wrapped."""
    out = np.empty((6, 6))
    for sample in samples(angle):
        se3.right_jacobian(sample.xi, out)
        exact = oracle.to_array(oracle.right_jacobian(oracle.vector(sample.xi)))
        np.testing.assert_allclose(out, exact, rtol=0, atol=VALUE * np.linalg.norm(exact))
