# SPDX-License-Identifier: Apache-2.0
"""Checks of an initialization, before and after the joint optimisation; each gives the reason of a
rejection."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.solver.covariance import relative_scale_sigma
from asyneio.estimation.solver.optimizer import Solution
from asyneio.odometry.initializer.span_motion import SpanMotion
from asyneio.odometry.settings import Settings

#: Share of the points in front of the camera: all but noisy ones in a correct solution, any in a degenerate
#: one.
_SHARE_IN_FRONT = 0.8
#: An inverse depth of at least this many standard deviations shows parallax.
_SIGNIFICANT = 4.0
#: Least share of the tracks that agree with the motion; the others may be poor, or lie on moving objects.
_SHARE_AGREEING = 0.6
#: Largest bias in standard deviations of its prior: with the default priors 0.4 rad/s and 0.6 m/s^2, which
#: data sheets allow after power-on.
_MAX_BIAS = 4.0
#: Largest difference between the scales of dead reckoning and joint optimisation, in standard deviations. The
#: latter weights the inertial samples less (`noise_inflation`), and its scale may be less certain by that
#: factor.
_SCALES_DIFFER = 3.0
#: Largest relative decrease of the cost by the last step of a converged solution: unobservable scale drifts.
_NOT_CONVERGED = 0.002
#: Largest typical deviation of the observations, in standard deviations.
_MAX_DEVIATION = 2.5


def motion_rejection(motion: SpanMotion, settings: Settings) -> str:
    """Why the motion of a span does not qualify for the joint optimisation; empty if it does."""
    adjusted = motion.adjusted
    significant = adjusted.inverse_depth > _SIGNIFICANT * adjusted.inverse_depth_sigma
    if np.count_nonzero(significant) < settings.initialization.min_landmarks:
        return "the tracks show no parallax: move the sensor sideways"
    reason = outlier_rejection(int(np.count_nonzero(~adjusted.agreeing)), len(adjusted.agreeing))
    if reason:
        return reason
    excess = np.abs(adjusted.motion.bias) / settings.initialization.bias_sigma
    if excess.max() > _MAX_BIAS:
        return (
            f"the tracks require an inertial bias of {excess.max():.1f} standard deviations: "
            "the sensor only rotates and there is no parallax, or the calibration is wrong; move it sideways"
        )
    if motion.ambiguous:
        return (
            "two different motions explain the tracks equally well: "
            "move the sensor sideways, with changing speed"
        )
    if not motion.relative_sigma < settings.initialization.max_scale_sigma:
        return _scale_unknown(motion.relative_sigma, settings.initialization.max_scale_sigma)
    return ""


def outlier_rejection(outliers: int, tracks: int) -> str:
    """Why a motion with this number of outliers among the tracks is rejected; empty if it is accepted."""
    if outliers <= (1.0 - _SHARE_AGREEING) * tracks:
        return ""
    return (
        f"{100 * outliers / tracks:.0f} % of the tracks contradict the inertial samples: "
        "wrong calibration, poor tracks or a moving scene"
    )


def _scale_unknown(sigma: float, needed: float) -> str:
    return (
        f"the standard deviation of scale is {100 * min(sigma, 9.99):.0f} %, "
        f"at most {100 * needed:.0f} % is required: "
        "move the sensor sideways, with changing speed"
    )


def solution_rejection(solution: Solution, settings: Settings) -> str:
    """Why the joint optimisation is rejected, whatever its initial guess; empty if it is accepted."""
    if np.mean(solution.problem.landmarks.rho < 0.0) > 1.0 - _SHARE_IN_FRONT:
        return "the tracks show no parallax: move the sensor sideways"
    if solution.report.last_decrease > _NOT_CONVERGED:
        return "the joint optimisation does not converge: move the sensor sideways, with changing speed"
    scale_sigma, needed = (
        relative_scale_sigma(solution),
        _SCALES_DIFFER * settings.initialization.max_scale_sigma,
    )
    if not scale_sigma < needed:
        return _scale_unknown(scale_sigma, needed)
    used = len(solution.problem.visual.landmark)
    if solution.report.rejected > 0.2 * used:
        return f"{solution.report.rejected} of {used} observations contradict the estimated motion"
    square = settings.window.robust_scale**2
    # Squared residual of one axis whose Cauchy cost is the mean cost of an observation.
    typical = 0.5 * square * np.expm1(2.0 * solution.report.visual_cost / (max(used, 1) * square))
    if typical > _MAX_DEVIATION**2:
        return (
            f"observations deviate by {np.sqrt(typical):.1f} standard deviations: "
            "wrong calibration or poor tracks"
        )
    return ""


def joint_rejection(solution: Solution, motion: SpanMotion, settings: Settings) -> str:
    """Why a joint optimisation with the initial guess `motion` is rejected; empty if it is accepted."""
    reason = solution_rejection(solution, settings)
    if reason:
        return reason
    states = solution.problem.states
    displacement = (states.r - states.r[0]) @ states.C[0]
    factor = np.sum(displacement * motion.displacement) / np.sum(motion.displacement**2)
    if abs(factor - 1.0) > _SCALES_DIFFER * settings.initialization.max_scale_sigma:
        return f"two estimates of the motion differ by {100 * abs(factor - 1.0):.0f} % in scale"
    return ""
