# SPDX-License-Identifier: Apache-2.0
"""Continuous-time model of a trajectory: its motion prior and the space in which it is interpolated.

| prior | white noise on              | state of a knot              | mean between two knots  |
|-------|-----------------------------|------------------------------|-------------------------|
| WNOJ  | jerk `xi_dddot` (13)        | pose, varpi, varpi_dot       | quintic Hermite         |
| WNOA  | acceleration `xi_ddot`      | pose, varpi                  | cubic Hermite           |

| space        | local variable xi = [phi, rho] of a pose T around T_k                                     |
|--------------|-------------------------------------------------------------------------------------------|
| SE(3)        | Log(T_k^{-1} T): rotation and position are coupled (7)                                     |
| SO(3) x R^3  | [Log(C_k^T C), C_k^T (r - r_k)]: the position is independent, in the frame of T_k          |

A knot is [T, varpi, varpi_dot] in the body for all four combinations; WNOA does not use varpi_dot.
Kernels take prior and space as integers.
"""

from __future__ import annotations

from typing import NamedTuple

from asyneio.errors import TrajectoryError

#: Motion priors.
WNOJ, WNOA = 0, 1
#: Spaces.
SE3, SO3_X_R3 = 0, 1

_PRIORS = {"wnoj": WNOJ, "wnoa": WNOA}
_SPACES = {"se3": SE3, "so3xr3": SO3_X_R3}


class MotionModel(NamedTuple):
    """A motion prior (`WNOJ`, `WNOA`) in a space (`SE3`, `SO3_X_R3`)."""

    prior: int
    space: int


#: The paper's model.
WNOJ_SE3 = MotionModel(WNOJ, SE3)


def motion_model_named(prior: str, space: str) -> MotionModel:
    """The model of the names used in configurations: `wnoj`, `wnoa`; `se3`, `so3xr3`.

    Raises:
        TrajectoryError: there is no such prior or space.
    """
    if prior not in _PRIORS or space not in _SPACES:
        raise TrajectoryError(
            f"there is no motion prior {prior!r} in the space {space!r}; "
            f"expected one of {', '.join(_PRIORS)} in one of {', '.join(_SPACES)}"
        )
    return MotionModel(_PRIORS[prior], _SPACES[space])
