# SPDX-License-Identifier: Apache-2.0
"""Velocity of the camera up to a few unknowns, from gyroscope and accelerometer.

In the frame of the beginning of a span, the velocity is `v_0 + g t + s(t)`, where `s` integrates the specific
force, rotated by the gyroscope. Divided by the depth of the scene, it is linear in seven unknowns: inverse
depth, and `v_0` and `g` times inverse depth. Gyroscope errors turn gravity, so spans are short.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.rotation.time_offset import TurnOf
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Longest span [s], minimum number of windows in one, and steps of the integration [s].
_SPAN_S, _LEAST_WINDOWS, _STEP_S = 4.0, 8, 0.005
#: Prior standard deviations: inverse depth [1/m]; start velocity, and its change over the span by gravity
#: and bias, over depth [1/s].
_PRIOR = (3.0, 0.5, 0.5)


def velocity_basis(
    middle_ns: IntArray, gyroscope: TurnOf, accelerometer: TurnOf, C_c_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Basis of velocity over depth in the camera frame [1/s], and the prior of its coefficients.

    Args:
        middle_ns: (N,) middles of the windows [ns, IMU clock], ascending.
        gyroscope: readings, divided by their scale.
        accelerometer: readings; the scale does not matter.
        C_c_b: (3,3) body to camera rotation.

    Returns:
        The basis (N,3,P) and standard deviations (P,): for each span, inverse depth and the six others.
        Windows in spans with too few windows have zeros. P is 0 if there is no span.
    """
    t_s = (middle_ns - middle_ns[0]) / NS_PER_S
    spans = max(1, int(np.ceil(t_s[-1] / _SPAN_S)))
    length_s = t_s[-1] / spans + 1e-3
    number = (t_s / length_s).astype(int)
    own = []
    for span in np.flatnonzero(np.bincount(number) >= _LEAST_WINDOWS):
        inside = number == span
        times_ns = middle_ns[0] + np.round(
            NS_PER_S * np.arange(span * length_s, (span + 1) * length_s + _STEP_S, _STEP_S)
        ).astype(np.int64)
        attitude, change = _integrated(times_ns, gyroscope, accelerometer)
        nearest = np.minimum(np.searchsorted(times_ns, middle_ns[inside]), len(times_ns) - 1)
        to_camera = C_c_b @ np.swapaxes(attitude[nearest], 1, 2)
        phase = t_s[inside] / length_s - span - 0.5
        columns = np.zeros((len(t_s), 3, 7))
        columns[inside] = np.concatenate(
            [to_camera @ change[nearest][:, :, None], to_camera, to_camera * phase[:, None, None]], axis=2
        )
        own.append(columns)
    if not own:
        return np.zeros((len(t_s), 3, 0)), np.zeros(0)
    depth, start, slope = _PRIOR
    prior = np.array(len(own) * [depth, *(3 * [start]), *(3 * [slope])])
    return np.concatenate(own, axis=2), prior


def _integrated(
    times_ns: IntArray, gyroscope: TurnOf, accelerometer: TurnOf
) -> tuple[FloatArray, FloatArray]:
    """Attitudes (N,3,3) to the frame of the first time, and integrals (N,3) of the rotated specific force
    without their mean and mean slope."""
    turns = Rotation.from_rotvec(gyroscope.between(times_ns)).as_matrix()
    attitude = np.empty((len(times_ns), 3, 3))
    attitude[0] = np.eye(3)
    for k, turn in enumerate(turns):
        attitude[k + 1] = attitude[k] @ turn
    steps = np.einsum("nij,nj->ni", attitude[:-1], accelerometer.between(times_ns))
    change = np.concatenate([np.zeros((1, 3)), np.cumsum(steps - steps.mean(axis=0), axis=0)])
    return attitude, change - change.mean(axis=0)
