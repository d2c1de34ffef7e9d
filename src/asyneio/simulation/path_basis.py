# SPDX-License-Identifier: Apache-2.0
"""Uniform quintic B-splines: weights of six control points, and sums over the measurements of an interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PPoly

from asyneio.types import FloatArray, IntArray

DEGREE = 5
#: Number of control points that affect one interval.
ACTIVE = DEGREE + 1
_BUMP = PPoly.from_spline(BSpline.basis_element(np.arange(ACTIVE + 1)).tck)


@dataclass(frozen=True)
class UniformKnots:
    """Knots from 0 to `intervals step_s`, and the knots beyond both ends that quintic splines need."""

    step_s: float
    intervals: int

    @property
    def count(self) -> int:
        """Number of control points."""
        return self.intervals + DEGREE

    @property
    def knots(self) -> FloatArray:
        """All knots (count + 6,) [s]."""
        return np.asarray((np.arange(self.count + ACTIVE) - DEGREE) * self.step_s, dtype=np.float64)

    @property
    def centres_s(self) -> FloatArray:
        """Time of the largest effect of each control point (count,) [s]."""
        return np.asarray((np.arange(self.count) - 0.5 * (DEGREE - 1)) * self.step_s, dtype=np.float64)

    def weights(self, t_s: FloatArray, derivatives: int) -> tuple[IntArray, FloatArray]:
        """First active control point (N,) at times (N,) within the knots, and weights (1 + derivatives, N, 6)
        of it and the next five, for the value, its first derivative, and so on."""
        first = np.clip((t_s / self.step_s).astype(np.int64), 0, self.intervals - 1)
        share = t_s / self.step_s - first
        # The m-th active control point is in the (5 - m)-th piece of its basis function.
        place = share[:, None] + np.arange(DEGREE, -1, -1)
        weights = [_BUMP(place, nu=nu) / self.step_s**nu for nu in range(1 + derivatives)]
        return first, np.array(weights)
