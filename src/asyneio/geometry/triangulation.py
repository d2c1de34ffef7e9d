# SPDX-License-Identifier: Apache-2.0
"""Inverse depth of a track from known camera poses: linear, in closed form."""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def triangulate_inverse_depth(
    C_wc: FloatArray,
    r_wc: FloatArray,
    direction: FloatArray,
    C_ref: FloatArray,
    r_ref: FloatArray,
    kappa: FloatArray,
) -> tuple[float, float]:
    """Inverse distance rho along the unit bearing `kappa` of a reference camera, and its information.

    `C_wc` (N,3,3), `r_wc` (N,3) poses of the cameras that saw the unit `direction` (N,3). In each of them the
    landmark lies along A + rho B with A = C^T C_ref kappa and B = C^T (r_ref - r), so z x (A + rho B)
    = 0 is linear in rho.
    The information is in (1/m)^-2 per rad^2 of bearing noise; zero without parallax (rho is then 0).
    """
    information = 0.0
    projection = 0.0
    a = np.empty(3)
    b = np.empty(3)
    for n in range(C_wc.shape[0]):
        for i in range(3):
            a[i] = 0.0
            b[i] = 0.0
            for j in range(3):
                direction_w = C_ref[j, 0] * kappa[0] + C_ref[j, 1] * kappa[1] + C_ref[j, 2] * kappa[2]
                a[i] += C_wc[n, j, i] * direction_w
                b[i] += C_wc[n, j, i] * (r_ref[j] - r_wc[n, j])
        z = direction[n]
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            za = z[p] * a[q] - z[q] * a[p]
            zb = z[p] * b[q] - z[q] * b[p]
            information += zb * zb
            projection += za * zb
    if information < 1e-18:
        return 0.0, 0.0
    return -projection / information, information
