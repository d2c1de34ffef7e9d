# SPDX-License-Identifier: Apache-2.0
"""Initialization of landmarks from the observations of their tracks and the current trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.problem.landmarks import camera_poses, initialize_landmarks, propagated_camera_poses
from asyneio.estimation.problem.measurements import VisualBuffer
from asyneio.estimation.problem.problem import Camera, Model, Propagated, States
from asyneio.types import FloatArray, IntArray


@dataclass(frozen=True)
class LandmarkCandidates:
    """Initializes landmarks for tracks of one window.

    `visual`: the window's observations; `first`: absolute number of its first knot; `t_ns` (K,), `states` (K)
    of its knots. `increments_bias` (K,6): biases with which the increments after each knot were computed,
    empty if poses are interpolated. `bearing_sigma` [rad] of one observation.
    """

    visual: VisualBuffer
    first: int
    t_ns: IntArray
    states: States
    camera: Camera
    model: Model
    increments_bias: FloatArray
    bearing_sigma: float

    @property
    def refines_bearing(self) -> bool:
        """Whether the bearing at the anchor is an unknown."""
        return self.model.landmark_dof == 3

    def has_anchor(self, group: IntArray) -> bool:
        """Whether the track of the observations `group` (indices) can have a landmark.

        A refined bearing needs no knot inside the track; a fixed bearing is interpolated at one.
        """
        interval = self.visual.interval[group]
        return self.refines_bearing or bool(interval[-1] > interval[0])

    def born(self, groups: list[IntArray], default_rho: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """Anchors (G,) (absolute), bearings (G,3) and inverse depths (G,) of G tracks from their
        observations, groups of indices, each of ascending times.

        The anchor is the last knot before the first observation, whose bearing is transferred to it. If the
        bearing is fixed, the anchor is the first knot inside the track, which is interpolated to that time.
        """
        counts = np.array([len(group) for group in groups])
        begin = np.cumsum(counts) - counts
        every = np.concatenate(groups)
        interval = self.visual.interval[every] - self.first
        direction = _directions(self.visual.xy[every])
        anchor = interval[begin]
        if not self.refines_bearing:
            anchor = anchor + 1
            direction[begin] = [self._direction_at(*pair) for pair in zip(groups, anchor, strict=True)]
        # The camera of a group's anchor precedes those of its observations.
        start = begin + np.arange(len(groups))
        C, r = self._cameras(np.insert(interval, begin, anchor), every, begin)
        if not self.refines_bearing:
            C[start + 1], r[start + 1] = C[start], r[start]
        kappa, rho = np.empty((len(groups), 3)), np.empty(len(groups))
        initialize_landmarks(C, r, direction, counts, default_rho, self.bearing_sigma, kappa, rho)
        return anchor + self.first, kappa, rho

    def _cameras(
        self, interval: IntArray, observations: IntArray, begin: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Camera poses in the world (N,3,3), (N,3) in `interval` (N,), at the observations; the entry at each
        `begin` is the camera at the knot itself."""
        model, C_bc = self.model, self.camera.C_bc
        C, r = np.empty((len(interval), 3, 3)), np.empty((len(interval), 3))
        if len(self.increments_bias):
            increments = self.visual.propagated.chosen(observations)
            at_knot = Propagated._make(np.insert(a, begin, 0.0, axis=0) for a in increments)
            at_knot.C[begin + np.arange(len(begin))] = np.eye(3)
            bias, gravity_w = self.increments_bias, model.gravity_w
            propagated_camera_poses(self.states, interval, at_knot, bias, gravity_w, C_bc, model.r_bc, C, r)
        else:
            # Zero weights give the pose at the start of the interval.
            weights = np.insert(self.visual.weights[observations, 0], begin, 0.0, axis=0)
            camera_poses(self.states, interval, weights, C_bc, model.r_bc, model.motion_model.space, C, r)
        return C, r

    def _direction_at(self, group: IntArray, knot: int) -> FloatArray:
        """Unit bearing (3,) of a track, interpolated linearly in the image to the time of a knot."""
        t, xy = self.visual.t_ns[group] - self.t_ns[knot], self.visual.xy[group]
        return _directions(np.array([[np.interp(0.0, t, xy[:, 0]), np.interp(0.0, t, xy[:, 1])]]))[0]


def _directions(xy: FloatArray) -> FloatArray:
    """Unit bearings (N,3) of normalised coordinates (N,2)."""
    rays = np.column_stack([xy, np.ones(len(xy))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
