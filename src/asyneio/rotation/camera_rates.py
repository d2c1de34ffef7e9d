# SPDX-License-Identifier: Apache-2.0
"""Angular velocity of the camera over many short windows, from events or from feature tracks.

The rates are in the camera frame and need neither poses nor extrinsics; they are compared with a gyroscope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.geometry.camera import CameraModel
from asyneio.progress import ProgressCallback
from asyneio.rotation.epipolar import Pairs
from asyneio.rotation.sharpness import find_rate
from asyneio.types import NS_PER_S, BoolArray, CameraIntrinsics, FloatArray, IntArray, RecordArray

#: Maximum number of windows: those with the fastest rotation. The precision grows with the square root of
#: their number, the computing time with their number.
_MAX_WINDOWS = 64
#: A window ends when the gyroscope has rotated by this angle [rad], about ten pixels, within these limits of
#: its length [s].
_TURN, _SHORTEST_S, _LONGEST_S = 0.05, 0.006, 0.25
#: Minimum number of events of a window, and the number beyond which events are subsampled.
_LEAST_EVENTS, _MOST_EVENTS = 500, 8000
#: Minimum gain of sharpness by the best rotation; below it the window contains noise or another motion.
_LEAST_GAIN = 0.01

#: Length of the windows for tracks, and minimum number of tracks in one.
_TRACK_WINDOW_NS = 100_000_000
_LEAST_TRACKS = 6
#: Length of the windows for pairs of bearings (shorter ones contain mostly noise): shortest and longest [ns],
#: and their number if it is between these. Then the minimum number of pairs.
_PAIR_WINDOW_NS, _PAIR_WINDOWS = (125_000_000, 250_000_000), 16
_LEAST_PAIRS = 10
#: Longest time between two observations of a track that are interpolated [ns].
_LONGEST_STEP_NS = 60_000_000
_ROBUST_STEPS = 5


@dataclass(frozen=True)
class CameraRates:
    """Angular velocities of the camera over windows.

    Attributes:
        start_ns, end_ns: (N,) beginning and end of the windows [ns, camera clock].
        omega: (N,3) mean angular velocity in the camera frame [rad/s].
    """

    start_ns: IntArray
    end_ns: IntArray
    omega: FloatArray

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.omega)


def rates_from_events(
    excerpts: list[RecordArray],
    camera: CameraIntrinsics,
    gyroscope: RecordArray,
    progress: ProgressCallback | None = None,
) -> CameraRates:
    """Rates that give the sharpest image of each excerpt (EVENT_DTYPE, ascending, inside the sensor).

    Args:
        excerpts: parts of the events.
        camera: intrinsics.
        gyroscope: samples (INERTIAL_DTYPE), ascending, camera clock; only the magnitude is used.
        progress: called with the fraction done, 0 to 1.
    """
    model = CameraModel(camera)
    rates = [_mean_rate(gyroscope, excerpt) for excerpt in excerpts]
    fastest = sorted(range(len(excerpts)), key=lambda k: -rates[k])[:_MAX_WINDOWS]
    rows: list[tuple[int, int, FloatArray]] = []
    for done, k in enumerate(sorted(fastest)):
        if progress is not None:
            progress(done / len(fastest))
        span_ns = round(NS_PER_S * np.clip(_TURN / max(rates[k], 1e-3), _SHORTEST_S, _LONGEST_S))
        t_ns = excerpts[k]["t_ns"]
        events = excerpts[k][: int(np.searchsorted(t_ns, t_ns[0] + span_ns))]
        events = events[:: max(1, -(-events.size // _MOST_EVENTS))]
        if events.size < _LEAST_EVENTS or rates[k] == 0.0:
            continue
        uv = np.stack([events["x"], events["y"]], axis=1).astype(np.float64)
        xy, _, valid = model.undistort(uv)
        events, xy = events[valid], xy[valid]
        if events.size < _LEAST_EVENTS:
            continue
        t_s = (events["t_ns"] - events["t_ns"][0]) / NS_PER_S
        omega, gain = find_rate(xy, t_s, rates[k], camera.fx)
        if gain > _LEAST_GAIN:
            rows.append((int(events["t_ns"][0]), int(events["t_ns"][-1]), omega))
    return _joined(rows)


def rates_from_tracks(observations: RecordArray, camera: CameraIntrinsics) -> CameraRates:
    """Rates by robust least squares from the image motion of tracks (OBSERVATION_DTYPE, ascending).

    A static point moves on the normalised plane by `[x y w_x - (1 + x^2) w_y + y w_z,
    (1 + y^2) w_x - x y w_y - x w_z]`, plus a part due to translation, which the robust cost partly rejects.
    """
    xy, _, valid = CameraModel(camera).undistort(np.stack([observations["u"], observations["v"]], axis=1))
    rows: list[tuple[int, int, FloatArray]] = []
    t_ns = observations["t_ns"]
    # Only windows with observations: timestamps may be years apart.
    edges = t_ns[0] + np.unique((t_ns - t_ns[0]) // _TRACK_WINDOW_NS) * _TRACK_WINDOW_NS
    for start_ns, a, b in zip(
        edges.tolist(),
        np.searchsorted(t_ns, edges).tolist(),
        np.searchsorted(t_ns, edges + _TRACK_WINDOW_NS).tolist(),
        strict=True,
    ):
        keep = np.flatnonzero(valid[a:b]) + a
        middle, motion = _track_motion(observations["id"][keep], t_ns[keep] - start_ns, xy[keep])
        if len(middle) >= _LEAST_TRACKS:
            rows.append((int(t_ns[keep].min()), int(t_ns[keep].max()), _rate_of(middle, motion)))
    return _joined(rows)


def pairs_from_tracks(observations: RecordArray, camera: CameraIntrinsics) -> tuple[Pairs, CameraRates]:
    """Bearings of tracks at both ends of windows, and the windows (with zero rates).

    Tracks that are not observed at the same times are interpolated linearly.
    """
    xy, _, valid = CameraModel(camera).undistort(np.stack([observations["u"], observations["v"]], axis=1))
    tracks = _Tracks(observations["id"][valid], observations["t_ns"][valid], xy[valid])
    t_ns = observations["t_ns"][valid]
    window_ns = int(np.clip((t_ns[-1] - t_ns[0]) // _PAIR_WINDOWS, *_PAIR_WINDOW_NS))
    numbers = np.unique((t_ns - t_ns[0]) // window_ns)
    starts = t_ns[0] + numbers[:: max(1, -(-numbers.size // _MAX_WINDOWS))] * window_ns
    ends: list[tuple[int, int]] = []
    parts: list[tuple[FloatArray, FloatArray]] = []
    for a, b in zip(*(np.searchsorted(t_ns, starts + d) for d in (0, window_ns)), strict=True):
        if b - a < _LEAST_PAIRS or t_ns[b - 1] == t_ns[a]:
            continue
        candidates = np.unique(tracks.ids_between(a, b))
        (first, begun), (last, ended) = (tracks.at(candidates, int(t)) for t in (t_ns[a], t_ns[b - 1]))
        both = begun & ended
        if np.count_nonzero(both) >= _LEAST_PAIRS:
            ends.append((int(t_ns[a]), int(t_ns[b - 1])))
            parts.append((first[both], last[both]))
    start_ns, end_ns = np.array(ends, dtype=np.int64).reshape(-1, 2).T
    times = CameraRates(start_ns, end_ns, np.zeros((len(ends), 3)))
    window = np.repeat(np.arange(len(parts)), [len(first) for first, _ in parts])
    stacked = [np.concatenate([np.zeros((0, 2)), *side]) for side in zip(*parts, strict=True)] or 2 * [xy[:0]]
    return Pairs(window, stacked[0], stacked[1], (times.end_ns - times.start_ns) / NS_PER_S), times


class _Tracks:
    """Tracks that can be interpolated: ids (N,), ascending times (N,) [ns] and positions (N,2)."""

    def __init__(self, ids: IntArray, t_ns: IntArray, xy: FloatArray) -> None:
        self._ids = ids
        order = np.lexsort((t_ns, ids))
        self._t_ns, self._xy = t_ns[order], xy[order]
        self._known, self._begin = np.unique(ids[order], return_index=True)
        self._end = np.append(self._begin[1:], len(ids))

    def ids_between(self, first: int, last: int) -> IntArray:
        """Ids of the observations `first` to `last` (exclusive), in the order of time."""
        return self._ids[first:last]

    def at(self, ids: IntArray, t_ns: int) -> tuple[FloatArray, BoolArray]:
        """Positions (M,2) of tracks (M,) at a time, and which ones are observed until and from then on."""
        xy, seen = np.zeros((len(ids), 2)), np.zeros(len(ids), dtype=np.bool_)
        for k, track in enumerate(np.searchsorted(self._known, ids).tolist()):
            begin, end = self._begin[track], self._end[track]
            j = begin + int(np.searchsorted(self._t_ns[begin:end], t_ns))
            if j == end or (j == begin and self._t_ns[j] != t_ns):
                continue
            i = j if self._t_ns[j] == t_ns else j - 1
            gap_ns = int(self._t_ns[j] - self._t_ns[i])
            if gap_ns <= _LONGEST_STEP_NS:
                share = (t_ns - int(self._t_ns[i])) / gap_ns if gap_ns else 0.0
                xy[k], seen[k] = self._xy[i] + share * (self._xy[j] - self._xy[i]), True
        return xy, seen


def _joined(rows: list[tuple[int, int, FloatArray]]) -> CameraRates:
    starts, ends, omegas = zip(*rows, strict=True) if rows else ((), (), ())
    return CameraRates(
        np.array(starts, dtype=np.int64), np.array(ends, dtype=np.int64), np.reshape(omegas, (-1, 3))
    )


def _mean_rate(gyroscope: RecordArray, events: RecordArray) -> float:
    """Magnitude of the mean reading over the first part of an excerpt; 0 without samples."""
    start_ns = int(events["t_ns"][0])
    end_ns = max(int(events["t_ns"][-1]), start_ns + round(_SHORTEST_S * NS_PER_S))
    a, b = np.searchsorted(gyroscope["t_ns"], [start_ns, end_ns])
    return float(np.linalg.norm(gyroscope["xyz"][a:b].mean(axis=0))) if b > a else 0.0


def _track_motion(ids: IntArray, t_ns: IntArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean position (N,2) and velocity (N,2) [1/s], first to last, of tracks with at least two times."""
    order = np.lexsort((t_ns, ids))
    ids, t_s, xy = ids[order], t_ns[order] / NS_PER_S, xy[order]
    first = np.flatnonzero(np.concatenate([[True], ids[1:] != ids[:-1]])) if ids.size else np.zeros(0, int)
    last = np.concatenate([first[1:], [ids.size]]).astype(int) - 1
    spans = t_s[last] - t_s[first] if ids.size else np.zeros(0)
    first, last, spans = first[spans > 0.0], last[spans > 0.0], spans[spans > 0.0]
    return 0.5 * (xy[first] + xy[last]), (xy[last] - xy[first]) / spans[:, None]


def _rate_of(xy: FloatArray, motion: FloatArray) -> FloatArray:
    """Angular velocity (3,) that explains the motion (N,2) of points (N,2), by reweighted least squares."""
    x, y = xy[:, 0], xy[:, 1]
    rows = np.empty((len(xy), 2, 3))
    rows[:, 0] = np.stack([x * y, -(1.0 + x**2), y], axis=1)
    rows[:, 1] = np.stack([1.0 + y**2, -x * y, -x], axis=1)
    weight = np.ones(len(xy))
    omega: FloatArray = np.zeros(3)
    for _ in range(_ROBUST_STEPS):
        root = np.sqrt(weight)[:, None]
        system = (rows * root[:, :, None]).reshape(-1, 3)
        omega = np.asarray(np.linalg.lstsq(system, (motion * root).reshape(-1), rcond=None)[0])
        error = np.linalg.norm(motion - rows @ omega, axis=1)
        weight = 1.0 / (1.0 + (error / max(float(np.median(error)), 1e-9)) ** 2)
    return np.asarray(omega)
