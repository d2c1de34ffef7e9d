# SPDX-License-Identifier: Apache-2.0
"""The front end alone over a whole recording, with its summary.

A plain loop rather than an `ObservationStream`: it needs neither IMU nor calibration, no estimator runs in
parallel, and it measures the time of the front end only.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.errors import RecordingError
from asyneio.evaluation.tracks import Tracks, group_tracks
from asyneio.frontend import Frontend, FrontendStatistics, gyroscope_in_camera
from asyneio.pipeline.packets import check_length
from asyneio.progress import ProgressCallback
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, OBSERVATION_DTYPE, EventRecording, IntArray, RecordArray

#: Length of a packet: short enough for a smooth progress bar, long enough for negligible overhead.
PACKET_NS = 10_000_000


@dataclass(frozen=True)
class TrackRun:
    """Result of the front end on one recording.

    `observations`: OBSERVATION_DTYPE in the camera clock, ascending; `alive` (K,): features alive after each
    of K packets; `seconds`: time in the front end; `compile_s`: time of compilation before that;
    `gyroscope`: whether one was used.
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
    progress: ProgressCallback | None = None,
) -> TrackRun:
    """Run the front end over all events.

    Args:
        recording: with at least one event.
        config: settings of the front end.
        use_gyroscope: pass the gyroscope to the front end, if the recording has one and a calibration.
        progress: called with the share of the recording that is done.

    Raises:
        RecordingError: the recording contains no events or is longer than a week.
    """
    events = recording.events
    if not events.size:
        raise RecordingError(f"{recording.name} contains no events; expected at least one")
    gyroscope = gyroscope_in_camera(recording) if use_gyroscope else np.empty(0, dtype=INERTIAL_DTYPE)
    first_ns, last_ns = check_length(recording.name, int(events["t_ns"][0]), int(events["t_ns"][-1]))
    edges_ns = np.arange(first_ns, last_ns + PACKET_NS + 1, PACKET_NS)
    compile_s = _seconds_of_first_call(recording, config)
    frontend = Frontend(config, recording.width, recording.height)
    pieces = [np.empty(0, dtype=OBSERVATION_DTYPE)]
    alive = np.zeros(edges_ns.size - 1, dtype=np.int64)
    seconds = 0.0
    for k, (packet, rotation) in enumerate(_packets(events, gyroscope, edges_ns)):
        started = time.perf_counter()
        pieces.append(frontend.process(packet, rotation))
        seconds += time.perf_counter() - started
        alive[k] = frontend.statistics().alive
        if progress and k % 10 == 0:
            progress(k / edges_ns.size)
    found = np.concatenate(pieces)
    found = found[np.lexsort((found["id"], found["t_ns"]))]
    used = gyroscope.size > 0
    return TrackRun(config.tracker, found, alive, frontend.statistics(), seconds, compile_s, used)


def _seconds_of_first_call(recording: EventRecording, config: FrontendConfig) -> float:
    """Compile the kernels, or load them from the cache, with one event; the seconds it took."""
    started = time.perf_counter()
    Frontend(config, recording.width, recording.height).process(np.array(recording.events[:1]))
    return time.perf_counter() - started


def _packets(
    events: RecordArray, gyroscope: RecordArray, edges_ns: IntArray
) -> Iterator[tuple[RecordArray, RecordArray | None]]:
    """Events and gyroscope samples of each packet between edges (N+1,); None without a gyroscope."""
    cuts = np.searchsorted(events["t_ns"], edges_ns)
    samples = np.searchsorted(gyroscope["t_ns"], edges_ns)
    for k in range(edges_ns.size - 1):
        # A copy, because events may be a memory map: reading it is not part of the front end's time.
        packet = np.array(events[cuts[k] : cuts[k + 1]])
        yield packet, gyroscope[samples[k] : samples[k + 1]] if gyroscope.size else None


def summarize_tracks(recording: EventRecording, run: TrackRun) -> dict[str, Any]:
    """Summary as plain values for JSON. Track lives `life_s` in seconds, None without tracks."""
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
