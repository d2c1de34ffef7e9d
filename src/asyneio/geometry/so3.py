# SPDX-License-Identifier: Apache-2.0
"""SO(3): rotations. Tangent vectors `phi` (3,) in rad; perturbation on the right, `C = C_bar Exp(phi)`.

Laws (tested): Exp(Log(C)) = C; Exp(phi + d) = Exp(phi) Exp(J_r(phi) d) to first order; J_r J_r^{-1} = 1.
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.series import SO3_INVERSE_SERIES, SO3_JACOBIAN_SERIES, evaluate_value
from asyneio.jit import njit
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def so3_polynomial(phi: FloatArray, a1: float, a2: float, out: FloatArray) -> None:
    """`out = 1 + a1 phi^ + a2 phi^ phi^` (3,3); only the first three entries of `phi` count."""
    x, y, z = phi[0], phi[1], phi[2]
    out[0, 0] = 1.0 - a2 * (y * y + z * z)
    out[1, 1] = 1.0 - a2 * (x * x + z * z)
    out[2, 2] = 1.0 - a2 * (x * x + y * y)
    out[0, 1] = a2 * x * y - a1 * z
    out[1, 0] = a2 * x * y + a1 * z
    out[0, 2] = a2 * x * z + a1 * y
    out[2, 0] = a2 * x * z - a1 * y
    out[1, 2] = a2 * y * z - a1 * x
    out[2, 1] = a2 * y * z + a1 * x


@njit(cache=True, nogil=True)
def so3_exp(phi: FloatArray, out: FloatArray) -> None:
    """Rotation matrix `out` (3,3) of the rotation vector `phi` (3,), any angle (Rodrigues)."""
    s = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if s < 1e-8:
        a1 = 1.0 - s / 6.0
        a2 = 0.5 - s / 24.0
    else:
        theta = np.sqrt(s)
        half = np.sin(0.5 * theta) / theta
        a1 = np.sin(theta) / theta
        a2 = 2.0 * half * half
    so3_polynomial(phi, a1, a2, out)


def rotation(phi: FloatArray) -> FloatArray:
    """Rotation matrix (3,3) of the rotation vector `phi` (3,), for use outside kernels."""
    out = np.empty((3, 3))
    so3_exp(np.ascontiguousarray(phi), out)
    return out


@njit(cache=True, nogil=True)
def so3_log(C: FloatArray, out: FloatArray) -> None:
    """Rotation vector `out` (3,), angle in [0, pi], of the rotation matrix `C` (3,3).

    Through the quaternion with the largest component first (Shepperd), exact to rounding at 0 and at pi.
    """
    trace = C[0, 0] + C[1, 1] + C[2, 2]
    if trace >= C[0, 0] and trace >= C[1, 1] and trace >= C[2, 2]:
        w = 0.5 * np.sqrt(1.0 + trace)
        f = 0.25 / w
        x = (C[2, 1] - C[1, 2]) * f
        y = (C[0, 2] - C[2, 0]) * f
        z = (C[1, 0] - C[0, 1]) * f
    elif C[0, 0] >= C[1, 1] and C[0, 0] >= C[2, 2]:
        x = 0.5 * np.sqrt(1.0 + C[0, 0] - C[1, 1] - C[2, 2])
        f = 0.25 / x
        w = (C[2, 1] - C[1, 2]) * f
        y = (C[0, 1] + C[1, 0]) * f
        z = (C[0, 2] + C[2, 0]) * f
    elif C[1, 1] >= C[2, 2]:
        y = 0.5 * np.sqrt(1.0 - C[0, 0] + C[1, 1] - C[2, 2])
        f = 0.25 / y
        w = (C[0, 2] - C[2, 0]) * f
        x = (C[0, 1] + C[1, 0]) * f
        z = (C[1, 2] + C[2, 1]) * f
    else:
        z = 0.5 * np.sqrt(1.0 - C[0, 0] - C[1, 1] + C[2, 2])
        f = 0.25 / z
        w = (C[1, 0] - C[0, 1]) * f
        x = (C[0, 2] + C[2, 0]) * f
        y = (C[1, 2] + C[2, 1]) * f
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    n = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 / w if n < 1e-9 else 2.0 * np.arctan2(n, w) / n
    out[0] = scale * x
    out[1] = scale * y
    out[2] = scale * z


@njit(cache=True, nogil=True)
def so3_right_jacobian(phi: FloatArray, out: FloatArray) -> None:
    """`out = J_r(phi)` (3,3), angles to 2 pi."""
    s = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    a1 = evaluate_value(SO3_JACOBIAN_SERIES, 0, s, False)
    a2 = evaluate_value(SO3_JACOBIAN_SERIES, 1, s, False)
    so3_polynomial(phi, a1, a2, out)


@njit(cache=True, nogil=True)
def so3_right_jacobian_inverse(phi: FloatArray, out: FloatArray) -> None:
    """`out = J_r(phi)^{-1}` (3,3), angles to pi."""
    s = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    so3_polynomial(phi, 0.5, evaluate_value(SO3_INVERSE_SERIES, 1, s, True), out)


@njit(cache=True, nogil=True)
def so3_left_jacobian_inverse(phi: FloatArray, out: FloatArray) -> None:
    """`out = J_l(phi)^{-1}` (3,3), angles to pi."""
    s = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    so3_polynomial(phi, -0.5, evaluate_value(SO3_INVERSE_SERIES, 1, s, True), out)
