"""The front end over a recording: no duplicates, in order, late observations counted."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from asyneio.config import Config, FrontendConfig
from asyneio.errors import RecordingError
from asyneio.pipeline import RunResult, compilation, run_recording
from asyneio.pipeline.frontend_thread import AHEAD, ObservationStream
from asyneio.pipeline.packets import calibration_of, usable_span
from asyneio.pipeline.track_source import ReplayedStream
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import (
    INERTIAL_DTYPE,
    Estimate,
    EventRecording,
    IntArray,
    Packet,
    RecordArray,
    StepReport,
)
from tests.cli.fakes import FakeOdometry

pytestmark = pytest.mark.slow

INTERVAL_NS = 100_000_000


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    return simulate_events(replace(EVENT_SCENARIOS["event_room"], duration_s=1.2)).recording


def ends_of(recording: EventRecording) -> IntArray:
    start_ns, end_ns = usable_span(recording)
    return start_ns + INTERVAL_NS * np.arange((end_ns - start_ns) // INTERVAL_NS + 1)


@pytest.mark.slow
def test_batches_are_in_order_within_their_time(recording: EventRecording) -> None:
    ends_ns = ends_of(recording)
    stream = ObservationStream(recording, FrontendConfig(), ends_ns)
    batches = list(stream)
    assert len(batches) == ends_ns.size - 1
    for batch, start_ns, end_ns in zip(batches, ends_ns, ends_ns[1:], strict=False):
        assert ((batch["t_ns"] > start_ns) & (batch["t_ns"] <= end_ns)).all()
        assert (np.diff(batch["t_ns"]) >= 0).all()
    observations = stream.observations()
    assert observations.size > 200
    assert np.unique(observations[["t_ns", "id"]]).size == observations.size


def test_two_runs_are_alike(recording: EventRecording) -> None:
    first, second = (ObservationStream(recording, FrontendConfig(), ends_of(recording)) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.tobytes() == b.tobytes()


def test_late_observations_are_counted_and_noted(recording: EventRecording) -> None:
    patient = ObservationStream(recording, FrontendConfig(), ends_of(recording))
    hasty = ObservationStream(recording, FrontendConfig(max_delay_s=0.0), ends_of(recording))
    list(patient)
    list(hasty)
    assert hasty.late > patient.late
    assert "max_delay_s = 0 s" in hasty.notes()[0]
    assert hasty.observations().size < patient.observations().size


def test_an_outlier_share_takes_effect_at_a_fixed_time(recording: EventRecording) -> None:
    """Whatever the speed of the reader, and from the sixth batch after the report on."""
    few = FrontendConfig(max_features=20)

    def batches(share: float, wait_s: float) -> list[RecordArray]:
        stream, found = ObservationStream(recording, few, ends_of(recording)), []
        for batch in stream:
            time.sleep(wait_s)
            stream.set_outlier_share(share if len(found) == 1 else 0.0)
            found.append(batch)
        return found

    silent, quick, slow = batches(0.0, 0.0), batches(0.5, 0.0), batches(0.5, 0.02)
    assert len(quick) == len(ends_of(recording)) - 1
    for a, b in zip(quick, slow, strict=True):
        assert a.tobytes() == b.tobytes()
    same = [a.tobytes() == b.tobytes() for a, b in zip(silent, quick, strict=True)]
    assert all(same[:6])
    assert not same[7]
    assert np.unique(quick[7]["id"]).size > 1.3 * np.unique(silent[7]["id"]).size


def test_the_front_end_runs_ahead_by_a_fixed_number_of_batches(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However slow the estimator is: the queue between them does not grow."""
    stream = ObservationStream(recording, FrontendConfig(), ends_of(recording))
    process, processed = stream._tracking.frontend.process, 0

    def counted(events: RecordArray, gyroscope: RecordArray | None = None) -> RecordArray:
        nonlocal processed
        processed += 1
        return process(events, gyroscope)

    monkeypatch.setattr(stream._tracking.frontend, "process", counted)
    total = len(ends_of(recording)) - 1
    for released, _ in enumerate(stream, start=1):
        expected = min(released + AHEAD - 1, total)
        end_s = time.monotonic() + 30.0
        while processed < expected and time.monotonic() < end_s:
            time.sleep(0.005)
        time.sleep(0.02)
        assert processed == expected
        assert stream._queue.qsize() <= AHEAD


