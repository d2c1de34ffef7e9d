# SPDX-License-Identifier: Apache-2.0
"""The sliding window: knots, measurements, landmarks and the marginal prior, in absolute knot numbers."""

from __future__ import annotations

from copy import copy

import numpy as np

from asyneio.estimation.landmark_initialization import LandmarkCandidates
from asyneio.estimation.linearization.zero_velocity import zero_velocity_of
from asyneio.estimation.problem.active import active_coordinates
from asyneio.estimation.problem.camera_calibration import first_camera, first_rotation_prior, with_camera
from asyneio.estimation.problem.inertial_calibration import corrected, first_correction, with_imu
from asyneio.estimation.problem.landmarks import LandmarkTable
from asyneio.estimation.problem.measurements import InertialBuffer, PreintegrationBuffer, VisualBuffer
from asyneio.estimation.problem.problem import (
    KINEMATIC_COLUMNS,
    NOTHING_PROPAGATED,
    PROPAGATED_COLUMNS,
    Model,
    Prior,
    Problem,
    Propagated,
    States,
)
from asyneio.estimation.problem.propagated_queries import propagated_at
from asyneio.estimation.problem.schemes import measure
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.estimation.problem.window_settings import WindowSettings
from asyneio.estimation.solver.marginalization import marginalize_oldest
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution, optimize
from asyneio.inertial.increments import Preintegration
from asyneio.inertial.noise import InertialNoise
from asyneio.types import BoolArray, FloatArray, IntArray, RecordArray

#: Inverse depth of the first landmarks without parallax, 1/m: a room.
_DEFAULT_RHO = 0.5
#: The end of a stationary phase is detected late, by up to this time [ns].
LATE_NS = 200_000_000


