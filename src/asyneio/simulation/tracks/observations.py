# SPDX-License-Identifier: Apache-2.0
"""Asynchronous feature tracks: every feature is observed at its own times, as by an event tracker.

Each of a fixed number of slots holds one live track. A track follows one landmark for a random lifetime or
until the landmark leaves the image; another landmark with a new id then takes its slot. A track is observed
about once per `spacing_px` of its image motion, within limits of the time between two observations. Some of
the slots may prefer points of a moving object. Occlusion is not simulated here, but in the event simulator.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.camera import BoolArray, PinholeCamera
from asyneio.simulation.motion import Motion
from asyneio.simulation.moving import MovingObject
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Lattice for visibility and image speed [s]; observation times are not restricted to it.
_LATTICE_S = 0.004
#: Number of landmarks tried first for a new track; if none of them is visible, all are tried.
_TRIALS = 300
#: Time until an empty slot searches for a landmark again [s].
_RETRY_S = 0.02


@dataclass(frozen=True)
class TrackSpec:
    """Parameters of tracks; times in seconds, lengths in pixels.

    Lifetimes are exponentially distributed with the mean `mean_life_s`, clipped at `max_life_s`. The spacing
    between observations is jittered by up to the fraction `jitter` of itself, and within [`min_spacing_s`,
    `max_spacing_s`]. `outlier_fraction` of all observations are displaced by 5 to 25 px. `moving_share` of
    the live tracks are on a moving object while it is in view, otherwise on the scene.
    """

    features_alive: int = 60
    mean_life_s: float = 0.6
    max_life_s: float = 2.0
    spacing_px: float = 0.7
    min_spacing_s: float = 0.005
    max_spacing_s: float = 0.05
    jitter: float = 0.3
    margin_px: float = 8.0
    pixel_sigma: float = 0.5
    outlier_fraction: float = 0.0
    moving_share: float = 0.0

    def __post_init__(self) -> None:
        positive = min(self.features_alive, self.mean_life_s, self.max_life_s, self.spacing_px)
        if positive <= 0 or not 0.0 < self.min_spacing_s <= self.max_spacing_s:
            raise SimulationError(
                f"{self} cannot be simulated; expected positive features_alive, lives and spacing_px, "
                "and 0 < min_spacing_s <= max_spacing_s"
            )
        ratio = self.min_spacing_s / self.max_spacing_s
        if not 0.0 <= self.jitter < 1.0 or (1.0 - self.jitter) / (1.0 + self.jitter) < ratio:
            raise SimulationError(
                f"jitter = {self.jitter} does not fit between min_spacing_s = {self.min_spacing_s} and "
                f"max_spacing_s = {self.max_spacing_s}; "
                f"expected 0 <= jitter <= {(1 - ratio) / (1 + ratio):.2f}"
            )
        if not 0.0 <= self.outlier_fraction <= 1.0 or self.pixel_sigma < 0.0:
            raise SimulationError(
                f"outlier_fraction = {self.outlier_fraction}, pixel_sigma = {self.pixel_sigma}; "
                "expected 0 <= outlier_fraction <= 1 and pixel_sigma >= 0"
            )
        if not 0.0 <= self.moving_share <= 1.0:
            raise SimulationError(f"moving_share = {self.moving_share}; expected 0 to 1")


@dataclass(frozen=True)
class Tracks:
    """Observations in time order: `t_ns` (M,) since the start, `track` (M,) ids, `pixels` (M,2).

    `outlier` (M,) is true for displaced observations. `landmark_of_track` (K,) is the landmark of each track
    id 0..K-1, with the indices of `Viewer`.
    """

    t_ns: IntArray
    track: IntArray
    pixels: FloatArray
    outlier: BoolArray
    landmark_of_track: IntArray


@dataclass(frozen=True)
class Viewer:
    """A camera on a moving body in a scene: `T_b_c` (4,4), `landmarks_w` (L,3) [m].

    Landmark indices 0..L-1 are those of the scene; indices from L on are the points of the `moving` object.
    """

    motion: Motion
    camera: PinholeCamera
    T_b_c: FloatArray
    landmarks_w: FloatArray
    moving: MovingObject | None = None

    def T_w_c(self, t_s: FloatArray) -> FloatArray:
        """Camera poses (N,4,4) at times (N,) [s]."""
        return self.motion.T_w_b(t_s) @ self.T_b_c

    def positions_w(self, landmark: IntArray, t_s: FloatArray) -> FloatArray:
        """World positions (N,3) [m] of landmarks (N,) at times (N,), or all at one time (1,) [s]."""
        still = len(self.landmarks_w)
        if self.moving is None or not np.any(landmark >= still):
            return self.landmarks_w[landmark]
        on_object = landmark >= still
        positions = self.landmarks_w[np.where(on_object, 0, landmark)]
        t_s = np.broadcast_to(t_s, landmark.shape)[on_object]
        positions[on_object] = self.moving.positions_w(t_s, self.moving.points_o[landmark[on_object] - still])
        return positions


def simulate_tracks(
    viewer: Viewer, spec: TrackSpec, start_s: float, end_s: float, rng: np.random.Generator
) -> Tracks:
    """Simulate tracks between two times since the start of the motion [s].

    Raises:
        SimulationError: the interval is empty, or no landmark is ever visible.
    """
    if end_s <= start_s + 2.0 * _LATTICE_S:
        raise SimulationError(f"tracks from {start_s} s to {end_s} s; expected an end after the start")
    lattice_s = np.arange(start_s, end_s, _LATTICE_S)
    T_w_c = viewer.T_w_c(lattice_s)
    times: list[FloatArray] = []
    landmarks: list[int] = []
    for landmark, t_s in _lives(viewer, spec, lattice_s, T_w_c, rng):
        if t_s.size:
            times.append(t_s)
            landmarks.append(landmark)
    if not times:
        raise SimulationError(
            f"none of {len(viewer.landmarks_w)} landmarks is visible between {start_s} s and {end_s} s; "
            "expected a camera that looks at the scene: check T_b_c, the scene and the motion"
        )
    return _observe(viewer, spec, times, np.array(landmarks, dtype=np.int64), rng)


def _lives(
    viewer: Viewer, spec: TrackSpec, lattice_s: FloatArray, T_w_c: FloatArray, rng: np.random.Generator
) -> Iterator[tuple[int, FloatArray]]:
    """Landmark and observation times [s] of each track, in order of birth."""
    still = len(viewer.landmarks_w)
    free = np.ones(still + (len(viewer.moving.points_o) if viewer.moving else 0), dtype=bool)
    on_object = round(spec.moving_share * spec.features_alive)
    # (lattice index of the next birth, slot, landmark that the slot releases then)
    queue = [(0, slot, -1) for slot in range(spec.features_alive)]
    while queue:
        birth, slot, finished = heapq.heappop(queue)
        if finished >= 0:
            free[finished] = True
        if birth >= lattice_s.size - 1:
            continue
        now_s, T_now = lattice_s[birth : birth + 1], T_w_c[birth]
        landmark = -1
        if slot < on_object:
            candidates = still + np.flatnonzero(free[still:])
            landmark = _pick_visible(viewer, spec, now_s, T_now, candidates, rng)
        if landmark < 0:
            landmark = _pick_visible(viewer, spec, now_s, T_now, np.flatnonzero(free[:still]), rng)
        if landmark < 0:
            heapq.heappush(queue, (birth + round(_RETRY_S / _LATTICE_S), slot, -1))
            continue
        free[landmark] = False
        life_s = min(rng.exponential(spec.mean_life_s), spec.max_life_s)
        until = min(birth + 1 + max(1, round(life_s / _LATTICE_S)), lattice_s.size)
        positions_w = viewer.positions_w(np.full(until - birth, landmark), lattice_s[birth:until])
        pixels, seen = viewer.camera.visible(_to_camera(positions_w, T_w_c[birth:until]), spec.margin_px)
        alive = seen.size if seen.all() else int(np.argmin(seen))
        heapq.heappush(queue, (birth + max(1, alive - 1), slot, landmark))
        yield landmark, _observation_times(lattice_s[birth : birth + alive], pixels[:alive], spec, rng)


def _pick_visible(
    viewer: Viewer,
    spec: TrackSpec,
    now_s: FloatArray,
    T_w_c: FloatArray,
    free: IntArray,
    rng: np.random.Generator,
) -> int:
    """A random one of the landmarks `free` (indices) that a camera at `T_w_c` (4,4) sees; -1 for none.

    `now_s` (1,) is the time [s].
    """
    shuffled = free[rng.permutation(free.size)]
    for some in (shuffled[:_TRIALS], shuffled[_TRIALS:]):
        positions_w = viewer.positions_w(some, now_s)
        _, seen = viewer.camera.visible(_to_camera(positions_w, T_w_c), spec.margin_px)
        if seen.any():
            return int(some[np.argmax(seen)])
    return -1


def _to_camera(points_w: FloatArray, T_w_c: FloatArray) -> FloatArray:
    """Points (N,3) of the world in one or many camera frames (4,4) or (N,4,4): (N,3)."""
    offset = points_w - T_w_c[..., :3, 3]
    return np.einsum("...ji,...j->...i", T_w_c[..., :3, :3], offset)


def _observation_times(
    t_s: FloatArray, pixels: FloatArray, spec: TrackSpec, rng: np.random.Generator
) -> FloatArray:
    """Times [s] at which a feature with the path `pixels` (N,2) at `t_s` (N,) is observed.

    Observations occur when an integrated rate crosses jittered steps. The rate is bounded so that the
    shortest and the longest step respect the limits of the spacing.
    """
    if t_s.size < 2:
        return np.empty(0)
    dt = np.diff(t_s)
    speed = np.linalg.norm(np.diff(pixels, axis=0), axis=1) / dt
    slowest = (1.0 + spec.jitter) / spec.max_spacing_s
    fastest = (1.0 - spec.jitter) / spec.min_spacing_s
    rate = np.clip(speed / spec.spacing_px, slowest, fastest)
    progress = np.concatenate([[0.0], np.cumsum(rate * dt)])
    most = int(progress[-1] / (1.0 - spec.jitter)) + 1
    steps = rng.uniform(1.0 - spec.jitter, 1.0 + spec.jitter, most)
    marks = np.cumsum(np.concatenate([[rng.uniform()], steps]))
    return np.interp(marks[marks < progress[-1]], progress, t_s)


def _observe(
    viewer: Viewer,
    spec: TrackSpec,
    times: list[FloatArray],
    landmarks: IntArray,
    rng: np.random.Generator,
) -> Tracks:
    """Exact projections at the observation times, in time order, with noise and outliers."""
    track = np.repeat(np.arange(len(times)), [t.size for t in times])
    t_ns = np.rint(np.concatenate(times) * NS_PER_S).astype(np.int64)
    order = np.argsort(t_ns, kind="stable")
    t_ns, track = t_ns[order], track[order]
    t_s = t_ns / NS_PER_S
    positions_w = viewer.positions_w(landmarks[track], t_s)
    pixels, _ = viewer.camera.project(_to_camera(positions_w, viewer.T_w_c(t_s)))
    pixels = pixels + spec.pixel_sigma * rng.normal(size=pixels.shape)
    outlier = rng.random(t_ns.size) < spec.outlier_fraction
    angle = rng.uniform(0.0, 2.0 * np.pi, t_ns.size)
    length = np.where(outlier, rng.uniform(5.0, 25.0, t_ns.size), 0.0)
    pixels += length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return Tracks(t_ns, track.astype(np.int64), pixels, outlier, landmarks)
