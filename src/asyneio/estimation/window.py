"""The sliding window: knots, measurements, landmarks and the marginal prior, in absolute knot numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.landmarks import LandmarkTable, born_landmark, camera_poses
from asyneio.estimation.marginalization import marginalize_oldest
from asyneio.estimation.measurements import InertialBuffer, VisualBuffer
from asyneio.estimation.optimizer import OptimizerSettings, Solution, optimize
from asyneio.estimation.problem import Model, Prior, Problem, States
from asyneio.types import FloatArray, IntArray, RecordArray


@dataclass(frozen=True)
class WindowSettings:
    """Plain values that the window needs."""

    gravity_w: FloatArray  # (3,)
    root_density: FloatArray  # (6,) motion prior
    bias_walk: FloatArray  # (6,)
    gyroscope_sigma: float  # rad/s of one sample
    accelerometer_sigma: float  # m/s^2 of one sample
    T_b_c: FloatArray  # (4,4)
    robust_scale: float
    gate: float
    landmark_dof: int
    landmark_damping: FloatArray  # (3,)
    bearing_sigma: float  # rad, of one observation: decides whether a track has parallax
    min_observations: int
    frozen_linearization: bool


@dataclass(frozen=True)
class TrackObservations:
    """Undistorted observations: `t_ns` (N,), `track` (N,), `xy` (N,2), `root_information` (N,2,2)."""

    t_ns: IntArray
    track: IntArray
    xy: FloatArray
    root_information: FloatArray

    def between(self, start_ns: int, end_ns: int) -> TrackObservations:
        """Those with start < t <= end (times ascending)."""
        a, b = np.searchsorted(self.t_ns, [start_ns, end_ns], side="right")
        return TrackObservations(self.t_ns[a:b], self.track[a:b], self.xy[a:b], self.root_information[a:b])


class Window:
    """Knots `first .. first + K - 1` with everything that was measured between them."""

    def __init__(self, settings: WindowSettings, t_ns: int, states: States, prior: Prior) -> None:
        """A window of one knot at `t_ns` with its prior."""
        self._settings = settings
        self.first = 0
        self.t_ns: IntArray = np.array([t_ns], dtype=np.int64)
        self.states = states.copied()
        self._linearization = states.copied()
        self.prior = prior
        self._frozen = 0
        self._gyroscope = InertialBuffer()
        self._accelerometer = InertialBuffer()
        self._visual = VisualBuffer()
        self.landmarks = LandmarkTable()

    @property
    def knots(self) -> int:
        """Number of knots."""
        return len(self.t_ns)

    @property
    def observations(self) -> int:
        """Number of observations held, of tracks with and without a landmark."""
        return len(self._visual)

    def span_s(self) -> float:
        """Time from the first to the last knot [s]."""
        return float(self.t_ns[-1] - self.t_ns[0]) * 1e-9

    def extend(
        self,
        t_ns: int,
        knot: States,
        gyroscope: RecordArray,
        accelerometer: RecordArray,
        observations: TrackObservations,
    ) -> None:
        """Append a predicted knot (States with K = 1) at `t_ns` and the measurements of the interval
        before it."""
        interval = self.first + self.knots - 1
        bounds = (int(self.t_ns[-1]), t_ns)
        self._gyroscope.append(gyroscope, self._settings.gyroscope_sigma, interval, *bounds)
        self._accelerometer.append(accelerometer, self._settings.accelerometer_sigma, interval, *bounds)
        self._visual.append(
            observations.t_ns,
            observations.track,
            observations.xy,
            observations.root_information,
            interval,
            bounds,
        )
        self.t_ns = np.append(self.t_ns, t_ns)
        self.states = States(*(np.concatenate(pair) for pair in zip(self.states, knot, strict=True)))
        self._linearization = States(
            *(np.concatenate(pair) for pair in zip(self._linearization, knot, strict=True))
        )

    def problem(self) -> Problem:
        """The optimisation problem of the present window."""
        intervals = self.knots - 1
        return Problem(
            states=self.states,
            linearization=self._linearization,
            frozen=self._frozen,
            motion=np.ones(intervals, dtype=np.bool_),
            gyroscope=self._gyroscope.arrays(self.first, intervals),
            accelerometer=self._accelerometer.arrays(self.first, intervals),
            visual=self._visual.arrays(
                self.landmarks.index_of(self._visual.track), self.landmarks.anchor, self.first, intervals
            ),
            landmarks=self.landmarks.arrays(self.first),
            model=self._model(),
        )

    def _model(self) -> Model:
        s = self._settings
        return Model(
            dt=np.diff(self.t_ns) * 1e-9,
            gravity_w=s.gravity_w,
            root_density=s.root_density,
            bias_walk=s.bias_walk,
            C_bc=np.ascontiguousarray(s.T_b_c[:3, :3]),
            r_bc=np.ascontiguousarray(s.T_b_c[:3, 3]),
            robust_scale=s.robust_scale,
            gate=s.gate,
            landmark_dof=s.landmark_dof,
            landmark_damping=s.landmark_damping,
        )

    def optimize(self, settings: OptimizerSettings) -> Solution:
        """Optimise and take over the result."""
        solution = optimize(self.problem(), self.prior, settings)
        self.states = solution.problem.states
        self._linearization = solution.problem.linearization
        self.landmarks.kappa = solution.problem.landmarks.kappa
        self.landmarks.rho = solution.problem.landmarks.rho
        return solution

    def marginalize_oldest(self) -> None:
        """Replace the oldest knot, and the landmarks anchored there, by the marginal prior."""
        self.prior = marginalize_oldest(self.problem(), self.prior)
        anchored = self.landmarks.anchor == self.first
        gone = np.isin(self._visual.track, self.landmarks.track[anchored])
        # What is left in the first interval belongs to tracks too short for a landmark.
        self._visual.keep(~gone & (self._visual.interval > self.first))
        self.landmarks.keep(~anchored)
        self.first += 1
        self._gyroscope.drop_before(self.first)
        self._accelerometer.drop_before(self.first)
        self.t_ns = self.t_ns[1:]
        self.states = States(*(a[1:] for a in self.states))
        self._linearization = States(*(a[1:] for a in self._linearization))
        if self._settings.frozen_linearization:
            self._frozen = self.prior.knots

    def add_landmarks(self) -> int:
        """Landmarks for the tracks that have observations enough; returns how many."""
        index = self.landmarks.index_of(self._visual.track)
        pending = np.flatnonzero(index < 0)
        if len(pending) == 0 or self.knots < 2:
            return 0
        pending = pending[np.argsort(self._visual.track[pending], kind="stable")]
        tracks, begin, counts = np.unique(self._visual.track[pending], return_index=True, return_counts=True)
        ready = counts >= self._settings.min_observations
        groups = [pending[a : a + n] for a, n in zip(begin[ready], counts[ready], strict=True)]
        default_rho = float(np.median(self.landmarks.rho)) if len(self.landmarks) else 0.5
        born = [self._born(group, max(default_rho, 0.0)) for group in groups]
        if born:
            anchors, kappas, rhos = zip(*born, strict=True)
            self.landmarks.add(tracks[ready], np.array(anchors), np.array(kappas), np.array(rhos))
        return len(born)

    def _born(self, group: IntArray, default_rho: float) -> tuple[int, FloatArray, float]:
        """Anchor (absolute), bearing and inverse depth of a track from its observations (in order of
        time)."""
        interval = self._visual.interval[group] - self.first
        xy = self._visual.xy[group]
        direction = np.column_stack([xy, np.ones(len(xy))])
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        model = self._model()
        anchor = int(interval[0])
        # The anchor's own camera pose is the query at the start of its interval: weights zero.
        weights = np.vstack([np.zeros((1, 5)), self._visual.weights[group]])
        C, r = np.empty((len(weights), 3, 3)), np.empty((len(weights), 3))
        where = np.concatenate([[anchor], interval])
        camera_poses(self.states, where, weights, model.C_bc, model.r_bc, C, r)
        kappa = np.empty(3)
        rho = born_landmark(
            C[1:], r[1:], direction, 0, C[0], r[0], default_rho, self._settings.bearing_sigma, kappa
        )
        return anchor + self.first, kappa, rho