class Window:
    """Knots `first .. first + K - 1` with all measurements between them."""

    def __init__(self, settings: WindowSettings, t_ns: int, states: States, prior: Prior) -> None:
        """A window of one knot at `t_ns` with its prior."""
        self._settings = settings
        self.first = 0
        self.t_ns: IntArray = np.array([t_ns], dtype=np.int64)
        self.states = states.copied()
        self._linearization = states.copied()
        self.camera = first_camera(settings.T_b_c[:3, :3], settings.calibration)
        self.imu = first_correction(settings.imu)
        self._rotation_prior = first_rotation_prior(self.camera, settings.calibration)
        prior = with_camera(prior, self.camera, settings.calibration)
        self.prior = with_imu(prior, self.imu, settings.imu)
        self._frozen = 0
        prior_kind = settings.motion_model.prior
        smooths = len(self.imu.columns) > 0
        self._gyroscope = InertialBuffer(prior_kind, smooths)
        self._accelerometer = InertialBuffer(prior_kind, smooths)
        self._preintegrations = PreintegrationBuffer()
        self._visual = VisualBuffer(prior_kind)
        self._still: BoolArray = np.empty(0, dtype=np.bool_)
        self.landmarks = LandmarkTable()
        #: The last solved problem, as long as the window has not changed.
        self._solved: Problem | None = None

    def copied(self) -> Window:
        """A copy; neither changes with the other."""
        other = copy(self)
        # All arrays are replaced, never written to.
        other.landmarks, other._visual = copy(self.landmarks), copy(self._visual)
        other._gyroscope, other._accelerometer = copy(self._gyroscope), copy(self._accelerometer)
        other._preintegrations = copy(self._preintegrations)
        return other

    @property
    def knots(self) -> int:
        """Number of knots."""
        return len(self.t_ns)

    @property
    def camera_position(self) -> FloatArray:
        """Position (3,) of the camera in the body [m]."""
        return self._settings.T_b_c[:3, 3]

    @property
    def refines_bearings(self) -> bool:
        """Whether the bearings of landmarks are unknowns."""
        return self._settings.landmark_dof == 3

    @property
    def observations(self) -> int:
        """Number of observations held, of tracks with and without a landmark."""
        return len(self._visual)

    @property
    def preintegrations(self) -> list[Preintegration]:
        """Increments of the intervals, in order; empty under a scheme without increments."""
        return self._preintegrations.rules()

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
        still: bool = False,
        noise: InertialNoise | None = None,
    ) -> None:
        """Append a predicted knot (States with K = 1) at `t_ns` and the measurements of the interval before
        it, with inertial samples from shortly before the interval, which cover its start. `still`: the sensor
        was stationary throughout; `noise` of the inertial samples, None for that of the settings.

        Raises:
            EstimationError, InertialError: as `schemes.measure`.
        """
        self._solved = None
        s = self._settings
        interval = self.first + self.knots - 1
        bounds = (int(self.t_ns[-1]), t_ns)
        bias = self.states.bias[-1]
        noise = s.noise if noise is None else noise
        measured = measure(s.scheme, gyroscope, accelerometer, bounds, bias, noise, s.noise_inflation)
        self._gyroscope.append(measured.gyroscope, interval, *bounds)
        self._accelerometer.append(measured.accelerometer, interval, *bounds)
        self._preintegrations.append(measured, interval)
        self._visual.append(
            observations.t_ns,
            observations.track,
            observations.xy,
            observations.root_information,
            interval,
            bounds,
            self._increments(measured.preintegration, observations.t_ns),
            self.camera.time_offset,
        )
        self._still = np.append(self._still, still)
        self.t_ns = np.append(self.t_ns, t_ns)
        self.states = self.states.joined(knot)
        self._linearization = self._linearization.joined(knot)

    def revert_zero_velocity(self, moving_ns: int) -> None:
        """The sensor moved after `moving_ns`: the interval that ends then, and those shortly before, do not
        count as stationary."""
        still = self._still & (self.t_ns[1:] <= moving_ns - LATE_NS)
        if not np.array_equal(still, self._still):
            self._still, self._solved = still, None

    def _increments(self, preintegration: Preintegration | None, t_ns: IntArray) -> Propagated:
        """Increments since the newest knot at times (N,); empty unless the scheme propagates."""
        if preintegration is None or not self._settings.scheme.propagates:
            return NOTHING_PROPAGATED
        tau = (t_ns - self.t_ns[-1]) * 1e-9 + self.camera.time_offset
        return propagated_at(preintegration, tau, self._moves_in_time)

    @property
    def _moves_in_time(self) -> bool:
        return 0 in self.camera.columns

    def problem(self) -> Problem:
        """The optimisation problem of the window."""
        if self._solved is not None:
            return self._solved
        intervals = self.knots - 1
        visual, propagated = self._visual.arrays(
            self.landmarks.index_of(self._visual.track), self.landmarks.anchor, self.first, intervals
        )
        model = self._model()
        gyroscope, accelerometer = corrected(
            self._gyroscope.arrays(self.first, intervals),
            self._accelerometer.arrays(self.first, intervals),
            self.imu,
        )
        return Problem(
            states=self.states,
            linearization=self._linearization,
            frozen=self._frozen,
            motion=np.ones(intervals, dtype=np.bool_),
            gyroscope=gyroscope,
            accelerometer=accelerometer,
            visual=visual,
            landmarks=self.landmarks.arrays(self.first),
            camera=self.camera,
            model=model,
            preintegrated=self._preintegrations.arrays(self.first, intervals),
            propagated=propagated,
            zero_velocity=zero_velocity_of(self._still, model),
            imu=self.imu,
        )

    def _model(self) -> Model:
        s = self._settings
        kinematic = not s.scheme.propagates
        return Model(
            motion_model=s.motion_model,
            active=active_coordinates(s.motion_model, kinematic),
            dt=np.diff(self.t_ns) * 1e-9,
            gravity_w=s.gravity_w,
            root_density=s.root_density,
            bias_walk=s.bias_walk,
            r_bc=np.ascontiguousarray(s.T_b_c[:3, 3]),
            robust_scale=s.robust_scale,
            gate=s.gate,
            landmark_dof=s.landmark_dof,
            landmark_damping=s.landmark_damping,
            kinematic_prior=kinematic,
            landmark_columns=KINEMATIC_COLUMNS if kinematic else PROPAGATED_COLUMNS,
        )

    def optimize(self, settings: OptimizerSettings) -> Solution:
        """Optimise, and adopt the result."""
        solution = optimize(self.problem(), self.prior, settings)
        self.states = solution.problem.states
        self._linearization = solution.problem.linearization
        self.landmarks.kappa = solution.problem.landmarks.kappa
        self.landmarks.rho = solution.problem.landmarks.rho
        self.camera, self.imu = solution.problem.camera, solution.problem.imu
        if self._moves_in_time:
            self._visual.move_to(self.camera.time_offset, self.preintegrations, self.first)
        # `move_to` may have recomputed the propagated poses.
        self._solved = None if self._settings.scheme.propagates else solution.problem
        return solution

    def marginalize_oldest(self) -> None:
        """Replace the oldest knot, and the landmarks anchored there, by the marginal prior."""
        s = self._settings
        walk = np.concatenate([s.calibration.walk[self.camera.columns], s.imu.walk[self.imu.columns]])
        interval_s = float(self.t_ns[1] - self.t_ns[0]) * 1e-9
        added = self._reweighted_rotation(len(walk), s.calibration.walk[1] ** 2 * interval_s)
        self.prior = marginalize_oldest(self.problem(), self.prior, walk**2 * interval_s, added)
        anchored = self.landmarks.anchor == self.first
        gone = np.isin(self._visual.track, self.landmarks.track[anchored])
        # The rest of the first interval belongs to tracks that are too short for a landmark.
        self._visual.keep(~gone & (self._visual.interval > self.first))
        self.landmarks.keep(~anchored)
        self._solved = None
        self.first += 1
        self._gyroscope.drop_before(self.first)
        self._accelerometer.drop_before(self.first)
        self._preintegrations.drop_before(self.first)
        self._still = self._still[1:]
        self.t_ns = self.t_ns[1:]
        self.states = self.states.chosen(slice(1, None))
        self._linearization = self._linearization.chosen(slice(1, None))
        if s.frozen_linearization:
            self._frozen = self.prior.knots

    def _reweighted_rotation(self, size: int, walk: float) -> tuple[FloatArray, FloatArray] | None:
        """Renew the weight of the prior on the camera's rotation, which then walks by the variance `walk`.

        Returns information and gradient to add to the `size` coordinates of camera and IMU, None if the
        rotation is not estimated.
        """
        if self._rotation_prior is None:
            return None
        renewed, information, gradient = self._rotation_prior.reweighted(self.camera)
        self._rotation_prior = renewed.after_walk(walk)
        rotation = np.flatnonzero(self.camera.columns > 0)
        added = np.zeros((2, size))
        added[0, rotation], added[1, rotation] = information, gradient
        return added[0], added[1]

    def remove_tracks(self, ids: IntArray) -> None:
        """Forget tracks: their observations and their landmarks."""
        if len(ids) == 0:
            return
        self._solved = None
        self._visual.keep(~np.isin(self._visual.track, ids))
        self.landmarks.keep(~np.isin(self.landmarks.track, ids))

    def drop_landmarks(self, ids: IntArray) -> None:
        """Forget the landmarks of tracks, whose observations stay without influence."""
        self._solved = None
        self.landmarks.keep(~np.isin(self.landmarks.track, ids))

    def with_tracks_of(self, other: Window) -> Window:
        """A copy with the tracks of `other`, a window of the same knots, and with landmarks that are
        triangulated from the own trajectory."""
        result = self.copied()
        result._visual, result.landmarks, result._solved = copy(other._visual), LandmarkTable(), None
        if self._moves_in_time:
            result._visual.move_to(self.camera.time_offset, self.preintegrations, self.first)
        result.add_landmarks()
        return result

    @property
    def track_observations(self) -> TrackObservations:
        """The observations held, of tracks with and without a landmark."""
        visual = self._visual
        return TrackObservations(visual.t_ns, visual.track, visual.xy, visual.root_information)

    def tracks_since(self, t_ns: int) -> IntArray:
        """Ids of the tracks whose first observation in the window is later than `t_ns`."""
        ids, first = np.unique(self._visual.track, return_index=True)
        return np.asarray(ids[self._visual.t_ns[first] > t_ns])

    def add_landmarks(self) -> int:
        """Add landmarks for the tracks with enough observations; returns their number."""
        index = self.landmarks.index_of(self._visual.track)
        pending = np.flatnonzero(index < 0)
        if len(pending) == 0 or self.knots < 2:
            return 0
        births = self._births()
        pending = pending[np.argsort(self._visual.track[pending], kind="stable")]
        _, begin, counts = np.unique(self._visual.track[pending], return_index=True, return_counts=True)
        groups = [
            pending[a : a + n]
            for a, n in zip(begin, counts, strict=True)
            if n >= self._settings.min_observations and births.has_anchor(pending[a : a + n])
        ]
        if not groups:
            return 0
        self._solved = None
        default_rho = float(np.median(self.landmarks.rho)) if len(self.landmarks) else _DEFAULT_RHO
        anchors, kappas, rhos = births.born(groups, max(default_rho, 0.0))
        self.landmarks.add(self._visual.track[[group[0] for group in groups]], anchors, kappas, rhos)
        if not births.refines_bearing:
            # The fixed bearing represents the observations before the anchor.
            early = [
                group[self._visual.interval[group] < a] for group, a in zip(groups, anchors, strict=True)
            ]
            keep = np.ones(len(self._visual), dtype=np.bool_)
            keep[np.concatenate(early)] = False
            self._visual.keep(keep)
        return len(groups)

    def _births(self) -> LandmarkCandidates:
        bias = self.states.bias[:0]
        if self._settings.scheme.propagates:
            bias = self._preintegrations.arrays(self.first, self.knots - 1).bias
            # The newest knot has no increments after it; the pose of an anchor needs none.
            bias = np.concatenate([bias, self.states.bias[-1:]])
        return LandmarkCandidates(
            visual=self._visual,
            first=self.first,
            t_ns=self.t_ns,
            states=self.states,
            camera=self.camera,
            model=self._model(),
            increments_bias=bias,
            bearing_sigma=self._settings.bearing_sigma,
        )
