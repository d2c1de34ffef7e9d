"""The odometry under each inertial scheme: near the ground truth, and through lost samples."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.estimation.problem.schemes import SCHEMES
from asyneio.evaluation import NEES_DOF, NeesBlock, nees
from asyneio.types import Health, Recording
from tests.odometry.runs import Outcome, as_bytes, configured, cut, errors, process, run, simulated
from tests.odometry.test_faults import corrupted

#: GPIF is what every other test runs on.
OTHERS = [name for name in SCHEMES if name != "gpif"]
every_other = pytest.mark.parametrize("scheme", OTHERS)


def under(scheme: str) -> Config:
    return configured(inertial={"scheme": scheme})


@cache
def plain(scheme: str) -> Outcome:
    return run(simulated().recording, under(scheme))


@pytest.mark.slow
@every_other
def test_stays_near_the_truth(scheme: str) -> None:
    outcome = plain(scheme)
    assert outcome.reports[-1].health is Health.TRACKING
    assert outcome.estimates[0].t_ns - simulated().truth.start_ns < 2_000_000_000
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.07
    assert e.tilt < 1.0
    assert e.rotation < 1.0
    assert e.velocity < 0.08


@every_other
def test_covariance_is_honest(scheme: str) -> None:
    for block, values in nees(plain(scheme).estimates, simulated().truth.at).values.items():
        # Position and yaw are relative to the first estimate's, which have a covariance of their own.
        if block is not NeesBlock.POSE:
            assert 0.01 < values.mean() / NEES_DOF[block] < 5.0, block


@pytest.mark.slow
@every_other
def test_schemes_differ_and_each_repeats_itself(scheme: str) -> None:
    again = run(simulated().recording, under(scheme))
    found = list(map(as_bytes, plain(scheme).estimates))
    assert list(map(as_bytes, again.estimates)) == found
    for other in SCHEMES:
        if other != scheme:
            assert as_bytes(plain(other).estimates[-1]) != found[-1]


def test_rates_at_the_knots_tell_extpreint_from_preint() -> None:
    """Fitted rates are what Preint lacks: its angular velocity is the motion prior's guess alone."""
    worst = {}
    for scheme in ("preint", "extpreint"):
        estimates = plain(scheme).estimates
        truth = simulated().truth.at([e.t_ns for e in estimates])
        error = np.array([e.angular_velocity_b for e in estimates]) - truth.angular_velocity_b
        worst[scheme] = np.abs(error).max()
    assert worst["extpreint"] < 0.05 < 0.1 < worst["preint"]


def lossy(recording: Recording) -> Recording:
    """A tenth of the inertial samples gone, each by chance, and 50 ms of both sensors at once."""
    rng = np.random.default_rng(1)
    burst_ns = simulated().truth.start_ns + 2_700_000_000 + np.array([0, 50_000_000])
    kept = []
    for samples in (recording.gyroscope, recording.accelerometer):
        lost = (samples["t_ns"] >= burst_ns[0]) & (samples["t_ns"] < burst_ns[1])
        kept.append(samples[~lost & (rng.random(len(samples)) > 0.1)])
        assert np.diff(kept[-1]["t_ns"]).max() >= 50_000_000
    return replace(recording, gyroscope=kept[0], accelerometer=kept[1])


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
def test_lost_samples_are_bridged(scheme: str) -> None:
    outcome = run(lossy(simulated().recording), under(scheme))
    assert outcome.reports[-1].health is Health.TRACKING
    assert len(outcome.estimates) >= len(plain(scheme).estimates) - 1
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.1
    assert e.tilt < 1.2
    assert e.velocity < 0.2


@pytest.mark.slow
@every_other
def test_a_silent_gyroscope_is_bridged(scheme: str) -> None:
    """0.2 s, two whole intervals: less sure of the attitude, but not lost."""
    packets = cut(simulated().recording)
    packets[25:27] = [replace(packet, gyroscope=packet.gyroscope[:0]) for packet in packets[25:27]]
    outcome = process(packets, simulated().recording.calibration, under(scheme))
    assert outcome.reports[-1].health is Health.TRACKING
    assert len(outcome.estimates) == len(plain(scheme).estimates)
    at = next(n for n, e in enumerate(outcome.estimates) if e.t_ns == packets[26].t_end_ns)
    unsure, sure = (o.estimates[at].covariance[:3, :3].trace() for o in (outcome, plain(scheme)))
    assert unsure > 1.5 * sure
    assert errors(simulated(), outcome.estimates).position < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("value", [np.nan, 1e16])
@pytest.mark.parametrize("stream", ["gyroscope", "accelerometer"])
@every_other
def test_a_corrupt_sample_is_left_out(scheme: str, stream: str, value: float) -> None:
    recording, bad = simulated().recording, 24
    packets = cut(recording)[: bad + 6]
    packets[bad] = corrupted(packets[bad], stream, value)
    outcome = process(packets, recording.calibration, under(scheme))
    good = [as_bytes(e) for step in plain(scheme).steps[:bad] for e in step]
    assert [as_bytes(e) for e in outcome.estimates][: len(good)] == good
    assert {report.health for report in outcome.reports[bad:]} == {Health.TRACKING}
    assert errors(simulated(), outcome.estimates).position < 0.08
