"""Start from a state known beforehand: no waiting for parallax, and the world is that of the state."""

from __future__ import annotations

import numpy as np

from asyneio.errors import EstimationError, InertialError
from asyneio.estimation.problem.problem import Prior, States
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.first_window import Start, filled_window
from asyneio.odometry.propagation import predict_knot, rates_at
from asyneio.odometry.settings import Settings
from asyneio.state import BIAS, DOF, EPS, NU
from asyneio.types import NS_PER_S, FloatArray, InitialState

#: How far a rotation matrix may be from orthonormal: what single precision leaves.
_ROTATION_TOLERANCE = 1e-5
#: Columns of a knot's error state that a first state tells of: pose, velocity, biases.
_KNOWN = np.r_[EPS : EPS + 6, NU : NU + 3, BIAS : BIAS + 6]


def checked(first: InitialState) -> InitialState:
    """The same state.

    Raises:
        EstimationError: it is not one: wrong shapes, not finite, no rotation, or without uncertainty.
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
                f"{name} of the known first state has shape {value.shape} or values that are not finite; "
                f"expected finite values of shape {shape}"
            )
    C = first.T_w_b[:3, :3]
    off = float(np.abs(C.T @ C - np.eye(3)).max())
    if off > _ROTATION_TOLERANCE or np.linalg.det(C) < 0.0:
        raise EstimationError(
            f"T_w_b of the known first state is no pose: its rotation misses orthonormality by {off:.2g}; "
            "expected a rotation matrix that takes body to world coordinates"
        )
    if not first.sigma.min() > 0.0:
        raise EstimationError(
            f"the smallest standard deviation of the known first state is {first.sigma.min():g}; expected "
            "positive values: 1e-4 for what is as good as certain"
        )
    return first


def known_start(intake: MeasurementBuffer, settings: Settings, first: InitialState) -> Start | str:
    """A window of two knots, from the state to the end of what the intake holds, or, in words, why not yet.

    Raises:
        EstimationError: the inertial samples begin after the state, or the window cannot be solved.
    """
    wait = "waiting for measurements after the known first state"
    if intake.end_ns is None or intake.end_ns < first.t_ns + settings.knot_interval_ns // 2:
        return wait
    streams = intake.gyroscope, intake.accelerometer
    if any(len(samples) == 0 for samples in streams):
        return wait
    begin_ns = max(int(samples["t_ns"][0]) for samples in streams)
    if begin_ns > first.t_ns:
        raise EstimationError(
            f"the known first state is {(begin_ns - first.t_ns) / NS_PER_S:.3f} s older than the inertial "
            "samples; expected a state at a time from which on both sensors are heard"
        )
    try:
        states = _first_knot(first, intake, settings)
        knots_ns = np.array([first.t_ns, intake.end_ns])
        end = predict_knot(states, first.t_ns, intake.end_ns, streams, settings.window.gravity_w)
        both = states.joined(end)
        prior = _prior(states, first.sigma)
        window = filled_window(intake, settings, knots_ns, both, prior=prior)
        return Start(window, window.optimize(settings.start.optimizer))
    except InertialError as error:
        raise EstimationError(f"no start from the known first state: {error}") from error


def _first_knot(first: InitialState, intake: MeasurementBuffer, settings: Settings) -> States:
    """The state as a knot, its rates from the samples around it."""
    bias = np.concatenate([first.bias_gyroscope, first.bias_accelerometer])
    C = np.asarray(first.T_w_b[:3, :3], dtype=np.float64)
    varpi = rates_at(
        first.t_ns,
        C,
        np.asarray(first.velocity_w, dtype=np.float64),
        (intake.gyroscope, intake.accelerometer),
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
