"""Tiny windows on a known motion: a few knots, a dozen landmarks, everything drawn from one seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from asyneio.estimation.problem.problem import Prior, Problem, States
from asyneio.estimation.problem.schemes import SCHEMES
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.estimation.problem.window_settings import WindowSettings
from asyneio.estimation.window import Window
from asyneio.inertial.noise import InertialNoise, SensorNoise
from asyneio.trajectory.model import WNOJ_SE3
from asyneio.types import INERTIAL_DTYPE, RecordArray
from tests.factors.knots import hat6
from tests.trajectory.motions import START_NS, Samples, simulated

Array = NDArray[np.float64]
Times = NDArray[np.int64]

KNOT_NS = 100_000_000
#: How long before an interval inertial samples still come along.
EARLIER_NS = 70_000_000
GRAVITY = np.array([0.0, 0.0, -9.81])
T_B_C = expm(hat6(np.array([0.10, -0.05, 0.08, 0.03, -0.02, 0.05])))
GYROSCOPE_SIGMA, ACCELEROMETER_SIGMA = 0.01, 0.05
#: Whitens normalised coordinates; not symmetric on purpose.
ROOT_INFORMATION = np.array([[200.0, 9.0], [0.0, 180.0]])
#: Standard deviations of the perturbation of a knot: [eps, varpi, varpi_dot, biases].
PERTURBATION = np.repeat([0.01, 0.03, 0.3, 0.01], [6, 6, 6, 6])

#: White, with the same standard deviation of a sample at any rate.
NOISE = InertialNoise(SensorNoise(GYROSCOPE_SIGMA, 1.0), SensorNoise(ACCELEROMETER_SIGMA, 1.0))

SETTINGS = WindowSettings(
    gravity_w=GRAVITY,
    motion_model=WNOJ_SE3,
    root_density=np.array([20.0, 25.0, 22.0, 30.0, 28.0, 33.0]),
    bias_walk=np.array([1e-3, 2e-3, 1e-3, 1e-2, 2e-2, 1e-2]),
    scheme=SCHEMES["gpif"],
    noise=NOISE,
    noise_inflation=1.0,
    T_b_c=T_B_C,
    robust_scale=1e6,
    gate=1e9,
    landmark_dof=3,
    landmark_damping=np.array([0.1, 16.0, 16.0]),
    bearing_sigma=0.005,
    min_observations=3,
    frozen_linearization=True,
)


@dataclass(frozen=True)
class Toy:
    """True states at the knots `t_ns`, what sensors measured, and the landmark of each track."""

    t_ns: Times
    truth: States
    gyroscope: RecordArray
    accelerometer: RecordArray
    observations: TrackObservations
    points_w: Array
    settings: WindowSettings
    rng: np.random.Generator

    def perturbed_truth(self, scale: float = 1.0) -> States:
        delta = scale * PERTURBATION * self.rng.normal(size=(len(self.t_ns), 24))
        return moved(self.truth, delta)

    def window(self, states: States, prior: Prior | None = None) -> Window:
        """All knots with their measurements; no landmarks yet."""
        prior = first_knot_prior(states) if prior is None else prior
        window = Window(self.settings, int(self.t_ns[0]), knots(states, 0, 1), prior)
        for k in range(1, len(self.t_ns)):
            window.extend(int(self.t_ns[k]), knots(states, k, k + 1), *self.between(k))
        return window

    def between(self, k: int) -> tuple[RecordArray, RecordArray, TrackObservations]:
        """Measurements of the interval that ends at knot k, and the inertial samples shortly before it."""
        start, end = int(self.t_ns[k - 1]), int(self.t_ns[k])
        gyroscope, accelerometer = (
            s[(s["t_ns"] > start - EARLIER_NS) & (s["t_ns"] <= end)]
            for s in (self.gyroscope, self.accelerometer)
        )
        return gyroscope, accelerometer, self.observations.between(start, end)

    def problem(self, scale: float = 1.0) -> tuple[Problem, Prior]:
        """A window around the truth, ready to be optimised, with a prior that fixes the frame."""
        window = self.window(self.perturbed_truth(scale))
        assert window.add_landmarks() >= 0.7 * len(self.points_w)
        return window.problem(), window.prior


def make_toy(
    count: int = 5,
    landmarks: int = 12,
    seed: int = 1,
    noise: float = 1.0,
    settings: WindowSettings = SETTINGS,
    interval_ns: int = KNOT_NS,
    periods_ns: tuple[int, int] = (20_000_000, 29_000_000),
) -> Toy:
    """`count` knots; tracks of 3 to 9 observations begin and end anywhere; `noise` scales that of sensors,
    `periods_ns` are those of gyroscope and accelerometer."""
    rng = np.random.default_rng(seed)
    t_ns = START_NS + interval_ns * np.arange(count, dtype=np.int64)
    bias = 0.05 * rng.normal(size=6) * np.repeat([0.2, 1.0], 3)
    gyroscope, accelerometer = _inertial(t_ns, bias, noise, periods_ns, rng)
    observations, points_w = _observations(t_ns, landmarks, noise, rng)
    at_knots = simulated(t_ns)
    truth = States(
        np.ascontiguousarray(at_knots.T[:, :3, :3]),
        np.ascontiguousarray(at_knots.T[:, :3, 3]),
        at_knots.varpi,
        np.tile(bias, (count, 1)),
    )
    return Toy(t_ns, truth, gyroscope, accelerometer, observations, points_w, settings, rng)


def with_dof(dof: int, **changes: object) -> WindowSettings:
    return replace(SETTINGS, landmark_dof=dof, **changes)  # type: ignore[arg-type]


def _inertial(
    t_ns: Times, bias: Array, noise: float, periods_ns: tuple[int, int], rng: np.random.Generator
) -> tuple[RecordArray, RecordArray]:
    """Two streams of different rates; the first interval's end is an instant of the gyroscope's."""
    span = int(t_ns[-1] - t_ns[0])
    times = [np.arange(first, span, step) for first, step in zip((0, 1_700_000), periods_ns, strict=True)]
    gyroscope, accelerometer = (np.zeros(len(t), dtype=INERTIAL_DTYPE) for t in times)
    gyroscope["t_ns"], accelerometer["t_ns"] = t_ns[0] + times[0], t_ns[0] + times[1]
    omega = simulated(gyroscope["t_ns"]).varpi[:, 0, :3]
    gyroscope["xyz"] = omega + bias[:3] + noise * GYROSCOPE_SIGMA * rng.normal(size=omega.shape)
    force = specific_force(simulated(accelerometer["t_ns"]))
    accelerometer["xyz"] = force + bias[3:] + noise * ACCELEROMETER_SIGMA * rng.normal(size=force.shape)
    return gyroscope, accelerometer


def specific_force(states: Samples) -> Array:
    varpi, varpi_dot = states.varpi[:, 0], states.varpi[:, 1]
    gravity_b = GRAVITY @ states.T[:, :3, :3]
    return np.asarray(varpi_dot[:, 3:] + np.cross(varpi[:, :3], varpi[:, 3:]) - gravity_b)


def camera_poses(t_ns: Times) -> Array:
    """True poses (N,4,4) of the camera."""
    return simulated(t_ns).T @ T_B_C


def into(T: Array, point: Array) -> Array:
    """A point (3,) of the world in the frames T (N,4,4)."""
    return np.asarray(np.einsum("nji,nj->ni", T[:, :3, :3], point - T[:, :3, 3]))


def observe(times: Times, point_w: Array) -> Array:
    """Exact normalised coordinates (N,2) of a point (3,) from the true motion."""
    h = into(camera_poses(times), point_w)
    assert (h[:, 2] > 0.1).all()
    return np.asarray(h[:, :2] / h[:, 2:])


def as_observations(parts: list[tuple[int, Times, Array]]) -> TrackObservations:
    """Observations in order of time, of tracks given as (id, times, normalised coordinates)."""
    track = np.concatenate([np.full(len(times), name) for name, times, _ in parts])
    times = np.concatenate([times for _, times, _ in parts])
    xy = np.concatenate([xy for _, _, xy in parts])
    order = np.argsort(times, kind="stable")
    root = np.tile(ROOT_INFORMATION, (len(order), 1, 1))
    return TrackObservations(times[order], track[order], xy[order], root)


def _observations(
    t_ns: Times, landmarks: int, noise: float, rng: np.random.Generator
) -> tuple[TrackObservations, Array]:
    span = int(t_ns[-1] - t_ns[0])
    rays = np.column_stack([rng.uniform(-0.4, 0.4, (landmarks, 2)), np.ones(landmarks)])
    depth = rng.uniform(1.0, 4.0, landmarks)
    T = camera_poses(t_ns[:1] + span // 2)[0]
    points_w = (rays * depth[:, None]) @ T[:3, :3].T + T[:3, 3]
    parts = []
    for track, point in enumerate(points_w):
        count = int(rng.integers(3, 10))
        begin = int([0.0, 0.4, 0.2][track % 3] * span)
        end = min(begin + int(3.5 * np.diff(t_ns)[0]), span)
        times = t_ns[0] + np.sort(rng.integers(begin + 1, end, count))
        if track == 0:
            times[-1] = t_ns[min(2, len(t_ns) - 1)]  # exactly at a knot
        error = noise * rng.normal(size=(count, 2)) @ np.linalg.inv(ROOT_INFORMATION).T
        parts.append((7 * track + 3, times, observe(times, point) + error))
    return as_observations(parts), points_w


def knots(states: States, first: int, last: int) -> States:
    return states.chosen(slice(first, last)).copied()


def moved(states: States, delta: Array) -> States:
    """States perturbed on the right by `delta` (K,24)."""
    T = np.tile(np.eye(4), (len(states.r), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = states.C, states.r
    T = np.stack([T[k] @ expm(hat6(delta[k, :6])) for k in range(len(T))])
    return States(
        np.ascontiguousarray(T[:, :3, :3]),
        np.ascontiguousarray(T[:, :3, 3]),
        states.varpi + delta[:, 6:18].reshape(-1, 2, 6),
        states.bias + delta[:, 18:],
    )


def first_knot_prior(states: States, sigma: float = 1e-3) -> Prior:
    """Position and yaw of the first knot define the frame; rates and biases are roughly known.

    Nothing else depends on position and yaw, so at the minimum their residuals vanish.
    """
    first = knots(states, 0, 1)
    R = np.zeros((22, 24))
    R[0, :3] = first.C[0, 2] / sigma
    R[1:4, 3:6] = np.eye(3) / sigma
    R[4:, 6:] = np.diag(1.0 / np.repeat([0.05, 0.5, 0.02, 0.1], [6, 6, 3, 3]))
    return Prior(R, R.T @ R, 0.3 * np.r_[np.zeros(4), np.ones(18)], first)


def no_prior(states: States) -> Prior:
    """A prior without information."""
    return Prior(np.zeros((0, 24)), np.zeros((24, 24)), np.zeros(0), knots(states, 0, 1))