@pytest.mark.parametrize("tracker", ["gradient", "haste"])
def test_a_restored_front_end_continues_with_the_same_batches(
    tracker: Literal["gradient", "haste"], recording: EventRecording
) -> None:
    """Also with feedback that had not taken effect when the state was captured."""
    config, ends_ns = FrontendConfig(tracker=tracker, max_features=20), ends_of(recording)
    state, released = None, []
    stream = ObservationStream(recording, config, ends_ns)
    for number, batch in enumerate(stream):
        stream.set_outlier_share(0.1 * (number % 5))
        released.append(batch)
        if number == 2:
            stream.request_state()
        if state is None and (state := stream.state()) is not None:
            assert state.batches == number + 1
    assert state is not None
    assert state.batches < len(released) - 1
    restored = ObservationStream(recording, config, ends_ns)
    restored.restore(state, released[: state.batches])
    for number, batch in enumerate(restored, start=state.batches):
        restored.set_outlier_share(0.1 * (number % 5))
        assert batch.tobytes() == released[number].tobytes()
    assert restored.observations().tobytes() == stream.observations().tobytes()
    assert restored.notes() == stream.notes()


def test_stopping_early_ends_the_thread(recording: EventRecording) -> None:
    before = set(threading.enumerate())
    batches = iter(ObservationStream(recording, FrontendConfig(), ends_of(recording)))
    next(batches)
    started = set(threading.enumerate()) - before
    assert [thread.name for thread in started] == ["front end"]
    assert isinstance(batches, Generator)
    batches.close()
    assert set(threading.enumerate()) == before


def test_an_error_of_the_front_end_reaches_the_caller(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RecordingError("broken")

    stream = ObservationStream(recording, FrontendConfig(), ends_of(recording))
    monkeypatch.setattr(stream._tracking.frontend, "process", broken)
    with pytest.raises(RecordingError, match="broken"):
        list(stream)


def test_events_need_an_imu_and_a_calibration(recording: EventRecording) -> None:
    with pytest.raises(RecordingError, match="no gyroscope samples"):
        usable_span(replace(recording, gyroscope=np.empty(0, dtype=INERTIAL_DTYPE)))
    with pytest.raises(RecordingError, match="no complete calibration"):
        usable_span(replace(recording, calibration=None))
    with pytest.raises(RecordingError, match="no events"):
        usable_span(replace(recording, events=recording.events[:0]))


def test_replayed_batches_are_the_same(recording: EventRecording) -> None:
    ends_ns = ends_of(recording)
    stream = ObservationStream(recording, FrontendConfig(), ends_ns)
    batches = list(stream)
    replayed = ReplayedStream(stream.observations(), ends_ns)
    for a, b in zip(batches, replayed, strict=True):
        assert a.tobytes() == b.tobytes()
    assert replayed.observations().tobytes() == stream.observations().tobytes()


def run(
    recording: EventRecording,
    estimator: FakeOdometry,
    config: Config,
    observations: RecordArray | None = None,
) -> RunResult:
    return run_recording(recording, config, observations=observations, estimator=estimator)


def fake_of(kind: type[FakeOdometry], recording: EventRecording) -> FakeOdometry:
    return kind(Config(), calibration_of(recording))


def test_a_run_on_known_observations_gets_the_same_packets(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Records(FakeOdometry):
        def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
            packets.append(packet)
            return super().process(packet)

    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    packets: list[Packet] = []
    tracked = run(recording, fake_of(Records, recording), Config())
    first, packets = packets, []
    again = run(recording, fake_of(Records, recording), Config(), tracked.observations)
    assert len(first) == len(packets) > 5
    for a, b in zip(first, packets, strict=True):
        assert (a.t_end_ns, a.events) == (b.t_end_ns, b.events)
        assert a.observations.tobytes() == b.observations.tobytes()
        assert a.gyroscope.tobytes() == b.gyroscope.tobytes()
    assert again.observations.size == tracked.observations.size > 0
    assert again.summary.frontend_s == 0.0


def test_the_front_end_gets_the_outlier_share_of_the_estimator(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It tracks more features to compensate, and two runs are identical."""

    class Rejects(FakeOdometry):
        share = 0.5

        def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
            estimates, report = super().process(packet)
            return estimates, replace(report, outlier_share=self.share)

    class RejectsNone(Rejects):
        share = 0.0

    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    config = Config(frontend=FrontendConfig(max_features=20))
    kinds = (Rejects, Rejects, RejectsNone)
    observed = [run(recording, fake_of(kind, recording), config).observations for kind in kinds]
    assert observed[0].tobytes() == observed[1].tobytes()
    tracks = [np.unique(o["id"]).size for o in observed]
    assert tracks[0] > 1.2 * tracks[2]
