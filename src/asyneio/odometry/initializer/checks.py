"""What keeps a start from being trusted, in words: before the joint optimisation, and after it."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.solver.covariance import relative_scale_sigma
from asyneio.estimation.solver.optimizer import Solution
from asyneio.odometry.initializer.span_motion import SpanMotion
from asyneio.odometry.settings import Settings

#: Points of a true solution lie in front of the camera, but for noise; of a degenerate one, anywhere.
_SHARE_IN_FRONT = 0.8
#: Standard deviations from zero at which an inverse depth shows parallax.
_SIGNIFICANT = 4.0
#: Tracks that must agree with the motion found: the others may be bad, or see what moves by itself.
_SHARE_AGREEING = 0.6
#: Standard deviations of its prior within which a bias must lie: with the default priors 0.4 rad/s and 0.6
#: m/s^2, as data sheets allow after power-on.
_MAX_BIAS = 4.0
#: Standard deviations by which the scales of dead reckoning and of the joint optimisation may differ. The
#: latter counts the inertial samples for less (`noise_inflation`), and may know scale worse by the same
#: factor.
_SCALES_DIFFER = 3.0
#: A last step that still lowers the cost by so much has not arrived: scale drifts where nothing fixes it.
_UNSETTLED = 0.002
#: Standard deviations by which observations may typically be off.
_MAX_MISFIT = 2.5


def motion_rejection(motion: SpanMotion, settings: Settings) -> str:
    """Why a joint optimisation is not worth its time; empty if it is."""
    adjusted = motion.adjusted
    significant = adjusted.inverse_depth > _SIGNIFICANT * adjusted.inverse_depth_sigma
    if np.count_nonzero(significant) < settings.initialization.min_landmarks:
        return "the tracks show no parallax: move the sensor sideways"
    if np.mean(adjusted.agreeing) < _SHARE_AGREEING:
        return (
            f"{100 * np.mean(~adjusted.agreeing):.0f} % of the tracks contradict the inertial samples: "
            "wrong calibration, bad tracks or a scene that moves"
        )
    excess = np.abs(adjusted.motion.bias) / settings.initialization.bias_sigma
    if excess.max() > _MAX_BIAS:
        return (
            f"the tracks ask for a bias of the inertial sensors of {excess.max():.1f} standard deviations: "
            "the sensor only turns and shows no parallax, or the calibration is wrong; move it sideways"
        )
    if motion.ambiguous:
        return "two different motions explain the tracks alike: move the sensor sideways, with changing speed"
    if not motion.relative_sigma < settings.initialization.max_scale_sigma:
        return _scale_unknown(motion.relative_sigma, settings.initialization.max_scale_sigma)
    return ""


def _scale_unknown(sigma: float, needed: float) -> str:
    return (
        f"scale is known to {100 * min(sigma, 9.99):.0f} % only, "
        f"{100 * needed:.0f} % is needed: "
        "move the sensor sideways, with changing speed"
    )


def solution_rejection(solution: Solution, settings: Settings) -> str:
    """Why the joint optimisation cannot be trusted, whatever it began with; empty if it can."""
    if np.mean(solution.problem.landmarks.rho < 0.0) > 1.0 - _SHARE_IN_FRONT:
        return "the tracks show no parallax: move the sensor sideways"
    if solution.report.last_decrease > _UNSETTLED:
        return "the joint optimisation does not settle: move the sensor sideways, with changing speed"
    scale_sigma, needed = (
        relative_scale_sigma(solution),
        _SCALES_DIFFER * settings.initialization.max_scale_sigma,
    )
    if not scale_sigma < needed:
        return _scale_unknown(scale_sigma, needed)
    used = len(solution.problem.visual.landmark)
    if solution.report.rejected > 0.2 * used:
        return f"{solution.report.rejected} of {used} observations contradict the motion found"
    square = settings.window.robust_scale**2
    # The squared norm whose Cauchy cost is the mean cost, for one of its two axes.
    typical = 0.5 * square * np.expm1(2.0 * solution.report.visual_cost / (max(used, 1) * square))
    if typical > _MAX_MISFIT**2:
        return (
            f"observations are off by {np.sqrt(typical):.1f} standard deviations: "
            "wrong calibration or bad tracks"
        )
    return ""


def joint_rejection(solution: Solution, motion: SpanMotion, settings: Settings) -> str:
    """Why a joint optimisation that began with `motion` cannot be trusted; empty if it can."""
    reason = solution_rejection(solution, settings)
    if reason:
        return reason
    states = solution.problem.states
    displacement = (states.r - states.r[0]) @ states.C[0]
    factor = np.sum(displacement * motion.displacement) / np.sum(motion.displacement**2)
    if abs(factor - 1.0) > _SCALES_DIFFER * settings.initialization.max_scale_sigma:
        return f"two ways of solving for the motion differ by {100 * abs(factor - 1.0):.0f} % in scale"
    return ""
