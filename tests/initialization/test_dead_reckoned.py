"""The dead-reckoned adjustment: its derivatives, and the motion it finds despite biases and bad tracks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.inertial.increments import ImuWindow, SampleNoise
from asyneio.initialization.dead_reckoned import Adjusted, BiasPrior, FirstMotion, adjust
from asyneio.initialization.dead_reckoned_kernels import (
    SHARED,
    NormalEquations,
    Rays,
    Unknowns,
    add_normal_equations,
)
from asyneio.initialization.dead_reckoned_rays import DeadReckoning, SpanObservations
from asyneio.odometry.initializer.span_motion import explains_as_well
from asyneio.simulation import AnalyticMotion, MotionStyle
from asyneio.simulation.imu import specific_force_b
from tests.initialization.ideal import GRAVITY, GRAVITY_W, T_B_C, sinusoidal, styled

Array = NDArray[np.float64]

SPAN_S = 2.0
TRACKS = 60
#: Half a pixel of a lens with f = 200 px.
SIGMA = 2.5e-3
BIAS = np.array([0.02, -0.015, 0.01, 0.06, -0.05, 0.08])
PRIOR = BiasPrior(np.repeat([0.02, 0.1], 3), 3.0, 1e-6)


def span(
    motion: AnalyticMotion,
    sigma: float,
    bad: float = 0.0,
    seed: int = 0,
    T_b_c: Array = T_B_C,
    late_s: float = 0.0,
) -> DeadReckoning:
    """Two seconds of `motion`: biased samples without noise, tracks of 12 observations in 0.4 s.

    A share `bad` of the tracks drifts by itself; all are stamped `late_s` too late.
    """
    rng = np.random.default_rng(seed)
    birth = rng.uniform(0.0, SPAN_S - 0.4, TRACKS)
    t = (birth[:, None] + np.sort(rng.uniform(0.0, 0.4, (TRACKS, 12)), axis=1)).ravel()
    track = np.repeat(np.arange(TRACKS), 12)
    T_w_c = motion.T_w_b(t) @ T_b_c
    ahead = np.column_stack([rng.uniform(-0.5, 0.5, (TRACKS, 2)), np.ones(TRACKS)])
    ahead *= rng.uniform(1.5, 6.0, (TRACKS, 1))
    middle = T_w_c[12 * track + 6]
    point = np.einsum("nij,nj->ni", middle[:, :3, :3], ahead[track]) + middle[:, :3, 3]
    seen = np.einsum("nji,nj->ni", T_w_c[:, :3, :3], point - T_w_c[:, :3, 3])
    drift = (np.arange(TRACKS) < bad * TRACKS)[:, None] * rng.normal(scale=0.3, size=(TRACKS, 2))
    xy = seen[:, :2] / seen[:, 2:] + sigma * rng.normal(size=(len(t), 2))
    xy += drift[track] * (t - birth[track])[:, None]
    samples = np.arange(-0.01, SPAN_S + 0.02, 0.001)
    gyroscope = motion.angular_velocity_b(samples) + BIAS[:3]
    accelerometer = specific_force_b(motion, samples, GRAVITY) + BIAS[3:]
    window = ImuWindow(samples, gyroscope, samples, accelerometer, SPAN_S)
    whiten = np.tile(np.eye(2) / SIGMA, (len(t), 1, 1))
    return DeadReckoning(
        window, SampleNoise(0.01, 0.05), T_b_c, SpanObservations(t + late_s, track, xy, whiten)
    )


def truth(motion: AnalyticMotion) -> FirstMotion:
    C = motion.T_w_b(0.0)[0, :3, :3]
    return FirstMotion(C.T @ motion.velocity_w(0.0)[0], C.T @ GRAVITY_W, BIAS)


def cost_and_sums(
    rays: Rays, unknowns: Array, tangent: Array, points: Array
) -> tuple[float, Array, Array, Array]:
    """Cost, gradients (12,), (L,3) and Hessian (12,12) at `unknowns` = velocity, gravity, biases and time
    offset (13,)."""
    count = len(points)
    H, b = np.zeros((SHARED, SHARED)), np.zeros(SHARED)
    W, H_l, b_l = np.zeros((count, 3, SHARED)), np.zeros((count, 3, 3)), np.zeros((count, 3))
    cost = np.zeros(count)
    at = Unknowns(unknowns[:3], unknowns[3:6], tangent, unknowns[6:], points)
    add_normal_equations(rays, at, 2.0, 50.0, NormalEquations(H, b, W, H_l, b_l, cost))
    return float(cost.sum()), b, b_l, H


def test_the_gradient_is_the_derivative_of_the_cost() -> None:
    """At a state where nothing vanishes: differences of the cost along every unknown."""
    motion = styled(MotionStyle.AGGRESSIVE, 1)
    rays = span(motion, SIGMA).rays(np.zeros(6))
    rng = np.random.default_rng(5)
    # Small corrections of the bias: they are taken to first order, and so are their derivatives.
    found = truth(motion)
    unknowns = np.concatenate([found.velocity + 0.1, found.gravity, 1e-7 * rng.normal(size=7)])
    tangent = np.linalg.svd(found.gravity[None])[2][1:].T.copy()
    points = np.column_stack([rays.xy[rays.reference], rng.uniform(0.1, 0.8, TRACKS)])
    _, b, b_l, _ = cost_and_sums(rays, unknowns, tangent, points)
    directions = np.zeros((SHARED, 13))
    directions[:3, :3], directions[3:5, 3:6], directions[5:, 6:] = np.eye(3), tangent.T, np.eye(7)
    step = 1e-6
    for k, along in enumerate(directions):
        costs = [cost_and_sums(rays, unknowns + s * step * along, tangent, points)[0] for s in (1.0, -1.0)]
        assert (costs[0] - costs[1]) / (2.0 * step) == pytest.approx(
            b[k], rel=1e-5, abs=1e-4 * np.abs(b).max()
        )
    for j, a in ((0, 0), (7, 1), (30, 2)):
        shift = np.zeros_like(points)
        shift[j, a] = step
        costs = [cost_and_sums(rays, unknowns, tangent, points + s * shift)[0] for s in (1.0, -1.0)]
        assert (costs[0] - costs[1]) / (2.0 * step) == pytest.approx(b_l[j, a], rel=1e-5, abs=1e-4)


def test_rays_follow_the_biases_to_first_order() -> None:
    reckoning = span(styled(MotionStyle.AGGRESSIVE, 2), 0.0)
    at = reckoning.rays(BIAS)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        plus, minus = reckoning.rays(BIAS + step), reckoning.rays(BIAS - step)
        slope = (plus.centre - minus.centre) / 2e-5
        assert np.abs(slope - at.d_centre[:, :, k]).max() < 1e-6 * max(np.abs(slope).max(), 1.0)
        if k < 3:
            # C_c_b0 Exp(-theta): the skew part of the change is the angle.
            change = (minus.C_c_b0 - plus.C_c_b0) / 2e-5 @ at.C_c_b0.transpose(0, 2, 1)
            angle = np.stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]], axis=1)
            assert np.abs(angle - at.d_angle[:, :, k]).max() < 1e-6


def test_rays_follow_the_clock_to_first_order() -> None:
    """The same tracks stamped a millisecond later and earlier, against the derivative."""
    motion = styled(MotionStyle.AGGRESSIVE, 2)
    at, step = span(motion, 0.0).rays(BIAS), 1e-3
    later, earlier = (span(motion, 0.0, late_s=s * step).rays(BIAS) for s in (1.0, -1.0))
    slope = (later.centre - earlier.centre) / (2.0 * step)
    assert np.abs(slope - at.d_centre[:, :, 6]).max() < 1e-3 * np.abs(slope).max()
    change = (earlier.C_c_b0 - later.C_c_b0) / (2.0 * step) @ at.C_c_b0.transpose(0, 2, 1)
    angle = np.stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]], axis=1)
    assert np.abs(angle - at.d_angle[:, :, 3]).max() < 1e-3 * np.abs(angle).max()


@pytest.mark.parametrize("late_s", [-0.005, 0.004])
def test_a_wrong_clock_is_found(late_s: float) -> None:
    motion = styled(MotionStyle.AGGRESSIVE, 1)
    right = truth(motion)
    reckoning = span(motion, SIGMA, late_s=late_s)
    prior = replace(PRIOR, time_offset_sigma=0.005)
    first = FirstMotion(0.5 * right.velocity, right.gravity, np.zeros(6))
    rays = reckoning.rays(np.zeros(6))
    found = adjust(reckoning.rays, rays, first, prior, gate=8.0)
    assert found.motion.time_offset == pytest.approx(-late_s, abs=5e-4)
    assert np.sqrt(found.covariance[11, 11]) < 5e-4
    ignored = adjust(reckoning.rays, rays, first, PRIOR, gate=8.0)
    assert abs(ignored.motion.time_offset) < 1e-5
    miss, without = (np.linalg.norm(one.motion.velocity - right.velocity) for one in (found, ignored))
    assert miss < 0.5 * without


def adjusted(motion: AnalyticMotion, sigma: float, bad: float = 0.0, seed: int = 0) -> Adjusted:
    """From a velocity that is wrong by half its size and gravity as an accelerometer would guess it."""
    reckoning = span(motion, sigma, bad, seed)
    right = truth(motion)
    guess = right.gravity + np.array([0.5, -0.5, 0.3])
    guess *= GRAVITY / np.linalg.norm(guess)
    first = FirstMotion(0.5 * right.velocity, guess, np.zeros(6))
    return adjust(reckoning.rays, reckoning.rays(np.zeros(6)), first, PRIOR, gate=8.0)


@pytest.mark.parametrize("style", [MotionStyle.MODERATE, MotionStyle.AGGRESSIVE])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_motion_and_gyroscope_bias_are_found_from_a_wrong_guess(style: str, seed: int) -> None:
    motion = styled(style, seed)
    right = truth(motion)
    found = adjusted(motion, sigma=0.02 * SIGMA)
    miss = np.linalg.norm(found.motion.velocity - right.velocity)
    assert miss < 0.05 * np.linalg.norm(right.velocity)
    assert np.abs(found.motion.bias[:3] - BIAS[:3]).max() < 1e-3
    cosine = found.motion.gravity @ right.gravity / GRAVITY**2
    # A bias of the accelerometer passes for tilt, as far as it is of gravity, until turning tells them apart.
    assert np.arccos(min(cosine, 1.0)) < np.linalg.norm(BIAS[3:]) / GRAVITY


@pytest.mark.slow
def test_the_error_is_as_large_as_the_covariance_says() -> None:
    """Velocity, tilt and gyroscope bias over 12 draws of noise: normalised square 8 on average."""
    motion = styled(MotionStyle.AGGRESSIVE, 3)
    right = truth(motion)
    squares = []
    for seed in range(12):
        found = adjusted(motion, sigma=SIGMA, seed=seed)
        size = np.linalg.norm(found.motion.gravity)
        tilt = found.tangent.T @ (right.gravity - found.motion.gravity) / size**2
        bias = BIAS[:3] - found.motion.bias[:3]
        error = np.concatenate([right.velocity - found.motion.velocity, tilt, bias])
        squares.append(error @ np.linalg.solve(found.covariance[:8, :8], error))
    # The Cauchy cost gives away some of the information, and its curvature claims somewhat less.
    assert 2.0 < np.mean(squares) < 14.0


def test_bad_tracks_are_told_from_good_ones() -> None:
    motion = styled(MotionStyle.AGGRESSIVE, 1)
    found = adjusted(motion, sigma=SIGMA, bad=0.3)
    bad = np.arange(TRACKS) < 0.3 * TRACKS
    assert np.mean(found.agreeing[~bad]) > 0.9
    assert np.mean(found.agreeing[bad]) < 0.4
    speed = np.linalg.norm(truth(motion).velocity)
    assert np.linalg.norm(found.motion.velocity - truth(motion).velocity) < 0.2 * speed


def test_a_motion_that_contradicts_many_tracks_is_not_cheaper() -> None:
    """Outliers contribute to the cost with more than an observation with the declared noise does."""
    found = adjusted(styled(MotionStyle.AGGRESSIVE, 1), sigma=SIGMA, bad=0.3)
    assert np.mean(found.agreeing) < 0.85
    assert found.cost > 0.46 * 12 * TRACKS


def test_tracks_that_disagree_do_not_distinguish_two_motions() -> None:
    """The same difference of cost: from all tracks alike, or of two groups with opposite preferences."""
    best = adjusted(styled(MotionStyle.AGGRESSIVE, 1), sigma=SIGMA)
    alike = np.full(TRACKS, 0.5)
    groups = np.where(np.arange(TRACKS) % 3 == 0, -9.0, 5.25)
    groups += 0.5 - groups.mean()

    def other(difference: Array) -> Adjusted:
        cost, track_cost = best.cost + difference.sum(), best.track_cost + difference
        return replace(best, cost=cost, track_cost=track_cost)

    assert not explains_as_well(other(alike), best)
    assert explains_as_well(other(groups), best)
    # Odds of 150 to 1 are not a difference.
    assert explains_as_well(other(np.full(TRACKS, 4.9 / TRACKS)), best)


def test_without_translation_no_inverse_depth_is_significant() -> None:
    """The camera turns in place; what the points show is noise."""
    turning = sinusoidal(0.0, 0.3)
    reckoning = span(turning, SIGMA, T_b_c=np.eye(4))
    found = adjust(reckoning.rays, reckoning.rays(BIAS), truth(turning), PRIOR, gate=8.0)
    assert np.mean(found.inverse_depth > 4.0 * found.inverse_depth_sigma) < 0.1
