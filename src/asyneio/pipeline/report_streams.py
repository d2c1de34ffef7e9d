# SPDX-License-Identifier: Apache-2.0
"""From measurements to the data of a report: features, event rate, tracks over events, health changes."""

from __future__ import annotations

import numpy as np

from asyneio.pipeline.packets import calibration_of, event_counts
from asyneio.pipeline.summary import Transition
from asyneio.types import NS_PER_S, EventRecording, IntArray, RecordArray
from asyneio.viz import EventRate, Features, HealthChange, TrackScene
from asyneio.viz.tracks import shown_instants

#: Observations this close to a displayed instant are kept [ns]: longer than any gap within a track.
_NEAR_NS = 700_000_000


def count_features(observations: RecordArray, t_ns: IntArray, start_ns: int) -> Features:
    """Number of live tracks at each time (between first and last observation), with quartiles of their ages.

    Args:
        observations: OBSERVATION_DTYPE, any order.
        t_ns: (N,) ascending.
        start_ns: zero of the time axis [ns].
    """
    order = np.lexsort((observations["t_ns"], observations["id"]))
    ids, stamps = observations["id"][order], observations["t_ns"][order]
    heads = np.flatnonzero(np.r_[True, ids[1:] != ids[:-1]]) if ids.size else np.empty(0, dtype=np.int64)
    first, last = stamps[heads], stamps[np.r_[heads[1:], ids.size] - 1] if ids.size else stamps
    by_birth = np.argsort(first, kind="stable")
    first, last = first[by_birth], last[by_birth]
    born = np.searchsorted(first, t_ns, side="right")
    alive = np.zeros(t_ns.size, dtype=np.int64)
    age_s = np.full((t_ns.size, 3), np.nan)
    current, known = np.empty(0, dtype=np.int64), 0
    for index, now in enumerate(t_ns.tolist()):
        # Only tracks of the previous step and new ones can be alive.
        current = np.concatenate([current, np.arange(known, born[index])])
        current = current[last[current] >= now]
        known = int(born[index])
        alive[index] = current.size
        if current.size:
            age_s[index] = np.percentile(now - first[current], [25.0, 50.0, 75.0]) / NS_PER_S
    return Features((t_ns - start_ns) / NS_PER_S, alive, age_s)


def event_rate(recording: EventRecording, t_ns: IntArray, start_ns: int, interval_s: float) -> EventRate:
    """Event rate [1/s] in packets of `interval_s` that end at `t_ns` (N,) [IMU clock]."""
    counts = event_counts(recording, np.concatenate([[start_ns], t_ns]))
    rate = np.array(counts, dtype=np.float64) / interval_s
    return EventRate((t_ns - start_ns) / NS_PER_S, rate)


def track_scene(recording: EventRecording, observations: RecordArray) -> TrackScene | None:
    """Tracks over events, for `plot_tracks`; None without events or tracks.

    Args:
        recording: events in the camera clock.
        observations: OBSERVATION_DTYPE, IMU clock, ascending.
    """
    if not recording.events.size or not observations.size:
        return None
    shift_ns = calibration_of(recording).timeshift_ns
    # A long run has millions of observations; the picture needs those around its instants only.
    near = np.zeros(observations.size, dtype=np.bool_)
    for instant in shown_instants(recording.events["t_ns"]):
        around = instant + shift_ns + np.array([-_NEAR_NS, _NEAR_NS])
        near[slice(*np.searchsorted(observations["t_ns"], around))] = True
    kept = observations[near]
    if not kept.size:
        return None
    kept["t_ns"] -= shift_ns
    return TrackScene(recording.events, recording.width, recording.height, kept)


def health_changes(transitions: tuple[Transition, ...]) -> tuple[HealthChange, ...]:
    """Changes of health, for the report."""
    return tuple(HealthChange(at.t_s, str(at.health), at.segment, at.reason) for at in transitions)
