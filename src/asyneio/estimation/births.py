"""Birth of landmarks from the observations of their tracks and the present trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.landmarks import born_landmark, camera_poses, propagated_camera_poses
from asyneio.estimation.measurements import VisualBuffer
from asyneio.estimation.problem import Camera, Model, Propagated, States
from asyneio.types import FloatArray, IntArray


@dataclass(frozen=True)
class Births:
    """Makes landmarks of tracks in one window.

    `visual`: its observations; `first`: absolute number of its first knot; `t_ns` (K,), `states` (K): of its
    knots. `increments_bias` (K,6): biases that the increments after each knot were made with, empty where
    poses are interpolated. `bearing_sigma` [rad] of one observation.
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
        """Whether the anchor's bearing is an unknown."""
        return self.model.landmark_dof == 3

    def has_anchor(self, group: IntArray) -> bool:
        """Whether the track of the observations `group` (indices) can have a landmark.

        A bearing that is refined may start anywhere; a fixed one is interpolated at a knot within.
        """
        interval = self.visual.interval[group]
        return self.refines_bearing or bool(interval[-1] > interval[0])

    def born(self, group: IntArray, default_rho: float) -> tuple[int, FloatArray, float]:
        """Anchor (absolute), bearing (3,) and inverse depth of a track from its observations (ascending
        times).

        The anchor is the last knot before the first observation, whose bearing is carried there; where the
        bearing stays fixed, the first knot inside the track, to whose time the track is interpolated.
        """
        interval = self.visual.interval[group] - self.first
        direction = _directions(self.visual.xy[group])
        anchor = int(interval[0])
        if not self.refines_bearing:
            anchor += 1
            direction[0] = self._direction_at(group, anchor)
        C, r = self._cameras(group, anchor)
        if not self.refines_bearing:
            C[1], r[1] = C[0], r[0]
        kappa = np.empty(3)
        rho = born_landmark(C[1:], r[1:], direction, 0, C[0], r[0], default_rho, self.bearing_sigma, kappa)
        return anchor + self.first, kappa, rho

    def _cameras(self, group: IntArray, anchor: int) -> tuple[FloatArray, FloatArray]:
        """Camera poses in the world at a knot and at some observations: (1+N,3,3), (1+N,3)."""
        model, C_bc = self.model, self.camera.C_bc
        interval = np.concatenate([[anchor], self.visual.interval[group] - self.first])
        C, r = np.empty((len(interval), 3, 3)), np.empty((len(interval), 3))
        if len(self.increments_bias):
            chosen = self.visual.propagated.chosen(group)
            nothing = (np.zeros((1, *a.shape[1:])) for a in chosen[2:])
            start = Propagated(np.zeros(1), np.eye(3)[None], *nothing)
            increments = Propagated(*(np.concatenate(pair) for pair in zip(start, chosen, strict=True)))
            bias, gravity_w = self.increments_bias, model.gravity_w
            propagated_camera_poses(
                self.states, interval, increments, bias, gravity_w, C_bc, model.r_bc, C, r
            )
        else:
            # Weights zero: the pose at the start of the interval.
            weights = np.vstack([np.zeros((1, 5)), self.visual.weights[group, 0]])
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
