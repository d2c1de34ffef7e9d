"""Cost against load: one parameter is varied at a time, each row in a separate process.

    python benchmarks/load.py [--only features rate window imu] [--large] [--seconds 10] [--markdown FILE]
    python benchmarks/load.py --minutes 10 [--scene event_slow] [--markdown FILE]

Evidence: simulated events. Features 25 to 400; event rate by scene (0.3 to 3 Mev/s at 240 x 180; `--large`
adds 640 x 480 at about 10 Mev/s and 1280 x 720 at about 40 Mev/s, whose simulation takes 8 GB on disk);
window 0.5 to 3 s; IMU 200 to 2000 Hz, with the same motion and events. "Front end" and "estimator" run alone,
the estimator on the pipeline's observations; in milliseconds per second of the recording: below 1000 is
faster than real time.

`--minutes`: memory over a long run instead, measured at the end of every minute; anonymous memory is the
memory of the process without the pages of the mapped event file.
"""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

# Sets the number of threads, so it is imported before NumPy.
from common import table  # isort: skip

import numpy as np
from rich.progress import track

from asyneio.config import Config
from asyneio.io.parsing.atomic import write_text
from asyneio.pipeline import run_recording
from asyneio.simulation import EVENT_SCENARIOS, EventScenario
from asyneio.studies.speed_run import ESTIMATOR, FRONT_END, SpeedRun
from asyneio.studies.speed_workload import Workload
from asyneio.types import EventRecording, Health
from sequences import DEFAULT_CACHE, cached_sequence

HEADER = [
    "load",
    "Mev/s",
    "observations per second",
    "landmarks",
    "front end ms/s",
    "ns per event",
    "estimator ms/s",
    "x real time",
    "queued latency 99 %, ms",
    "peak MB",
    "remark",
]
BASE = "suite_boxes_6dof"
#: By increasing event rate.
RATES = ("event_slow", "suite_poster_translation", "suite_boxes_6dof", "event_fast", "event_boxes")
#: Larger sensors, and the durations [s].
LARGE = {"suite_fine_6dof_640x480": 8.0, "suite_fine_6dof_1280x720": 6.0}
FEATURES, WINDOWS_S, IMU_HZ = (25, 50, 100, 200, 400), (0.5, 1.0, 1.5, 2.0, 3.0), (200, 500, 1000, 2000)
_MINUTE_S = 60.0


@dataclass(frozen=True)
class Load:
    """One row: a scenario and its differences from the default configuration."""

    name: str
    scenario: EventScenario
    config: dict[str, Any]
    cache: Path


@dataclass(frozen=True)
class _Simulated(Workload):
    """A simulated workload."""

    scenario: EventScenario = EVENT_SCENARIOS[BASE]

    def open(self, progress: Callable[[float], None] | None = None) -> EventRecording:
        """The events from the cache of sequences."""
        return cached_sequence(self.scenario, self.path).recording


def loads(only: list[str], seconds: float, large: bool, cache: Path) -> Iterator[Load]:
    """All rows, in order."""
    base = replace(EVENT_SCENARIOS[BASE], duration_s=seconds)
    if "features" in only:
        for n in FEATURES:
            yield Load(f"{n} features", base, {"frontend": {"max_features": n}}, cache)
    if "rate" in only:
        for name in RATES:
            yield Load(name, replace(EVENT_SCENARIOS[name], duration_s=seconds), {}, cache)
        for name, most_s in LARGE.items() if large else ():
            yield Load(name, replace(EVENT_SCENARIOS[name], duration_s=min(seconds, most_s)), {}, cache)
    if "window" in only:
        for length_s in WINDOWS_S:
            yield Load(f"window {length_s:g} s", base, {"window": {"length_s": length_s}}, cache)
    if "imu" in only:
        for hz in IMU_HZ:
            other = replace(base, gyroscope_rate_hz=float(hz), accelerometer_rate_hz=float(hz))
            yield Load(f"IMU {hz} Hz", other, {}, cache)


