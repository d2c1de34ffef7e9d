"""Scale factors and misalignment of the IMU as unknowns: normal equations, minimum, marginalisation and
covariance against the dense oracle, and whole windows with sensor errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.estimation.linearization.linear_system import evaluate_cost, linearize
from asyneio.estimation.linearization.prior import add_prior, difference
from asyneio.estimation.problem.camera_calibration import CalibrationSettings
from asyneio.estimation.problem.inertial_calibration import (
    correction_settings,
    first_correction,
    gains,
    smoothed,
    with_moved_imu,
)
from asyneio.estimation.problem.problem import Prior, Problem
from asyneio.estimation.solver.covariance import (
    camera_covariance,
    imu_covariance,
    newest_covariance,
    relative_scale_sigma,
)
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.estimation.solver.marginalization import marginalize_oldest
from asyneio.estimation.solver.optimizer import OptimizerSettings, optimize
from asyneio.inertial.noise import InertialNoise, SensorNoise
from asyneio.trajectory.model import MotionModel
from tests.estimation import naive
from tests.estimation.test_camera_calibration import SIGMA, assert_same
from tests.estimation.test_motion_models import _without_oldest
from tests.estimation.toy import ACCELEROMETER_SIGMA, GYROSCOPE_SIGMA, SETTINGS, Toy, make_toy, moved
from tests.models import MODELS

Array = NDArray[np.float64]

KNOTS = 4
ALL, GYROSCOPE, SOME = tuple(range(15)), tuple(range(6)), (1, 4, 6, 8, 13)
SCALE, MISALIGNMENT = 0.02, 0.01
TO_THE_END = OptimizerSettings(max_iterations=40, relative_decrease=1e-10, damping=1e-6)


@dataclass(frozen=True)
class Case:
    """A motion model, and the estimated coordinates of IMU and camera."""

    model: MotionModel
    columns: tuple[int, ...] = ALL
    camera: tuple[int, ...] = ()

    @property
    def behind(self) -> int:
        return len(self.camera) + len(self.columns)

    def toy(self, walk: float = 0.0, **changes: object) -> Toy:
        settings = replace(
            SETTINGS,
            motion_model=self.model,
            calibration=CalibrationSettings(np.array(self.camera, dtype=np.int64), SIGMA, np.zeros(4)),
            imu=replace(correction_settings(SCALE, MISALIGNMENT, walk), columns=np.array(self.columns)),
        )
        return make_toy(**{"count": KNOTS, "landmarks": 8, "settings": settings} | changes)  # type: ignore[arg-type]


CASES = {
    **{name: Case(model) for name, model in MODELS.items()},
    "camera": Case(MODELS["wnoj-se3"], camera=(0, 1, 2, 3)),
    "offset-wnoa": Case(MODELS["wnoa-se3"], camera=(0,)),
    "gyroscope": Case(MODELS["wnoj-so3xr3"], GYROSCOPE),
    "some": Case(MODELS["wnoj-se3"], SOME),
}
every_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())


@cache
def drawn(case: Case, frozen: int = 0) -> tuple[Problem, Prior]:
    """The IMU has moved from its prior, the first `frozen` knots from their linearisation point."""
    toy = case.toy()
    problem, prior = toy.problem(0.3)
    delta = 0.02 * toy.rng.normal(size=(KNOTS, 24))
    delta[frozen:] = 0.0
    delta[:, 12:18] = 0.0
    problem = problem._replace(
        states=moved(problem.states, delta), linearization=problem.states, frozen=frozen
    )
    return with_moved_imu(problem, 0.015 * toy.rng.normal(size=len(case.columns))), prior


def reduced(problem: Problem, prior: Prior) -> tuple[Array, Array]:
    """Information and gradient of all but the landmarks, which are eliminated."""
    system = linearize(problem)
    add_prior(system, prior, difference(problem.states, prior, problem.camera, problem.imu))
    eliminate_landmarks(system, problem.landmarks, problem.model)
    return system.H, system.b


def dense(problem: Problem, prior: Prior) -> tuple[Array, Array]:
    """Of all unknowns, the oracle's Jacobians. A prior is linear in the distance from its own point."""
    normal = naive.normal_equations(problem).damped(problem.model.landmark_damping)
    r = naive.prior_residuals(prior, naive.at(problem.states, problem))
    end = 24 * KNOTS
    behind = len(problem.camera.columns) + len(problem.imu.columns)
    at = np.r_[: 24 * prior.knots, end : end + behind]
    normal.H[np.ix_(at, at)] += prior.R.T @ prior.R
    normal.b[at] += prior.R.T @ r
    return normal.H, normal.b


