# SPDX-License-Identifier: Apache-2.0
"""Initialization from a known state: requires no parallax, and uses the world frame of the state."""

from __future__ import annotations

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.problem.problem import Prior, States
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.first_window import FirstWindow, filled_window
from asyneio.odometry.propagation import predict_knot, rates_at
from asyneio.odometry.settings import Settings
from asyneio.state import BIAS, DOF, EPS, NU
from asyneio.types import NS_PER_S, FloatArray, InitialState

#: Largest deviation of a rotation matrix from orthonormality: that of single precision.
_ROTATION_TOLERANCE = 1e-5
#: Columns of a knot's error state that an initial state determines: pose, velocity, biases.
_KNOWN = np.r_[EPS : EPS + 6, NU : NU + 3, BIAS : BIAS + 6]


def checked(first: InitialState) -> InitialState:
    """The state itself, if it is valid.

    Raises:
        EstimationError: a wrong shape, a value that is not finite, no rotation, or a standard deviation of
            zero.
    """
    shapes = {
        "T_w_b": (4, 4),
        "velocity_w": (3,),
        "bias_gyroscope": (3,),
        "bias_accelerometer": (3,),
        "sigma": (15,),
    }
    for name, shape in shapes.items():
        value = np.asarray(getattr(first, name), dtype=np.float64)
        if value.shape != shape or not np.isfinite(value).all():
            raise EstimationError(
                f"{name} of the initial state has shape {value.shape} or values that are not finite; "
                f"expected finite values of shape {shape}"
            )
    C = first.T_w_b[:3, :3]
    off = float(np.abs(C.T @ C - np.eye(3)).max())
    if off > _ROTATION_TOLERANCE or np.linalg.det(C) < 0.0:
        raise EstimationError(
            f"T_w_b of the initial state is not a pose: its rotation deviates from orthonormality by "
            f"{off:.2g}; expected a rotation matrix that maps body to world coordinates"
        )
    if not first.sigma.min() > 0.0:
        raise EstimationError(
            f"the smallest standard deviation of the initial state is {first.sigma.min():g}; expected "
            "positive values, for instance 1e-4 for a quantity that is almost certain"
        )
    return first


def initialize_from_state(
    buffer: MeasurementBuffer, settings: Settings, first: InitialState
) -> FirstWindow | str:
    """A window of two knots, from the state to the end of the newest packet, or the reason why not yet.

    Raises:
        EstimationError: the inertial samples begin after the state, or the window cannot be solved.
    """
    wait = "waiting for measurements after the initial state"
    if buffer.end_ns is None or buffer.end_ns < first.t_ns + settings.knot_interval_ns // 2:
        return wait
    streams = buffer.gyroscope, buffer.accelerometer
    if any(len(samples) == 0 for samples in streams):
        return wait
    begin_ns = max(int(samples["t_ns"][0]) for samples in streams)
    if begin_ns > first.t_ns:
        raise EstimationError(
            f"the initial state is {(begin_ns - first.t_ns) / NS_PER_S:.3f} s older than the inertial "
            "samples; expected a state at a time that the samples of both sensors cover"
        )
    try:
        states = _first_knot(first, buffer, settings)
        knots_ns = np.array([first.t_ns, buffer.end_ns])
        end = predict_knot(states, first.t_ns, buffer.end_ns, streams, settings.window.gravity_w)
        both = States(*(np.concatenate(pair) for pair in zip(states, end, strict=True)))
        prior = _prior(states, first.sigma)
        window = filled_window(buffer, settings, knots_ns, both, prior=prior)
        return FirstWindow(window, window.optimize(settings.initialization.optimizer))
    except InertialError as error:
        raise EstimationError(f"cannot initialize from the initial state: {error}") from error


def _first_knot(first: InitialState, buffer: MeasurementBuffer, settings: Settings) -> States:
    """The state as a knot; velocities and accelerations from the samples around it."""
    bias = np.concatenate([first.bias_gyroscope, first.bias_accelerometer])
    C = np.asarray(first.T_w_b[:3, :3], dtype=np.float64)
    varpi = rates_at(
        first.t_ns,
        C,
        np.asarray(first.velocity_w, dtype=np.float64),
        (buffer.gyroscope, buffer.accelerometer),
        bias,
        settings.window.gravity_w,
        settings.knot_interval_ns // 2,
    )
    return States(C[None].copy(), np.array(first.T_w_b[:3, 3])[None], varpi[None], bias[None])


def _prior(first: States, sigma: FloatArray) -> Prior:
    """Prior on the first knot with the standard deviations (15,) of pose, velocity and biases."""
    R = np.zeros((len(_KNOWN), DOF))
    R[np.arange(len(_KNOWN)), _KNOWN] = 1.0 / sigma
    return Prior(R, R.T @ R, np.zeros(len(_KNOWN)), first)
