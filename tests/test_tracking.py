"""The front end over a recording: nothing twice, nothing out of order, late ones counted."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from asyneio.config import Config, FrontendConfig
from asyneio.errors import RecordingError
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.pipeline.frontend_thread import ObservationStream, ReplayedStream
from asyneio.pipeline.packets import usable_span
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

INTERVAL_NS = 100_000_000


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    return simulate_events(replace(EVENT_SCENARIOS["event_room"], duration_s=1.2)).recording


def ends_of(recording: EventRecording) -> IntArray:
    start_ns, end_ns = usable_span(recording)
    return start_ns + INTERVAL_NS * np.arange((end_ns - start_ns) // INTERVAL_NS + 1)


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


def test_what_comes_too_late_is_counted_and_noted(recording: EventRecording) -> None:
    patient = ObservationStream(recording, FrontendConfig(), ends_of(recording))
    hasty = ObservationStream(recording, FrontendConfig(max_delay_s=0.0), ends_of(recording))
    list(patient)
    list(hasty)
    assert hasty.late > patient.late
    assert "max_delay_s = 0 s" in hasty.notes()[0]
    assert hasty.observations().size < patient.observations().size


def test_word_of_unused_tracks_takes_effect_at_a_fixed_time(recording: EventRecording) -> None:
    """However slow the reader is, and only from the sixth batch after the word on."""
    few = FrontendConfig(max_features=20)

    def batches(unused: float, wait_s: float) -> list[RecordArray]:
        stream, found = ObservationStream(recording, few, ends_of(recording)), []
        for batch in stream:
            time.sleep(wait_s)
            stream.set_outlier_share(unused if len(found) == 1 else 0.0)
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


def test_stopping_early_ends_the_thread(recording: EventRecording) -> None:
    stream = iter(ObservationStream(recording, FrontendConfig(), ends_of(recording)))
    next(stream)
    stream.close()  # type: ignore[attr-defined]


def test_an_error_of_the_front_end_reaches_the_caller(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RecordingError("broken")

    stream = ObservationStream(recording, FrontendConfig(), ends_of(recording))
    monkeypatch.setattr(stream._frontend, "process", broken)
    with pytest.raises(RecordingError, match="broken"):
        list(stream)


def test_events_need_an_imu_and_a_calibration(recording: EventRecording) -> None:
    with pytest.raises(RecordingError, match="no samples of the gyroscope"):
        usable_span(replace(recording, gyroscope=np.empty(0, dtype=INERTIAL_DTYPE)))
    with pytest.raises(RecordingError, match="without a whole calibration"):
        usable_span(replace(recording, calibration=None))
    with pytest.raises(RecordingError, match="no events"):
        usable_span(replace(recording, events=recording.events[:0]))


def test_given_again_the_batches_are_the_same(recording: EventRecording) -> None:
    ends_ns = ends_of(recording)
    stream = ObservationStream(recording, FrontendConfig(), ends_ns)
    batches = list(stream)
    replayed = ReplayedStream(stream.observations(), ends_ns)
    for a, b in zip(batches, replayed, strict=True):
        assert a.tobytes() == b.tobytes()
    assert replayed.observations().tobytes() == stream.observations().tobytes()


def test_a_run_on_known_observations_gets_the_same_packets(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[list[Packet]] = []

    class Remembers(FakeOdometry):
        def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
            seen[-1].append(packet)
            return super().process(packet)

    monkeypatch.setattr(pipeline, "Odometry", Remembers)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    seen.append([])
    tracked = pipeline.run_recording(recording, Config())
    seen.append([])
    again = pipeline.run_recording(recording, Config(), observations=tracked.observations)
    assert len(seen[0]) == len(seen[1]) > 5
    for a, b in zip(*seen, strict=True):
        assert (a.t_end_ns, a.events) == (b.t_end_ns, b.events)
        assert a.observations.tobytes() == b.observations.tobytes()
        assert a.gyroscope.tobytes() == b.gyroscope.tobytes()
    assert again.observations.size == tracked.observations.size > 0
    assert again.summary.frontend_s == 0.0


def test_a_run_hears_what_the_estimator_refuses(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More features are followed for it, and two runs are alike to the bit."""

    class Refuses(FakeOdometry):
        share = 0.5

        def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
            estimates, report = super().process(packet)
            return estimates, replace(report, outlier_share=self.share)

    class RefusesNone(Refuses):
        share = 0.0

    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    config = Config(frontend=FrontendConfig(max_features=20))
    observed = []
    for estimator in (Refuses, Refuses, RefusesNone):
        monkeypatch.setattr(pipeline, "Odometry", estimator)
        observed.append(pipeline.run_recording(recording, config).observations)
    assert observed[0].tobytes() == observed[1].tobytes()
    tracks = [np.unique(o["id"]).size for o in observed]
    assert tracks[0] > 1.2 * tracks[2]
