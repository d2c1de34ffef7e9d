# SPDX-License-Identifier: Apache-2.0
"""The step from knot k to a query time, `T(tau) = T_k step(xi(tau))` (58), and its Jacobian, in tuples, as
every observation needs them in every iteration.

On SE(3) the step is Exp(xi); on SO(3) x R^3 it is `(Exp(phi), rho)`.
"""

from __future__ import annotations

from asyneio.geometry.tuples import (
    Matrix,
    Vector,
    cross,
    dot,
    exp_coefficients,
    jacobian_coefficients,
    plus,
    rotation_exp,
    row_times_right_jacobian,
    se3_exp_of,
    times,
)
from asyneio.jit import njit
from asyneio.trajectory.model import SE3
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def local_variable(local: FloatArray, weights: FloatArray, n: int, a: int) -> tuple[Vector, Vector]:
    """Row `a` of (20) at query n: xi(tau) for 0, its rate for 1, as (phi, rho). `local` (5,6), `weights`
    (N,2,5)."""
    phi, rho = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for b in range(5):
        w = weights[n, a, b]
        phi = plus(phi, w, (local[b, 0], local[b, 1], local[b, 2]))
        rho = plus(rho, w, (local[b, 3], local[b, 4], local[b, 5]))
    return phi, rho


@njit(cache=True, nogil=True)
def step_pose(phi: Vector, rho: Vector, space: int) -> tuple[Matrix, Vector]:
    """The step of the local variable (phi, rho)."""
    if space == SE3:
        return se3_exp_of(phi, rho)
    a, b, _ = exp_coefficients(dot(phi, phi))
    return rotation_exp(phi, a, b), rho


@njit(cache=True, nogil=True)
def row_times_step_jacobian(
    row: tuple[Vector, Vector], phi: Vector, rho: Vector, C: Matrix, space: int
) -> tuple[Vector, Vector]:
    """Turn a row by the pose at the query time, perturbed on the right, into a row by (phi, rho) (62).

    `C` is the rotation of the step.
    """
    if space == SE3:
        return row_times_right_jacobian(row, phi, rho, jacobian_coefficients(dot(phi, phi)))
    # Of SO(3) alone: J_r = 1 - b phi^ + c phi^2.
    _, b, c = exp_coefficients(dot(phi, phi))
    once = cross(row[0], phi)
    return plus(plus(row[0], -b, once), c, cross(once, phi)), times(C, row[1])
