"""The runner: no sample lost between packets, correct figures, every failure reported, complete outputs."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import config, njit

from asyneio.config import Config, WindowConfig, load_config
from asyneio.errors import RecordingError
from asyneio.io import read_estimates, read_trajectory
from asyneio.pipeline import COMPILING, RunResult, compilation, run_recording, write_outputs
from asyneio.pipeline.packets import packets, usable_span
from asyneio.progress import SILENT, RunProgress
from asyneio.types import (
    INERTIAL_DTYPE,
    NS_PER_S,
    OBSERVATION_DTYPE,
    Estimate,
    Health,
    Packet,
    RecordArray,
    Recording,
    StepReport,
)
from tests.cli.fakes import (
    Degraded,
    Diverges,
    FakeOdometry,
    LosesTrack,
    NeverStarts,
    Raises,
    SkipsAWhile,
    StartsAgain,
)
from tests.io.recordings import START_NS, make_recording

INTERVAL_NS = 50_000_000
CONFIG = Config(window=WindowConfig(knot_interval_s=INTERVAL_NS / NS_PER_S))


@pytest.fixture
def recording(rng: np.random.Generator) -> Recording:
    return make_recording(rng, seconds=3.0, accelerometer_hz=190.0)


@pytest.fixture(autouse=True)
def _compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)


def run(
    recording: Recording,
    estimator: type[FakeOdometry] = FakeOdometry,
    config: Config = CONFIG,
    progress: RunProgress = SILENT,
) -> RunResult:
    fake = estimator(config, recording.calibration)
    return run_recording(recording, config, progress, estimator=fake)


class Recorder:
    """Progress that records its calls."""

    def __init__(self) -> None:
        self.messages: list[str] = []
        self.steps: list[tuple[float, float, Health]] = []
        self.compiled: list[float] = []

    def message(self, text: str) -> None:
        self.messages.append(text)

    def compiling(self, share: float) -> None:
        self.compiled.append(share)

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        self.steps.append((done_s, total_s, health))


def stamped(dtype: np.dtype[np.void], stamps: list[int]) -> RecordArray:
    rows = np.zeros(len(stamps), dtype=dtype)
    rows["t_ns"] = sorted(stamps)
    return rows


_STAMPS = st.lists(st.integers(0, 1000), min_size=1, max_size=60)


@pytest.mark.slow
@given(observed=_STAMPS, gyroscope=_STAMPS, accelerometer=_STAMPS, interval=st.integers(1, 300))
def test_packets_hold_every_sample_once(
    observed: list[int], gyroscope: list[int], accelerometer: list[int], interval: int
) -> None:
    recording = replace(
        make_recording(np.random.default_rng(0), 0.2),
        observations=stamped(OBSERVATION_DTYPE, observed),
        gyroscope=stamped(INERTIAL_DTYPE, gyroscope),
        accelerometer=stamped(INERTIAL_DTYPE, accelerometer),
    )
    start, count = 100, 700 // interval
    cut = list(packets(recording, start, interval, count))
    assert [packet.t_end_ns for packet in cut] == [start + interval * (k + 1) for k in range(count)]
    for name in ("observations", "gyroscope", "accelerometer"):
        stamps = getattr(recording, name)["t_ns"]
        inside = stamps[(stamps >= start) & (stamps <= start + interval * count)]
        parts = [getattr(packet, name)["t_ns"] for packet in cut]
        np.testing.assert_array_equal(np.concatenate([[], *parts]), inside)
        for packet, part in zip(cut, parts, strict=True):
            assert (part <= packet.t_end_ns).all()
            assert (part >= packet.t_end_ns - interval).all()


def test_span_is_where_all_sensors_have_data(recording: Recording) -> None:
    start, end = usable_span(recording)
    assert start == START_NS + 3_000_001
    assert end == min(recording.gyroscope["t_ns"][-1], recording.accelerometer["t_ns"][-1])


def test_figures_of_a_run(recording: Recording) -> None:
    progress = Recorder()
    result = run(recording, progress=progress)
    summary = result.summary
    packets_fed = (usable_span(recording)[1] - usable_span(recording)[0]) // INTERVAL_NS
    assert summary.duration_s == pytest.approx(0.05 * packets_fed)
    assert summary.knots == packets_fed - 3 == len(result.run.estimates)
    assert summary.first_estimate_s == pytest.approx(0.2)
    assert (summary.features, summary.observations) == (12, 720)
    assert summary.mean_track_life_s == pytest.approx(2.95)
    assert summary.rejected == 2 * summary.knots
    assert summary.mean_landmarks == 40.0
    assert summary.real_time_factor == pytest.approx(summary.duration_s / summary.processing_s)
    assert (summary.health, summary.failure) == (Health.TRACKING, "")
    assert len(progress.steps) == packets_fed
    assert progress.steps[-1][0] == progress.steps[-1][1] == pytest.approx(summary.duration_s)


@pytest.mark.parametrize(
    ("estimator", "failure"),
    [
        (NeverStarts, "did not initialize, so there is no trajectory: too few feature tracks"),
        (LosesTrack, "lost track and did not recover: speed of 80 m/s"),
        (SkipsAWhile, "a gap of 0.55 s: no features"),
        (
            StartsAgain,
            "2 segments, each with its own world frame; there are no poses for 0.35 s between them: the",
        ),
        (Diverges, "not finite"),
        (Raises, "stopped after 17 estimates: the system is singular"),
    ],
)
def test_failures_are_named(recording: Recording, estimator: type[FakeOdometry], failure: str) -> None:
    assert failure in run(recording, estimator).summary.failure


def test_a_degraded_run_is_complete_and_reported(recording: Recording) -> None:
    summary = run(recording, Degraded).summary
    assert summary.failure == ""
    assert summary.health_s["degraded"] == pytest.approx(0.2)
    assert sum(summary.health_s.values()) == pytest.approx(summary.duration_s)
    assert [(str(t.health), t.reason) for t in summary.transitions] == [
        ("initializing", "too few feature tracks"),
        ("tracking", ""),
        ("degraded", "no observations for 0.20 s"),
        ("tracking", ""),
    ]
    assert [t.t_s for t in summary.transitions] == pytest.approx([0.05, 0.2, 0.4, 0.6])
    assert [(s.segment, s.ended) for s in summary.segments] == [(0, "end of the recording")]


def test_each_segment_has_its_own_file(recording: Recording, tmp_path: Path) -> None:
    (tmp_path / "trajectory_7.tum").write_text("stale")
    progress = Recorder()
    result = run(recording, StartsAgain, progress=progress)
    assert progress.messages == ["lost after 1.0 s: the stream is cut"]
    written = write_outputs(result, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in written)
    stamps = [read_trajectory(tmp_path / name)[0].t_ns for name in ("trajectory.tum", "trajectory_1.tum")]
    assert (len(stamps[0]), len(stamps[0]) + len(stamps[1])) == (16, len(result.run.estimates))
    estimates = read_estimates(tmp_path / "estimates.npz")
    assert [e.segment for e in estimates] == [0] * len(stamps[0]) + [1] * len(stamps[1])
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [s["ended"] for s in summary["segments"]] == ["the stream is cut", "end of the recording"]
    assert [s["knots"] for s in summary["segments"]] == [len(part) for part in stamps]
    with (tmp_path / "health.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["health"] for row in rows] == [str(report.health) for report in result.run.reports]
    assert rows[19]["reason"] == "the stream is cut"
    with (tmp_path / "attitude.csv").open() as stream:
        attitudes = list(csv.DictReader(stream))
    assert len(attitudes) == 5
    assert float(attitudes[0]["tilt_sigma[deg]"]) == pytest.approx(np.degrees(0.01))


def test_a_recording_that_is_too_short_is_rejected(recording: Recording) -> None:
    short = replace(recording, gyroscope=recording.gyroscope[:20])
    with pytest.raises(RecordingError, match=r"at least two knot intervals of 0\.05 s"):
        run(short)


def test_outputs_are_complete_and_reproducible(recording: Recording, tmp_path: Path) -> None:
    config = load_config(None).model_copy(
        update={"window": CONFIG.window.model_copy(update={"length_s": 2.0})}
    )
    for name in ("a", "b"):
        result = run(recording, config=config)
        written = write_outputs(result, tmp_path / name)
        assert sorted(path.name for path in (tmp_path / name).iterdir()) == sorted(
            path.name for path in written
        )
    for name in ("trajectory.tum", "estimates.npz", "config.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    trajectory, notes = read_trajectory(tmp_path / "a" / "trajectory.tum")
    assert notes == ()
    estimates = read_estimates(tmp_path / "a" / "estimates.npz")
    assert trajectory.t_ns.tolist() == [estimate.t_ns for estimate in estimates]
    assert load_config(tmp_path / "a" / "config.yaml") == config
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["knots"] == len(estimates)
    assert summary["health"] == "tracking"


def test_without_estimates_no_trajectory_and_nothing_stale(recording: Recording, tmp_path: Path) -> None:
    write_outputs(run(recording), tmp_path)
    write_outputs(run(recording, NeverStarts), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["config.yaml", "health.csv", "summary.json"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["first_estimate_s"] is None
    assert "did not initialize" in summary["failure"]


@pytest.mark.slow
@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing compiles with NUMBA_DISABLE_JIT")
def test_compilation_is_announced_once_and_counted_separately(recording: Recording) -> None:
    @njit
    def inner(x: float) -> float:
        return x + 1.0

    @njit
    def kernel(x: float) -> float:
        return 2.0 * inner(x)

    class Compiles(FakeOdometry):
        def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
            kernel(1.0)
            kernel(1)
            return super().process(packet)

    progress = Recorder()
    summary = run(recording, Compiles, progress=progress).summary
    assert progress.messages == [COMPILING]
    assert summary.compile_s > 0.02
    assert summary.processing_s < summary.compile_s


def compile_slowly(progress: Callable[[float], None]) -> None:
    progress(0.5)
    time.sleep(0.2)
    progress(1.0)


def test_a_cold_cache_is_filled_before_the_run(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation.numba_config, "DISABLE_JIT", 0)
    monkeypatch.setattr(compilation, "are_compiled", lambda: False)
    monkeypatch.setattr(compilation, "compile_kernels", compile_slowly)
    progress = Recorder()
    summary = run(recording, progress=progress).summary
    assert progress.messages == [COMPILING]
    assert progress.compiled == [0.5, 1.0]
    assert summary.compile_s >= 0.2
    assert summary.processing_s < summary.compile_s


def test_nothing_is_announced_when_nothing_compiles(recording: Recording) -> None:
    progress = Recorder()
    assert run(recording, progress=progress).summary.compile_s == 0.0
    assert progress.messages == []
