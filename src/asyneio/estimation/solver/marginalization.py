# SPDX-License-Identifier: Apache-2.0
"""Marginalisation of the oldest knot and the landmarks anchored in it, into a square-root prior.

Input: the old prior, the factors of the first interval, and every observation of every landmark whose anchor
is the oldest knot, at whatever time it was made. No observation is discarded: a track that outlives its
anchor starts a new landmark.

The result is linearised at the current states and stays a linear function of the distance from there: the
prior is *shifted*, not relinearised (docs/derivations/shifted-prior.md). Whether the poses in it keep this
linearisation point in all other factors too (first-estimates Jacobians) is an option of the window. With
poses perturbed on the right and velocities in the body, the four unobservable directions (position and yaw)
depend on the poses alone, so that only these would have to be frozen. Tracks reach from the oldest knot to
the newest, so that the prior contains poses a few hundredths of a second old: freezing them does more harm
than good (docs/deviations.md has the figures), and the default is not to freeze them.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.lapack import dpstrf

from asyneio.errors import EstimationError
from asyneio.estimation.linearization.linear_system import linearize
from asyneio.estimation.linearization.prior import add_prior, difference
from asyneio.estimation.problem.active import active_in_window, active_part, with_inactive_zero
from asyneio.estimation.problem.camera_calibration import after_walk
from asyneio.estimation.problem.problem import (
    Inertial,
    Landmarks,
    Preintegrated,
    Prior,
    Problem,
    Visual,
)
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.types import BoolArray, FloatArray, IntArray

#: A pivot below this, relative to the diagonal, is rounding error and not information.
_RELATIVE_PIVOT = 1e-13


def marginalize_oldest(
    problem: Problem,
    prior: Prior,
    walk: FloatArray | None = None,
    added: tuple[FloatArray, FloatArray] | None = None,
) -> Prior:
    """The prior on knots 1..m, and on the estimated coordinates of camera and IMU, that replaces knot 0, its
    landmarks and their factors.

    `walk` (c+s,): variance that the coordinates of camera [s^2, rad^2] and IMU gain over the interval.
    `added`, before the walk: information (c+s,) of each of them and gradient (c+s,) at their present values.

    Raises:
        EstimationError: the oldest knot is not constrained.
    """
    part = _factors_of_oldest(problem, prior)
    knots = len(part.states.r)
    system = linearize(part)
    add_prior(system, prior, difference(problem.states, prior, problem.camera, problem.imu))
    eliminate_landmarks(system, part.landmarks, part.model)
    active, camera, imu = part.model.active, len(part.camera.columns), len(part.imu.columns)
    n = len(active)
    H, b = active_part(system.H, active), system.b[active_in_window(active, knots, camera + imu)]
    try:
        factor = cho_factor(H[:n, :n], lower=True, check_finite=False)
    except np.linalg.LinAlgError as error:
        raise EstimationError(
            "the oldest knot is not constrained by its factors; expected a prior on the first knot"
        ) from error
    gain = cho_solve(factor, H[:n, n:], check_finite=False)
    information = H[n:, n:] - H[n:, :n] @ gain
    gradient = b[n:] - gain.T @ b[:n]
    if added is not None:
        behind = np.arange(len(gradient) - camera - imu, len(gradient))
        information[behind, behind] += added[0]
        gradient[behind] += added[1]
    if walk is not None:
        information, gradient = after_walk(information, gradient, walk)
    linearization = problem.linearization.chosen(slice(1, knots)).copied()
    square = 0.5 * (information + information.T)
    root, y = _square_root(square, gradient)
    R = with_inactive_zero(root, active, camera + imu)
    rows = with_inactive_zero(square, active, camera + imu)
    # Gradient R^T (R delta + r_0) at the current delta, which is zero for knots that are frozen only now.
    shifted = Prior(
        R,
        # R^T R, up to the rounding error that R leaves out.
        with_inactive_zero(rows.T, active, camera + imu),
        np.zeros(len(R)),
        linearization,
        problem.camera if camera else None,
        problem.imu if imu else None,
    )
    remaining = problem.states.chosen(slice(1, None))
    delta = difference(remaining, shifted, problem.camera, problem.imu)
    return shifted._replace(r_0=y - R @ delta)


def _square_root(information: FloatArray, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`R` with `R^T R = information` by Cholesky with pivoting, and `y` with `R^T y = gradient`.

    Rows end where only rounding error remains, so that a direction without information gains none.
    """
    scale = np.sqrt(np.maximum(information.diagonal(), 0.0))
    scale[scale == 0.0] = 1.0
    scaled = information / np.outer(scale, scale)
    factor, pivots, rank, _ = dpstrf(scaled, lower=0, tol=_RELATIVE_PIVOT)
    order = pivots - 1
    upper = np.triu(factor)[:rank]
    R = np.empty_like(upper)
    R[:, order] = upper
    y = solve_triangular(upper[:, :rank], (gradient / scale)[order[:rank]], trans="T", check_finite=False)
    return R * scale, y


def _factors_of_oldest(problem: Problem, prior: Prior) -> Problem:
    """The sub-problem of interval 0 and of the landmarks anchored in knot 0, on the knots in it."""
    keep = problem.landmarks.anchor == 0
    visual, chosen = _of_landmarks(problem.visual, keep)
    observed = np.flatnonzero(np.diff(visual.start))
    knots = max(int(observed[-1]) + 2 if len(observed) else 2, prior.knots)
    motion = np.zeros(knots - 1, dtype=np.bool_)
    motion[0] = problem.motion[0]
    return problem._replace(
        states=problem.states.chosen(slice(knots)),
        linearization=problem.linearization.chosen(slice(knots)),
        frozen=min(problem.frozen, knots),
        motion=motion,
        gyroscope=_first_interval(problem.gyroscope, knots),
        accelerometer=_first_interval(problem.accelerometer, knots),
        visual=visual._replace(start=visual.start[:knots]),
        landmarks=Landmarks(*(np.ascontiguousarray(a[keep]) for a in problem.landmarks)),
        # Observations of the other intervals are still propagated with the biases of their increments.
        preintegrated=_only_first(problem.preintegrated, knots),
        propagated=problem.propagated.chosen(chosen),
        zero_velocity=problem.zero_velocity.only_first(knots - 1),
    )


def _only_first(preintegrated: Preintegrated, knots: int) -> Preintegrated:
    """Preintegrated samples of interval 0 alone, for `knots` knots."""
    part = preintegrated.first(knots - 1)
    return part._replace(present=part.present & (np.arange(len(part.present)) == 0))


def _first_interval(samples: Inertial, knots: int) -> Inertial:
    """Samples of interval 0 alone, for `knots` knots."""
    start = np.full(knots, samples.start[1])
    start[0] = samples.start[0]
    return samples._replace(start=start)


def _of_landmarks(visual: Visual, keep: BoolArray) -> tuple[Visual, BoolArray]:
    """Observations of the landmarks in `keep`, renumbered, and their mask."""
    chosen = keep[visual.landmark]
    interval = np.repeat(np.arange(len(visual.start) - 1), np.diff(visual.start))[chosen]
    number: IntArray = np.cumsum(keep) - 1
    kept = Visual(
        start=np.searchsorted(interval, np.arange(len(visual.start))),
        tau=visual.tau[chosen],
        weights=visual.weights[chosen],
        landmark=number[visual.landmark[chosen]],
        xy=visual.xy[chosen],
        root_information=visual.root_information[chosen],
    )
    return kept, chosen
