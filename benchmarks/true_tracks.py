"""Replace parts of the input by true ones, to measure the odometry with perfect tracks."""

from __future__ import annotations

import numpy as np

from asyneio.simulation import EventSimulation
from asyneio.types import (
    NS_PER_S,
    OBSERVATION_DTYPE,
    EventRecording,
    FloatArray,
    IntArray,
    RecordArray,
    Recording,
)

#: Time between observations of a true track [ns], and its maximum lifetime.
_STEP_NS = 20_000_000
_LONGEST_NS = 2 * NS_PER_S


def true_tracks(
    simulation: EventSimulation, observations: RecordArray, noise_px: float, alive: int | None
) -> Recording:
    """The recording with true positions of the features and white noise in place of the tracked ones.

    `alive` None: at the same times. Otherwise, every feature is observed as long as it is visible, and new
    ones begin only while fewer than `alive` are live. Features on moving objects move with them.
    """
    recording = simulation.recording
    assert recording.calibration is not None
    shift_ns = recording.calibration.timeshift_ns
    order = np.lexsort((observations["t_ns"], observations["id"]))
    tracked = observations[order]
    _, first, member = np.unique(tracked["id"], return_index=True, return_inverse=True)
    births = tracked[first]
    points, surface, hit = simulation.points.hit(
        births["t_ns"] - shift_ns, np.column_stack([births["u"], births["v"]])
    )
    if alive is None:
        t_ns, owner = tracked["t_ns"][hit[member]], member[hit[member]]
        uv, visible = simulation.points.project(t_ns - shift_ns, points[owner], surface[owner])
        t_ns, owner, uv = t_ns[visible], owner[visible], uv[visible]
    else:
        last_ns = int(observations["t_ns"].max())
        t_ns, owner, uv = _full_lives(simulation, births["t_ns"], points, surface, (last_ns, shift_ns, alive))
    records = np.zeros(t_ns.size, dtype=OBSERVATION_DTYPE)
    noise = noise_px * np.random.default_rng(0).normal(size=uv.shape)
    records["t_ns"], records["id"] = t_ns, owner
    records["u"], records["v"] = (uv + noise).T
    return as_tracks(recording, records[np.argsort(records["t_ns"], kind="stable")])


def static_observations(simulation: EventSimulation, observations: RecordArray) -> RecordArray:
    """The observations of the tracks that began on static surfaces."""
    recording = simulation.recording
    assert recording.calibration is not None
    order = np.lexsort((observations["t_ns"], observations["id"]))
    ids, first = np.unique(observations["id"][order], return_index=True)
    births = observations[order][first]
    _, surface, hit = simulation.points.hit(
        births["t_ns"] - recording.calibration.timeshift_ns, np.column_stack([births["u"], births["v"]])
    )
    moving = hit & (simulation.points.world.body[np.maximum(surface, 0)] > 0)
    return observations[~np.isin(observations["id"], ids[moving])]


def _full_lives(
    simulation: EventSimulation,
    born_ns: IntArray,
    points: FloatArray,
    surface: IntArray,
    limits: tuple[int, int, int],
) -> tuple[IntArray, IntArray, FloatArray]:
    last_ns, shift_ns, alive = limits
    pieces: list[tuple[IntArray, IntArray, FloatArray]] = []
    ends: list[int] = []
    for index in np.argsort(born_ns, kind="stable").tolist():
        begin = int(born_ns[index])
        ends = [end for end in ends if end > begin]
        if surface[index] < 0 or len(ends) >= alive:
            continue
        t_ns = np.arange(begin, min(begin + _LONGEST_NS, last_ns), _STEP_NS)
        uv, visible = simulation.points.project(
            t_ns - shift_ns, np.tile(points[index], (t_ns.size, 1)), np.full(t_ns.size, surface[index])
        )
        length = int(np.argmin(visible)) if not visible.all() else t_ns.size
        if length < 3:
            continue
        pieces.append((t_ns[:length], np.full(length, index), uv[:length]))
        ends.append(int(t_ns[length - 1]))
    return tuple(np.concatenate(parts) for parts in zip(*pieces, strict=True))  # type: ignore[return-value]


def as_tracks(recording: EventRecording, observations: RecordArray) -> Recording:
    """A recording of tracks with the inertial samples of one of events."""
    assert recording.calibration is not None
    return Recording(
        recording.name,
        observations,
        recording.gyroscope,
        recording.accelerometer,
        recording.calibration,
        recording.ground_truth,
    )