@pytest.mark.parametrize("frozen", [0, 2])
@every_case
def test_normal_equations(case: Case, frozen: int) -> None:
    problem, prior = drawn(case, frozen)
    H, b = dense(problem, prior)
    free = naive.unknowns(problem)
    at = free[free < 24 * KNOTS + case.behind]
    H_found, b_found = reduced(problem, prior)
    H_left, b_left = naive.schur(H, b, 24 * KNOTS + case.behind)
    ix = np.ix_(at, at)
    assert_same((H_found[ix], b_found[at]), (H_left[ix], b_left[at]))
    assert evaluate_cost(problem) == pytest.approx(linearize(problem).cost, rel=1e-12)


@pytest.mark.slow
@every_case
def test_same_minimum_as_dense_gauss_newton(case: Case) -> None:
    problem, prior = drawn(case)
    solution = optimize(problem, prior, TO_THE_END)
    point, cost = naive.gauss_newton(solution.problem, prior, 3)
    assert solution.report.converged
    assert solution.report.cost == pytest.approx(cost, rel=1e-8)
    np.testing.assert_allclose(solution.problem.imu.coordinates, point.correction, atol=1e-5)
    changed = solution.problem.imu.coordinates - problem.imu.coordinates
    assert np.flatnonzero(changed).tolist() == list(case.columns)


@every_case
def test_covariances_are_those_of_the_dense_problem(case: Case) -> None:
    problem, prior = drawn(case)
    H, _ = dense(problem, prior)
    free = naive.unknowns(problem)
    P = np.zeros_like(H)
    P[np.ix_(free, free)] = np.linalg.inv(H[np.ix_(free, free)])
    one_step = OptimizerSettings(max_iterations=1, relative_decrease=1e-12, damping=1e-6)
    solution = optimize(problem, prior, one_step)
    n, c, s = 24 * KNOTS, len(case.camera), len(case.columns)
    for found, at in (
        (newest_covariance(solution), slice(n - 24, n)),
        (camera_covariance(solution), slice(n, n + c)),
        (imu_covariance(solution), slice(n + c, n + c + s)),
    ):
        expected = P[at, at]
        sigma = np.sqrt(np.where(expected.diagonal() > 0.0, expected.diagonal(), 1.0))
        np.testing.assert_allclose(
            found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-5
        )
    assert 0.0 < relative_scale_sigma(solution) < 1.0


@pytest.mark.parametrize("frozen", [0, 2])
@every_case
def test_marginalisation_equals_everything_at_once(case: Case, frozen: int) -> None:
    """The prior keeps the information of the oldest knot on the IMU."""
    problem, prior = drawn(case, frozen)
    H, b = dense(problem, prior)
    free = naive.unknowns(problem)
    end = 24 * KNOTS + case.behind
    rest = free[free >= 24]
    kept = rest[rest < end]
    order = np.r_[kept, free[free < 24], rest[rest >= end]]
    expected = naive.schur(H[np.ix_(order, order)], b[order], len(kept))
    after = marginalize_oldest(problem, prior)
    assert after.imu is not None
    H_left, b_left = reduced(_without_oldest(problem), after)
    at = kept - 24
    assert_same((H_left[np.ix_(at, at)], b_left[at]), expected)


def test_walk_forgets_in_the_window() -> None:
    """With a walk the IMU becomes less certain when a knot leaves the window."""
    sigmas = []
    for walk in (0.0, 0.2):
        toy = Case(MODELS["wnoj-se3"]).toy(walk=walk)
        window = toy.window(toy.perturbed_truth(0.1))
        window.add_landmarks()
        window.marginalize_oldest()
        sigmas.append(np.sqrt(imu_covariance(window.optimize(TO_THE_END)).diagonal()))
    assert (sigmas[1] > 1.02 * sigmas[0]).all()


def test_the_gyroscope_defines_the_axes() -> None:
    """No coordinate of its correction is a rotation; those of the accelerometer span everything."""
    step = np.arange(1.0, 16.0)
    imu = first_correction(correction_settings(SCALE, MISALIGNMENT, 0.0))._replace(coordinates=step)
    first, second = (matrix - np.eye(3) for matrix in gains(imu))
    np.testing.assert_array_equal(first, [[1, 6, 5], [6, 2, 4], [5, 4, 3]])
    np.testing.assert_array_equal(second, [[7, 10, 11], [12, 8, 13], [14, 15, 9]])


def spoilt(toy: Toy, coordinates: Array) -> Toy:
    """The same with readings that are off by `coordinates` (15,)."""
    imu = first_correction(toy.settings.imu)._replace(coordinates=coordinates)
    streams = []
    for samples, gain in zip((toy.gyroscope, toy.accelerometer), gains(imu), strict=True):
        read = samples.copy()
        read["xyz"] = samples["xyz"] @ gain.T
        streams.append(read)
    return replace(toy, gyroscope=streams[0], accelerometer=streams[1])


