# SPDX-License-Identifier: Apache-2.0
"""The window's landmarks: initialization from a track and the trajectory, lookup by track, removal."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from asyneio.estimation.problem.problem import Landmarks, Propagated, States, bearing_tangent
from asyneio.estimation.problem.propagated_queries import increment_at, knot_at
from asyneio.factors.preintegration import propagated_pose
from asyneio.geometry.linalg import matmul, matvec
from asyneio.geometry.triangulation import triangulate_inverse_depth
from asyneio.jit import njit
from asyneio.trajectory.interpolation import interval_local, query_pose
from asyneio.types import BoolArray, FloatArray, IntArray


@dataclass
class LandmarkTable:
    """Landmarks sorted by track id; `anchor` holds absolute knot numbers."""

    track: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    anchor: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    kappa: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    rho: FloatArray = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.track)

    def index_of(self, track: IntArray) -> IntArray:
        """Index of each track's landmark, -1 if it has none."""
        if len(self.track) == 0:
            return np.full(len(track), -1)
        at = np.minimum(np.searchsorted(self.track, track), len(self.track) - 1)
        return np.where(self.track[at] == track, at, -1)

    def add(self, track: IntArray, anchor: IntArray, kappa: FloatArray, rho: FloatArray) -> None:
        """Add landmarks for tracks that have none."""
        order = np.argsort(np.concatenate([self.track, track]), kind="stable")
        self.track = np.concatenate([self.track, track])[order]
        self.anchor = np.concatenate([self.anchor, anchor])[order]
        self.kappa = np.concatenate([self.kappa, kappa])[order]
        self.rho = np.concatenate([self.rho, rho])[order]

    def keep(self, mask: BoolArray) -> None:
        """Drop the landmarks outside `mask`."""
        self.track = self.track[mask]
        self.anchor = self.anchor[mask]
        self.kappa = self.kappa[mask]
        self.rho = self.rho[mask]

    def arrays(self, first: int) -> Landmarks:
        """Arrays for the optimiser, anchors relative to knot `first`."""
        return Landmarks(self.anchor - first, self.kappa, bearing_tangent(self.kappa), self.rho)


@njit(cache=True, nogil=True)
def _camera_of(
    C: FloatArray, r: FloatArray, C_bc: FloatArray, r_bc: FloatArray, C_out: FloatArray, r_out: FloatArray
) -> None:
    """Camera pose in the world of a body pose."""
    matmul(C, C_bc, C_out)
    matvec(C, r_bc, r_out)
    for k in range(3):
        r_out[k] += r[k]


@njit(cache=True, nogil=True)
def camera_poses(
    states: States,
    interval: IntArray,
    weights: FloatArray,
    C_bc: FloatArray,
    r_bc: FloatArray,
    space: int,
    C_out: FloatArray,
    r_out: FloatArray,
) -> None:
    """Camera poses in the world (N,3,3), (N,3) at query times given by interval and weights (N,5)."""
    local = np.empty((5, 6))
    C = np.empty((3, 3))
    r = np.empty(3)
    last = -1
    for n in range(interval.shape[0]):
        i = interval[n]
        if i != last:
            interval_local(
                states.C[i],
                states.r[i],
                states.varpi[i],
                states.C[i + 1],
                states.r[i + 1],
                states.varpi[i + 1],
                space,
                local,
            )
            last = i
        query_pose(states.C[i], states.r[i], local, weights[n], space, C, r)
        _camera_of(C, r, C_bc, r_bc, C_out[n], r_out[n])


@njit(cache=True, nogil=True)
def propagated_camera_poses(
    states: States,
    interval: IntArray,
    increments: Propagated,
    bias_ref: FloatArray,
    gravity_w: FloatArray,
    C_bc: FloatArray,
    r_bc: FloatArray,
    C_out: FloatArray,
    r_out: FloatArray,
) -> None:
    """As `camera_poses`, from increments (N) since the knots `interval`, computed with `bias_ref` (K,6)."""
    C = np.empty((3, 3))
    r = np.empty(3)
    for n in range(interval.shape[0]):
        i = interval[n]
        propagated_pose(knot_at(states, i), increment_at(increments, bias_ref[i], n), gravity_w, C, r)
        _camera_of(C, r, C_bc, r_bc, C_out[n], r_out[n])


@njit(cache=True, nogil=True)
def _born_landmark(
    C_wc: FloatArray,
    r_wc: FloatArray,
    direction: FloatArray,
    reference: int,
    C_anchor: FloatArray,
    r_anchor: FloatArray,
    default_rho: float,
    bearing_sigma: float,
    kappa: FloatArray,
) -> float:
    """Inverse depth (returned) and bearing `kappa` (3,) at the anchor camera, of a track's first
    observations.

    The bearing is that of observation `reference`, transferred to the anchor with its triangulated depth, or
    with the default depth if there is no parallax (depth uncertain by more than its own size). It is never
    behind the anchor.
    """
    rho, information = triangulate_inverse_depth(
        C_wc, r_wc, direction, C_wc[reference], r_wc[reference], direction[reference]
    )
    sigma = bearing_sigma / np.sqrt(information) if information > 0.0 else np.inf
    if rho < 2.0 * sigma:
        rho = default_rho
    scaled_w = np.empty(3)
    matvec(C_wc[reference], direction[reference], scaled_w)
    norm = 0.0
    for i in range(3):
        kappa[i] = 0.0
        for j in range(3):
            kappa[i] += C_anchor[j, i] * (scaled_w[j] + rho * (r_wc[reference, j] - r_anchor[j]))
        norm += kappa[i] ** 2
    norm = np.sqrt(norm)
    for i in range(3):
        kappa[i] /= norm
    return rho / norm


@njit(cache=True, nogil=True)
def initialize_landmarks(
    C_wc: FloatArray,
    r_wc: FloatArray,
    direction: FloatArray,
    counts: IntArray,
    default_rho: float,
    bearing_sigma: float,
    kappa: FloatArray,
    rho: FloatArray,
) -> None:
    """Bearings `kappa` (G,3) and inverse depths `rho` (G,) of G tracks with `counts` (G,) observations each.

    `direction` (N,3) are unit bearings of all observations, `C_wc`, `r_wc` (N+G) their cameras; the camera at
    a track's anchor precedes those of its observations.
    """
    seen = 0
    for g in range(counts.shape[0]):
        a, n = seen + g, counts[g]
        rho[g] = _born_landmark(
            C_wc[a + 1 : a + 1 + n],
            r_wc[a + 1 : a + 1 + n],
            direction[seen : seen + n],
            0,
            C_wc[a],
            r_wc[a],
            default_rho,
            bearing_sigma,
            kappa[g],
        )
        seen += n
