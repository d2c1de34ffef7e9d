# SPDX-License-Identifier: Apache-2.0
"""Columns of a knot's error state and of an interval's local coordinates, in one place.

Every covariance, Jacobian and normal equation uses these columns: a block of three (or six) begins at the
named column, so `covariance[NU : NU + 3, NU : NU + 3]` belongs to the velocity. docs/conventions.md has the
meaning, frame and unit of each block.
"""

from __future__ import annotations

#: Error state of a knot, right perturbation, body frame: rotation [rad] and translation [m] of the pose,
#: angular velocity [rad/s], velocity [m/s] and their rates, biases of gyroscope and accelerometer.
PHI, RHO, OMEGA, NU, OMEGA_DOT, NU_DOT, B_G, B_A = range(0, 24, 3)
DOF = 24

#: The same columns in blocks of six: pose, generalised velocity and acceleration, biases.
EPS, VARPI, VARPI_DOT, BIAS = PHI, OMEGA, OMEGA_DOT, B_G
#: Coordinates of a knot without its biases: eps, varpi, varpi_dot.
KINEMATIC_DOF = BIAS

#: Local coordinates of the interval between knots k and k + 1, blocks of six:
#: [eps_k, xi_dot(t_k), xi_ddot(t_k), xi, xi_dot, xi_ddot, b_k, b_{k+1}].
EPS_0, XI_DOT_0, XI_DDOT_0, XI, XI_DOT, XI_DDOT, BIAS_0, BIAS_1 = range(0, 48, 6)
#: As many as two knots have.
LOCAL_DOF = 2 * DOF
#: Local coordinates without the biases.
KINEMATIC_LOCAL_DOF = BIAS_0