def row(load: Load) -> list[str]:
    """Measure one load, after a short run that loads the kernels."""
    config = Config.model_validate(load.config)
    workload = _Simulated(load.name, load.cache, 0.0, config, scenario=load.scenario)
    measured = SpeedRun(workload)
    measured.start_up(0.0)
    whole = measured.pipeline()
    stages, described = measured.stages(), measured.describe()
    seconds, events = described["seconds"], described["events"]
    front_end_s, estimator_s = (stages["seconds"][name] for name in (FRONT_END, ESTIMATOR))
    return [
        load.name,
        f"{events / seconds / 1e6:.2f}",
        f"{whole['observations'] / seconds:.0f}",
        f"{whole['mean_landmarks']:.0f}",
        f"{1e3 * front_end_s / seconds:.0f}",
        f"{1e9 * front_end_s / events:.0f}",
        f"{1e3 * estimator_s / seconds:.0f}",
        f"{whole['real_time_factor']:.2f}",
        f"{stages['latency']['p99_ms']:.0f}",
        f"{whole['peak_memory_mb']:.0f}",
        whole["failure"],
    ]


class _Memory:
    """Progress that records the memory [MB] at the end of every minute of the recording."""

    def __init__(self) -> None:
        self.rows: list[list[str]] = []

    def message(self, text: str) -> None:
        """Print the message, because a lost run that initializes again affects the table."""
        print(text, flush=True)

    def compiling(self, share: float) -> None:
        """Ignored."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """Record the end of a packet."""
        if done_s >= _MINUTE_S * (len(self.rows) + 1) or done_s >= total_s:
            anonymous, resident = (_status_mb(name) for name in ("RssAnon", "VmRSS"))
            self.rows.append(
                [f"{done_s / _MINUTE_S:.1f}", f"{anonymous:.1f}", f"{resident:.1f}", str(health)]
            )
            print(" | ".join(self.rows[-1]), flush=True)


def _status_mb(name: str) -> float:
    """A value of /proc/self/status [MB]; NaN if it does not exist."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return float("nan")
    found = [line.split()[1] for line in lines if line.startswith(f"{name}:")]
    return int(found[0]) * 1024 / 1e6 if found else float("nan")


def memory(scene: str, minutes: float, cache: Path) -> str:
    """Table of a run with this duration."""
    scenario = replace(EVENT_SCENARIOS[scene], duration_s=_MINUTE_S * minutes)
    recording, watch = cached_sequence(scenario, cache).recording, _Memory()
    result = run_recording(recording, Config(), watch)
    anonymous = np.array([float(cells[1]) for cells in watch.rows])
    middle = len(anonymous) // 2
    grown = np.median(anonymous[middle:]) / np.median(anonymous[: middle + 1])
    said = f"{scene}, {minutes:g} minutes; {result.summary.failure or 'one segment'}; "
    said += f"median of the second half {grown:.3f} times the first"
    return f"{said}\n\n{table(['minute', 'anonymous MB', 'resident MB', 'health'], watch.rows)}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    kinds = ["features", "rate", "window", "imu"]
    parser.add_argument("--only", nargs="+", default=kinds, choices=kinds)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--large", action="store_true", help="also sensors of 640 x 480 and 1280 x 720")
    parser.add_argument("--minutes", type=float, help="memory over a run of this duration instead")
    parser.add_argument("--scene", default="event_slow", help="of --minutes")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    if options.minutes:
        text = memory(options.scene, options.minutes, options.cache) + "\n"
    else:
        chosen = list(loads(options.only, options.seconds, options.large, options.cache))
        spawn = multiprocessing.get_context("spawn")
        rows = []
        # Simulated here, so that its memory is not counted; one at a time, each in a new process.
        for load in track(chosen, description="load"):
            cached_sequence(load.scenario, load.cache)
            with ProcessPoolExecutor(1, mp_context=spawn) as pool:
                rows.append(pool.submit(row, load).result())
        text = table(HEADER, rows) + "\n"
    print(text)
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