def test_wrong_scale_factors_are_found() -> None:
    """Noise-free measurements, true states; what the motion shows of the sensors is found, the rest stays
    within its own standard deviation."""
    # Errors so large that eight knots determine them.
    settings = replace(SETTINGS, imu=correction_settings(0.2, 0.1, 0.0))
    toy = make_toy(noise=0.0, count=8, landmarks=40, settings=settings)
    prior = settings.imu
    true = 0.7 * prior.sigma * toy.rng.choice([-1.0, 1.0], size=15)
    wrong = spoilt(toy, true)
    window = wrong.window(wrong.truth)
    window.add_landmarks()
    for _ in range(2):
        solution = window.optimize(TO_THE_END)
    sigma = np.sqrt(imu_covariance(solution).diagonal())
    known = sigma < 0.4 * prior.sigma
    assert known.sum() >= 5, "too little is learnt to tell anything"
    error = window.imu.coordinates - true
    assert np.abs(error / sigma).max() < 2.0
    assert (np.abs(error[known]) < 0.5 * np.abs(true[known])).all()


@pytest.mark.slow
def test_noise_does_not_pull_scale_factors_down() -> None:
    """At the truth the gradient by the scale factors is that of the noise. If readings were as large as they
    look, noise and all, its mean would be the number of values; of smoothed ones it is a small share."""
    noisy = 200.0
    noise = InertialNoise(
        SensorNoise(noisy * GYROSCOPE_SIGMA, 1.0), SensorNoise(noisy * ACCELEROMETER_SIGMA, 1.0)
    )
    settings = replace(SETTINGS, noise=noise, imu=correction_settings(SCALE, MISALIGNMENT, 0.0))
    gradient, information, values = np.zeros(15), np.zeros(15), 0
    for seed in range(40):
        toy = make_toy(
            KNOTS, 1, seed, noisy, settings, interval_ns=50_000_000, periods_ns=(2_000_000, 2_000_000)
        )
        problem = toy.window(toy.truth).problem()
        system = linearize(problem)
        gradient += system.b[-15:]
        information += system.H.diagonal()[-15:]
        values += len(problem.gyroscope.value)
    scales = [0, 1, 2, 6, 7, 8]
    deviation = np.sqrt(information[scales])
    assert (np.abs(gradient[scales]) < 0.25 * values + 4.0 * deviation).all()
    # The test is able to detect it.
    assert (4.0 * deviation < 0.4 * values).all()


def test_smoothing_keeps_motion_and_drops_noise(rng: np.random.Generator) -> None:
    """A turn of the hand at 1 Hz stays, white noise shrinks; what is older than the window still counts."""
    t_ns = np.arange(0, 1_000_000_000, 8_333_333)
    start = np.searchsorted(t_ns, np.arange(300_000_000, 1_000_000_001, 50_000_000))
    t = t_ns * 1e-9
    motion = np.stack([np.sin(2.0 * np.pi * t), np.cos(2.0 * np.pi * t), t], axis=1)
    inside = slice(start[0], start[-1])
    assert np.abs(smoothed(start, t_ns, motion) - motion)[inside].max() < 0.06
    noise = rng.normal(size=motion.shape)
    left = smoothed(start, t_ns, noise)[inside]
    assert np.sqrt(np.mean(left[:-24] ** 2)) < 0.4
    assert np.sqrt(np.mean(left**2)) < 0.5
    np.testing.assert_array_equal(smoothed(start, t_ns, noise)[: start[0]], noise[: start[0]])


def test_noise_of_an_interval_is_no_part_of_its_smoothed_values(rng: np.random.Generator) -> None:
    """Common noise looks like a proportional error. Only the newest interval, which has no successor, needs
    its own values."""
    t_ns = np.arange(0, 1_000_000_000, 8_333_333)
    start = np.searchsorted(t_ns, np.arange(300_000_000, 1_000_000_001, 100_000_000))
    value = rng.normal(size=(len(t_ns), 3))
    before = smoothed(start, t_ns, value)
    for k in range(len(start) - 1):
        mine = slice(start[k], start[k + 1])
        other = value.copy()
        other[mine] += 1.0
        newest = k == len(start) - 2
        assert np.allclose(smoothed(start, t_ns, other)[mine], before[mine]) != newest


def test_what_is_not_estimated_is_taken_as_read() -> None:
    toy = make_toy(count=KNOTS, landmarks=8)
    window = toy.window(toy.perturbed_truth(0.1))
    window.add_landmarks()
    window.optimize(TO_THE_END)
    window.marginalize_oldest()
    assert not window.imu.coordinates.any()
    assert window.prior.imu is None
