"""The front end alone over a whole recording, and the figures of what it found."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.evaluation.tracks import Tracks, group_tracks
from asyneio.frontend import Frontend, FrontendStatistics, gyroscope_in_camera
from asyneio.pipeline.packets import check_length
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, OBSERVATION_DTYPE, EventRecording, IntArray, RecordArray

#: What the front end is given at a time: short enough for a smooth progress bar, long enough to cost nothing.
PACKET_NS = 10_000_000


@dataclass(frozen=True)
class TrackRun:
    """What the front end made of a recording.

    `observations` OBSERVATION_DTYPE in the camera clock, ascending; `alive` (K,): features tracked after each
    of K packets; `seconds` spent in the front end, `compile_s` for compiling before that; `gyroscope`:
    whether one was used.
    """

    tracker: str
    observations: RecordArray
    alive: IntArray
    statistics: FrontendStatistics
    seconds: float
    compile_s: float
    gyroscope: bool


def track_recording(
    recording: EventRecording,
    config: FrontendConfig,
    use_gyroscope: bool = True,
    advance: Callable[[float], None] | None = None,
) -> TrackRun:
    """Run the front end over all events.

    Args:
        recording: with at least one event.
        config: the section `frontend`.
        use_gyroscope: give it the gyroscope, where the recording has one and a calibration.
        advance: is told the share done, 0 to 1.

    Raises:
        RecordingError: the events last for weeks.
    """
    events = recording.events
    gyroscope = gyroscope_in_camera(recording) if use_gyroscope else np.empty(0, dtype=INERTIAL_DTYPE)
    first_ns, last_ns = check_length(recording.name, int(events["t_ns"][0]), int(events["t_ns"][-1]))
    edges_ns = np.arange(first_ns, last_ns + PACKET_NS + 1, PACKET_NS)
    cuts = np.searchsorted(events["t_ns"], edges_ns)
    samples = np.searchsorted(gyroscope["t_ns"], edges_ns)
    started = time.perf_counter()
    Frontend(config, recording.width, recording.height).process(np.array(events[:1]))
    compile_s = time.perf_counter() - started
    frontend = Frontend(config, recording.width, recording.height)
    pieces = [np.empty(0, dtype=OBSERVATION_DTYPE)]
    alive = np.zeros(edges_ns.size - 1, dtype=np.int64)
    seconds = 0.0
    for k in range(edges_ns.size - 1):
        # A copy: events may be a memory map, and reading it is not the front end's time.
        packet = np.array(events[cuts[k] : cuts[k + 1]])
        turning = gyroscope[samples[k] : samples[k + 1]] if gyroscope.size else None
        started = time.perf_counter()
        pieces.append(frontend.process(packet, turning))
        seconds += time.perf_counter() - started
        alive[k] = frontend.statistics().alive
        if advance and k % 10 == 0:
            advance(k / edges_ns.size)
    observations = np.concatenate(pieces)
    return TrackRun(
        config.tracker,
        observations[np.lexsort((observations["id"], observations["t_ns"]))],
        alive,
        frontend.statistics(),
        seconds,
        compile_s,
        gyroscope.size > 0,
    )


def summarize_tracks(recording: EventRecording, run: TrackRun) -> dict[str, Any]:
    """The figures of a run as plain values for JSON; lives in seconds, None where there is no track."""
    t_ns = recording.events["t_ns"]
    first_ns, last_ns, count = int(t_ns[0]), int(t_ns[-1]), int(t_ns.size)
    duration_s = max(last_ns - first_ns, 1) / NS_PER_S
    tracks = group_tracks(run.observations)
    return {
        "recording": recording.name,
        "tracker": run.tracker,
        "gyroscope_used": run.gyroscope,
        "duration_s": duration_s,
        "events": count,
        "event_rate_mev_s": count / duration_s / 1e6,
        "processing_s": run.seconds,
        "speed_mev_s": count / run.seconds / 1e6,
        "ns_per_event": run.seconds / count * 1e9,
        "real_time_factor": duration_s / run.seconds,
        "compile_s": run.compile_s,
        "tracks": int(tracks.first.size),
        "observations": int(run.observations.size),
        "observations_per_s": run.observations.size / duration_s,
        "life_s": _quantiles(tracks),
        "alive": {
            "tenth_percentile": float(np.percentile(run.alive, 10.0)),
            "median": float(np.median(run.alive)),
        },
        "statistics": asdict(run.statistics),
        "notes": list(recording.notes),
    }


def _quantiles(tracks: Tracks) -> dict[str, float | None]:
    names = {"quartile": 25.0, "median": 50.0, "upper_quartile": 75.0, "longest": 100.0}
    if not tracks.first.size:
        return dict.fromkeys(("mean", *names))
    life_s = tracks.life_s()
    return {
        "mean": float(life_s.mean()),
        **{name: float(np.percentile(life_s, share)) for name, share in names.items()},
    }
