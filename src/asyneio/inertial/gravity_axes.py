# SPDX-License-Identifier: Apache-2.0
"""Axes of gyroscope and accelerometer against each other, from how gravity rotates in the body frame.

The fit of `gravity_witness` is repeated with the gyroscope's axes exchanged or inverted (48 signed
permutations), and with one axis multiplied by a power of two. An alternative counts if it exceeds by
EXCLUDED units of log-likelihood the readings as they are, the readings multiplied by any one factor, and no
rotation at all. The sign of the accelerometer does not matter to this test: gravity rotates equally.
"""

from __future__ import annotations

import itertools

import numpy as np

from asyneio.inertial.gravity_witness import (
    EXCLUDED,
    GravityFit,
    GravityWitness,
    span_edges,
    span_means,
    without_gaps,
)
from asyneio.inertial.stationarity import possible
from asyneio.types import FloatArray, RecordArray

#: Most spans that are evaluated: 60 alternatives are tried on each.
_MOST_SPANS = 8
_FACTORS = (0.25, 0.5, 2.0, 4.0)
_AXES = "xyz"


def axis_complaint(gyroscope: RecordArray, accelerometer: RecordArray, gravity: GravityWitness | None) -> str:
    """A certain error of the axes of the two sensors, as a phrase; empty if there is none.

    Args:
        gyroscope, accelerometer: INERTIAL_DTYPE, ascending [rad/s, m/s^2].
        gravity: scales of both sensors from the same samples.
    """
    streams = [rows[possible(rows["xyz"])] for rows in (gyroscope, accelerometer)]
    if gravity is None or min(rows.size for rows in streams) < 2:
        return ""
    first, last = (end(int(rows["t_ns"][k]) for rows in streams) for end, k in ((max, 0), (min, -1)))
    edges = span_edges(first, last, _MOST_SPANS)
    if edges is None or not (edges := without_gaps(edges, streams)).size:
        return ""
    rate, force = (span_means(rows, edges) for rows in streams)
    factors = np.array([0.0, 1.0, 1.0 / gravity.scale])
    least = float(GravityFit(rate, force).costs(factors)[0].min())
    found = [
        (float(GravityFit(rate @ matrix.T, force).costs(np.ones(1))[0][0]), k)
        for k, matrix in enumerate(_ALTERNATIVES)
    ]
    cost, best = min(found)
    return _described(_ALTERNATIVES[best]) if least - cost > EXCLUDED else ""


def _described(matrix: FloatArray) -> str:
    """The phrase on an alternative: gravity fits `matrix` times the readings of the gyroscope."""
    diagonal = np.diag(matrix)
    if np.array_equal(matrix, -np.eye(3)):
        return (
            "the gyroscope rotates opposite to gravity in the accelerometer: its sign is inverted (multiply "
            "it by -1), or the axes of both sensors are left-handed (two exchanged, or one inverted, in "
            "both: export right-handed axes)"
        )
    if np.count_nonzero(matrix) == 3 and not np.isin(np.abs(diagonal), (0.0, 1.0)).all():
        axis = int(np.argmax(np.abs(np.log2(diagonal))))
        return (
            f"the gyroscope's {_AXES[axis]} axis reads {1.0 / diagonal[axis]:g} times the rotation of "
            f"gravity in the accelerometer, its other axes agree: multiply {_AXES[axis]} by "
            f"{diagonal[axis]:g}"
        )
    columns = np.argmax(np.abs(matrix), axis=1)
    signs = matrix[np.arange(3), columns]
    names = ", ".join(f"{'-' if sign < 0 else ''}{_AXES[k]}" for sign, k in zip(signs, columns, strict=True))
    return (
        "gravity rotates in the accelerometer as if the gyroscope's axes x, y, z were "
        f"{names}: the two sensors have different axes; give both the axes of one sensor"
    )


def _alternatives() -> tuple[FloatArray, ...]:
    """The signed permutations but the identity, and factors of one axis."""
    found = []
    for columns in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), columns] = signs
            found.append(matrix)
    scaled = [np.diag(np.where(np.arange(3) == axis, k, 1.0)) for axis in range(3) for k in _FACTORS]
    return (*found[1:], *scaled)


_ALTERNATIVES = _alternatives()
