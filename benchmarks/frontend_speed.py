"""Speed of the front end on one core: events per second with 100 features, and how the time is spent.

    python benchmarks/frontend_speed.py [--trackers gradient haste] [--repeats 5] [--seconds 2] [--cache DIR]
        [--long] [--markdown FILE]

Kind of evidence: simulated events of fast motion; real excerpts repeated end to end with shifted times (all
tracks break at each repetition, which costs more than one long recording). Medians of repeated runs in one
process, after a run that compiles; reading is not included.

Stages: "filter" is a run with the fewest features (8): every event passes the surface and the filters, almost
none a corner test or a patch. The difference to the run with 100 features is detection and tracking.

`--long`: 10^8 events, with the memory of the process every 10^7.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend import Frontend
from asyneio.io.parsing.atomic import write_text
from asyneio.types import EventRecording, RecordArray
from common import table
from real_tracking import load
from sequences import DEFAULT_CACHE, sequence

EXCERPTS = (
    "ecd_excerpts/boxes_translation",
    "ecd_excerpts/dynamic_translation",
    "ecd_excerpts/shapes_rotation",
    "slider_depth",
    "dvs128/stripes.mat",
)
HEADER = [
    "events",
    "Mev",
    "rate Mev/s",
    "alive",
    "Mev/s",
    "ns per event",
    "filter ns",
    "detection, tracking ns",
]
_FEWEST = 8
_FEATURES = 100
_TARGET_MEV_S = 2.5
_PACKET_NS = 10_000_000
_LONG_EVENTS = 100_000_000
REPEATED_EVENTS = 1_000_000


@dataclass(frozen=True)
class Timing:
    """One run: seconds in the front end, median number of features alive after a packet."""

    seconds: float
    alive: float


def packets(events: RecordArray) -> list[RecordArray]:
    """Events cut every 10 ms."""
    t_ns = events["t_ns"]
    cuts = np.searchsorted(t_ns, np.arange(t_ns[0] + _PACKET_NS, t_ns[-1] + 1, _PACKET_NS))
    return [piece for piece in np.split(events, cuts) if piece.size]


def repeated(events: RecordArray, count: int) -> RecordArray:
    """At least `count` events: the same events repeated with later times."""
    times = -(-count // events.size)
    many = np.tile(events, times)
    step_ns = int(events["t_ns"][-1] - events["t_ns"][0]) + 1_000_000
    many["t_ns"] += np.repeat(np.arange(times, dtype=np.int64) * step_ns, events.size)
    return many


def timed(recording: EventRecording, pieces: list[RecordArray], config: FrontendConfig) -> Timing:
    """One run over packets."""
    frontend = Frontend(config, recording.width, recording.height)
    seconds, alive = 0.0, []
    for piece in pieces:
        started = time.perf_counter()
        frontend.process(piece)
        seconds += time.perf_counter() - started
        alive.append(frontend.statistics().alive)
    return Timing(seconds, float(np.median(alive)))


def row(name: str, recording: EventRecording, events: RecordArray, tracker: str, repeats: int) -> list[str]:
    """Speed with 100 features and with the fewest, in alternating runs."""
    pieces = packets(events)
    configs = [
        FrontendConfig.model_validate({"tracker": tracker, "max_features": n}) for n in (_FEATURES, _FEWEST)
    ]
    for config in configs:
        timed(recording, pieces[:20], config)
    runs = [[timed(recording, pieces, config) for config in configs] for _ in range(repeats)]
    whole, least = (float(np.median([run[k].seconds for run in runs])) / events.size * 1e9 for k in (0, 1))
    span_s = float(events["t_ns"][-1] - events["t_ns"][0]) * 1e-9
    return [
        name,
        f"{events.size / 1e6:.2f}",
        f"{events.size / span_s / 1e6:.2f}",
        f"{runs[0][0].alive:.0f}",
        f"{1e3 / whole:.2f}{'' if 1e3 / whole >= _TARGET_MEV_S else ' (MISSED)'}",
        f"{whole:.0f}",
        f"{least:.0f}",
        f"{whole - least:.0f}",
    ]


def long_run(recording: EventRecording, tracker: str) -> str:
    """Memory over 10^8 events: the events of a recording repeatedly, with one copy in memory."""
    config = FrontendConfig.model_validate({"tracker": tracker, "max_features": _FEATURES})
    frontend = Frontend(config, recording.width, recording.height)
    pieces = packets(recording.events.copy())
    step_ns = int(recording.events["t_ns"][-1] - recording.events["t_ns"][0]) + 1_000_000
    done, seconds, observations, lines = 0, 0.0, 0, []
    while done < _LONG_EVENTS:
        for piece in pieces:
            started = time.perf_counter()
            observations += frontend.process(piece).size
            seconds += time.perf_counter() - started
            piece["t_ns"] += step_ns
            before, done = done, done + piece.size
            if before // (_LONG_EVENTS // 10) != done // (_LONG_EVENTS // 10):
                lines.append([f"{done / 1e6:.0f}", f"{memory_mb():.1f}", f"{done / seconds / 1e6:.2f}"])
                print(" | ".join(lines[-1]), flush=True)
            if done >= _LONG_EVENTS:
                break
    return f"{tracker}, {observations} observations\n\n" + table(["Mev", "memory MB", "Mev/s"], lines)


def memory_mb() -> float:
    """Current memory of this process [MB]; the peak where the system does not provide it."""
    statm = Path("/proc/self/statm")
    if statm.is_file():
        return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> None:
    """Print a table for each tracker."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trackers", nargs="+", default=["gradient", "haste"], choices=["gradient", "haste"])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--scenes", nargs="*", default=["event_fast", "event_rotation"])
    parser.add_argument("--seconds", type=float, default=2.0, help="of the simulated sequences")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    parser.add_argument("--long", action="store_true", help="10^8 events instead")
    parser.add_argument("--markdown", type=Path, help="also write the tables here")
    options = parser.parse_args()
    simulated = {
        scene: sequence(scene, 0, options.seconds, options.cache).recording for scene in options.scenes
    }
    parts = []
    for tracker in options.trackers:
        if options.long:
            parts.append(long_run(simulated[options.scenes[0]], tracker))
            continue
        rows = [
            row(f"{name}, simulated", recording, recording.events, tracker, options.repeats)
            for name, recording in simulated.items()
        ]
        for name in EXCERPTS:
            recording = load(name)
            events = repeated(recording.events, REPEATED_EVENTS)
            rows.append(row(f"{name}, repeated", recording, events, tracker, options.repeats))
        parts.append(f"## {tracker}, target {_TARGET_MEV_S} Mev/s\n\n{table(HEADER, rows)}")
    text = "\n\n".join(parts) + "\n"
    print(text)
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
