"""`asyneio bench speed`: what it counts and compares. No test depends on how fast the machine is."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asyneio.config import Config, FrontendConfig
from asyneio.errors import StudyError
from asyneio.estimation.linearization import linear_system
from asyneio.estimation.solver import optimizer
from asyneio.frontend import Frontend
from asyneio.io import write_events_hdf5
from asyneio.pipeline import run_recording
from asyneio.simulation import SCENARIOS, simulate
from asyneio.studies import speed_run
from asyneio.studies.speed import ESTIMATOR, FRONT_END, PIPELINE, TIMED, SpeedOptions, _process, measure_with
from asyneio.studies.speed_latency import FrontendCalls, frontend_calls, paced_latency, queued_latency
from asyneio.studies.speed_report import compare, read_baseline, speed_json, speed_markdown
from asyneio.studies.speed_stages import REST, STAGES, stage_times
from asyneio.studies.speed_workload import Workload, simulated_workload
from asyneio.types import EVENT_DTYPE, Health, StepReport
from tests.io.event_recordings import make_event_recording

_MS = 1_000_000


def _report(t_ms: int, seconds: float, health: Health = Health.TRACKING) -> StepReport:
    return StepReport(t_ms * _MS, health, seconds=seconds)


@pytest.mark.slow
def test_stages_are_counted_and_put_back() -> None:
    recording = simulate(replace(SCENARIOS["moderate"], duration_s=3.5)).recording
    functions = [getattr(stage.owner, stage.attribute) for stage in STAGES]
    alone = run_recording(recording, Config())
    with stage_times() as times:
        counted = run_recording(recording, Config())
    assert [getattr(stage.owner, stage.attribute) for stage in STAGES] == functions
    assert optimizer.linearize is linear_system.linearize
    np.testing.assert_array_equal(
        [estimate.T_w_b for estimate in counted.run.estimates],
        [estimate.T_w_b for estimate in alone.run.estimates],
    )
    calls, knots = times.calls, len(counted.run.estimates)
    assert knots > 15
    assert calls[REST] == len(counted.run.reports)
    # The first estimate is that of the start.
    assert calls["covariance"] == knots
    assert calls["measurements"] == calls["births"] == calls["outliers"] == knots - 1
    assert calls["linearise"] >= calls["eliminate"] >= calls["solve"] >= knots - 1
    assert calls["start"] >= 1
    assert calls["marginalise"] >= 1
    assert all(seconds > 0.0 for name, seconds in times.seconds.items() if calls[name])
    # Nothing is counted twice.
    assert sum(times.seconds.values()) <= sum(report.seconds for report in counted.run.reports)


def test_whole_stages_keep_what_is_within(monkeypatch: pytest.MonkeyPatch) -> None:
    from asyneio.odometry import odometry
    from asyneio.odometry.initializer import initialize as attempt

    def start(*_: Any) -> str:
        optimizer.linearize(None)  # type: ignore[arg-type]
        return "not yet"

    def linearize(_: Any) -> None:
        return None

    for module in (linear_system, optimizer):
        monkeypatch.setattr(module, "linearize", linearize)
    for module in (attempt, odometry):
        monkeypatch.setattr(module, "initialize", start)
    with stage_times() as times:
        odometry.initialize(None, None, None, None, None)  # type: ignore[arg-type]
        optimizer.linearize(None)  # type: ignore[arg-type]
    assert times.calls["start"] == 1
    assert times.calls["linearise"] == 1


def test_queued_latency() -> None:
    """Packets end at 100, 200, 300 ms and wait for events of another 50 ms."""
    calls = FrontendCalls([50 * _MS, 150 * _MS, 250 * _MS, 350 * _MS], [0.01, 0.02, 0.02, 0.02])
    reports = [_report(100, 0.3, Health.INITIALIZING), _report(200, 0.1), _report(300, 0.01)]
    found = queued_latency(calls, reports, 50 * _MS)
    # 150 + 20 + 300 = 470 ms; the next two wait for the estimator: 570 and 580, complete at 250 and 350.
    assert found.estimates == 2
    assert (found.median_ms, found.largest_ms) == pytest.approx((275.0, 320.0))
    quick = queued_latency(calls, [replace(report, seconds=0.03) for report in reports], 50 * _MS)
    assert quick.largest_ms == pytest.approx(50.0)
    nothing = queued_latency(calls, reports[:1], 50 * _MS)
    assert nothing.estimates == 0
    assert np.isnan(nothing.median_ms)


def test_paced_latency() -> None:
    calls = FrontendCalls([50 * _MS], [0.0], begin_s=1000.0)
    found = paced_latency(calls, [1000.2, 1000.29], [_report(100, 0.0), _report(200, 0.0)], 50 * _MS)
    assert (found.median_ms, found.largest_ms) == pytest.approx((45.0, 50.0))


def test_events_are_held_back() -> None:
    events = np.zeros(40, dtype=EVENT_DTYPE)
    events["t_ns"] = 5_000 * _MS + np.arange(40) * 2 * _MS
    frontend = Frontend(FrontendConfig(), 32, 32)
    process = Frontend.process
    started = time.perf_counter()
    with frontend_calls(at_pace=True) as calls:
        for piece in (events[:20], events[20:20], events[20:]):
            frontend.process(piece)
    assert Frontend.process is process
    assert calls.newest_ns == [5_038 * _MS, 5_078 * _MS]
    assert len(calls.seconds) == 2
    assert time.perf_counter() - started >= 0.040


def _found(**factors: float) -> dict[str, Any]:
    """Figures of a run whose times are those of a baseline, times factors."""
    relative = {name: 10.0 * factors.get(name.replace(" ", "_"), 1.0) for name in TIMED}
    return {
        "workload": {"name": "a", "seconds": 10.0, "events": 1000, "width": 240, "height": 180},
        "scheme": "gpif",
        "relative": relative,
        "relative_cpu": dict(relative),
    }


def test_ratios_and_gate() -> None:
    baseline = _found()
    assert compare(_found(), baseline).slower_than(1.01) == {}
    slower = compare(_found(linearise=2.0, front_end=1.4, pipeline=1.6), baseline)
    assert slower.slower_than(1.5) == pytest.approx({"linearise": 2.0, PIPELINE: 1.6})
    # Other work on the machine: more time by the clock, not of the processor.
    busy = _found(linearise=2.0, pipeline=2.0)
    busy["relative_cpu"] = dict(baseline["relative_cpu"])
    assert compare(busy, baseline).slower_than(1.5) == {PIPELINE: 2.0}
    # Too short to tell.
    small = _found(births=0.001)
    assert "births" not in compare(small, _found(births=0.0001)).ratios
    assert compare(_found(births=5.0), _found(births=0.0001)).ratios["births"] > 1e4


@pytest.mark.parametrize(
    ("where", "name", "value"),
    [("workload", "name", "b"), ("workload", "events", 1100), ("", "scheme", "gpp")],
)
def test_other_workloads_do_not_compare(where: str, name: str, value: object) -> None:
    found = _found()
    (found[where] if where else found)[name] = value
    comparison = compare(found, _found())
    assert comparison.ratios == {}
    assert name in comparison.why_not


def test_a_baseline_is_checked(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="cannot read the baseline"):
        read_baseline(tmp_path / "absent.json")
    path = tmp_path / "other.json"
    for text in ("no JSON", "[]", '{"relative": {}}', json.dumps(_found(front_end=0.0))):
        path.write_text(text)
        with pytest.raises(StudyError, match="is not a baseline"):
            read_baseline(path)
    path.write_text(json.dumps(_found()))
    assert read_baseline(path) == _found()


def _fake_measure(name: str, *arguments: object) -> dict[str, Any]:
    """Figures of which each tells where it ends up."""
    slow = 3.0 if arguments == (2,) else 1.0
    names = [stage.name for stage in STAGES]
    stage_s = {FRONT_END: 0.5, ESTIMATOR: 12.0, **dict.fromkeys(names, 1.0)}
    latency = {"median_ms": 5.0, "p99_ms": 9.0, "largest_ms": 11.0, "estimates": 3}
    described = {"name": "a", "seconds": 2.0, "events": 1_000_000, "event_rate": 500_000, "width": 240}
    described |= {"height": 180, "gyroscope_hz": 1000, "accelerometer_hz": 1000}
    start_up = {"first_estimate_s": 3.0, "first_estimate_cpu_s": 2.0, "compile_s": 0.0}
    pipeline = {"seconds": 8.0 * slow, "cpu_s": 7.0, "real_time_factor": 0.25 / slow, "front_end_s": 0.6}
    return {
        "start_up": start_up,
        "describe": described,
        "reference": {"seconds": 0.02, "cpu_s": 0.01},
        "pipeline": pipeline | {"peak_memory_mb": float("nan"), "failure": ""},
        "stages": {
            "seconds": stage_s,
            "cpu_s": stage_s,
            "calls": dict.fromkeys(names, 7),
            "latency": latency,
        },
        "paced": latency,
    }[name]


def test_figures_tables_and_json() -> None:
    found = measure_with(_fake_measure, SpeedOptions(repeats=2, beside=2, paced=True))
    found |= {"scheme": "gpif", "machine": {"processor": "one", "cores": 2}, "cold_start": found["start_up"]}
    assert found["relative"][ESTIMATOR] == pytest.approx(600.0)
    assert found["relative_cpu"][PIPELINE] == pytest.approx(700.0)
    assert found["beside"]["slower"] == pytest.approx(3.0)
    comparison = compare(found, found)
    assert set(comparison.ratios) == set(TIMED)
    tables = speed_markdown(found, comparison)
    assert "| front end alone (500 ns per event) |  | 0.500 | 0.500 | 250.0 |  | 1.00 | 1.00 |" in tables
    assert "times as slow as alone | 3 |" in tables
    assert "median, 99 %, largest, ms | 5  9  11 |" in tables
    plain = json.loads(speed_json(found, comparison))
    assert plain["pipeline"]["peak_memory_mb"] is None
    assert plain["times_the_baseline"][FRONT_END] == 1.0


@pytest.mark.slow
def test_in_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    path = tmp_path / "recording.h5"
    write_events_hdf5(make_event_recording(np.random.default_rng(1)), path)
    with _process(Workload("own", path, 1.0, Config()), OTHER_VARIABLE="1") as measure:
        found = measure("describe")
        assert measure("reference")["seconds"] > 0.0
    assert found["seconds"] == pytest.approx(1.0, abs=0.02)
    assert found["width"] == 240
    assert found["gyroscope_hz"] == pytest.approx(200, abs=2)
    assert os.environ["MKL_NUM_THREADS"] == "3"
    assert "OTHER_VARIABLE" not in os.environ


@pytest.mark.slow
def test_the_simulated_stream_is_kept(tmp_path: Path) -> None:
    told: list[float] = []
    workload = simulated_workload(0.2, Config(), tmp_path, told.append)
    assert told
    assert told == sorted(told)
    written = workload.path.stat().st_mtime_ns
    assert simulated_workload(0.2, Config(), tmp_path).path.stat().st_mtime_ns == written
    recording = workload.open()
    assert (recording.width, recording.height) == (240, 180)
    assert recording.gyroscope.size == pytest.approx(200, abs=2)


@pytest.mark.slow
def test_busy_processes_end() -> None:
    with speed_run.busy_processes(2) as processes:
        assert [process.poll() for process in processes] == [None, None]
    assert all(process.poll() is not None for process in processes)
    # One whose parent is gone ends by itself.
    orphan = subprocess.run([sys.executable, "-c", speed_run._SPIN, "-1"], timeout=60, check=False)
    assert orphan.returncode == 0
