# SPDX-License-Identifier: Apache-2.0
"""Speed of front end, estimator and pipeline for a fixed workload: stages, latency, memory, start-up.

Each measurement runs alone, in a separate process. Each repeat consists of one run of every measurement, so
that other load affects all of them. In every repeat a fixed reference work is timed too
(`speed_reference.py`); `relative` and `relative_cpu` are times divided by that of the reference work, for
comparisons between machines and between different times on a shared machine.
"""

from __future__ import annotations

import multiprocessing
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median
from typing import Any

from asyneio.errors import StudyError
from asyneio.studies.speed_run import ESTIMATOR, FRONT_END, PIPELINE, Figures, SpeedRun
from asyneio.studies.speed_stages import STAGES
from asyneio.studies.speed_workload import Workload
from asyneio.studies.study import code_fingerprint, fingerprint
from asyneio.version import __version__

#: Called with the number of finished measurements, of all measurements, and of failed ones (always 0).
Progress = Callable[[int, int, int], None]
#: Runs a measurement, given its name and arguments.
Measure = Callable[..., Figures]

#: Everything that is timed and compared.
TIMED = (FRONT_END, ESTIMATOR, *(stage.name for stage in STAGES), PIPELINE)

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class SpeedOptions:
    """Number of repeats; number of busy processes beside (0: none); whether to measure at the pace of the
    recording, and a start without compiled kernels."""

    repeats: int = 3
    beside: int = 0
    paced: bool = False
    cold: bool = False


def measure_speed(workload: Workload, options: SpeedOptions, progress: Progress = lambda *_: None) -> Figures:
    """Measure a workload; returns plain values for JSON.

    Raises:
        StudyError: the measuring process was killed.
        EstimationError: no packet could be processed.
        RecordingError, CalibrationError: the recording cannot be used.
    """
    total = 2 + options.cold + options.repeats * (3 + bool(options.beside) + options.paced)
    done = 0

    def counted(measure: Measure) -> Measure:
        def call(*arguments: Any) -> Figures:
            nonlocal done
            figures = measure(*arguments)
            done += 1
            progress(done, total, 0)
            return figures

        return call

    progress(0, total, 0)
    found: Figures = {}
    if options.cold:
        with tempfile.TemporaryDirectory() as folder, _process(workload, NUMBA_CACHE_DIR=folder) as measure:
            found["cold_start"] = counted(measure)("start_up", time.time())
    with _process(workload) as measure:
        return _identity(workload) | measure_with(counted(measure), options) | found


def measure_with(measure: Measure, options: SpeedOptions) -> Figures:
    """Run all measurements; returns their medians.

    Args:
        measure: calls a method of a `SpeedRun`, given its name.
        options: measurements to run.
    """
    start_up, recording = measure("start_up", time.time()), measure("describe")
    rounds = [_round(measure, options) for _ in range(options.repeats)]
    found: Figures = {
        "workload": recording,
        "repeats": options.repeats,
        "start_up": start_up,
        "reference_s": median(one["reference"]["seconds"] for one in rounds),
        "seconds": _times(rounds, "seconds"),
        "cpu_seconds": _times(rounds, "cpu_s"),
        "relative": _times(rounds, "seconds", over_reference=True),
        "relative_cpu": _times(rounds, "cpu_s", over_reference=True),
        "calls": rounds[0]["stages"]["calls"],
        "pipeline": _medians([one["pipeline"] for one in rounds]),
        "latency_ms": {"queued": _medians([one["stages"]["latency"] for one in rounds])},
    }
    # Later measurements share the process, so only the first run shows the memory of a single run.
    found["pipeline"]["peak_memory_mb"] = rounds[0]["pipeline"]["peak_memory_mb"]
    if options.paced:
        found["latency_ms"]["paced"] = _medians([one["paced"] for one in rounds])
    if options.beside:
        beside = _medians([one["beside"] for one in rounds])
        found["beside"] = beside | {
            "processes": options.beside,
            "slower": median(one["beside"]["seconds"] / one["pipeline"]["seconds"] for one in rounds),
        }
    return found


def _round(measure: Measure, options: SpeedOptions) -> Figures:
    one = {"reference": measure("reference"), "pipeline": measure("pipeline")}
    if options.beside:
        one["beside"] = measure("pipeline", options.beside)
    one["stages"] = measure("stages")
    if options.paced:
        one["paced"] = measure("paced")
    return one


def _times(rounds: Sequence[Figures], kind: str, over_reference: bool = False) -> dict[str, float]:
    """Medians of one kind of time, for everything that is timed."""
    times = [one["stages"][kind] | {PIPELINE: one["pipeline"][kind]} for one in rounds]
    units = [one["reference"][kind] if over_reference else 1.0 for one in rounds]
    return {
        name: median(time[name] / unit for time, unit in zip(times, units, strict=True)) for name in TIMED
    }


def _medians(figures: Sequence[Figures]) -> Figures:
    """Median of each number; the first value of everything else."""
    first = figures[0]
    return {
        name: median(one[name] for one in figures) if isinstance(value, int | float) else value
        for name, value in first.items()
    }


def _identity(workload: Workload) -> Figures:
    """Program, settings and machine of a measurement."""
    config = workload.config
    return {
        "version": __version__,
        "code": code_fingerprint(),
        "scheme": config.inertial.scheme,
        "settings": fingerprint("speed", config.model_dump()),
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "system": f"{platform.system()} {platform.machine()}",
            "python": platform.python_version(),
        },
    }


def _processor() -> str:
    """Name of the processor, if the system provides it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
            return next(named, "") or platform.processor()
    except OSError:
        return platform.processor()


_RUN: SpeedRun | None = None


def _begin(workload: Workload) -> None:
    global _RUN
    _RUN = SpeedRun(workload)


def _call(name: str, arguments: tuple[Any, ...]) -> Figures:
    assert _RUN is not None
    figures: Figures = getattr(_RUN, name)(*arguments)
    return figures


@contextmanager
def _process(workload: Workload, **environment: str) -> Iterator[Measure]:
    """A new measuring process with additional environment variables."""
    wanted = dict.fromkeys(_THREADS, "1") | environment
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(1, mp_context=spawn, initializer=_begin, initargs=(workload,))
    try:
        yield lambda name, *arguments: pool.submit(_call, name, arguments).result()
    except BrokenProcessPool as error:
        raise StudyError(
            "the measuring process was killed, possibly for lack of memory; "
            "measure a shorter part with --seconds"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
