"""An inverted accelerometer is named as the cause of a run that does not initialize; other causes are not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from asyneio.pipeline import run_recording
from asyneio.types import Recording
from tests.odometry.runs import configured, simulated

INVERTED = "the accelerometer is inverted: with the opposite sign of all its axes"


def inverted(recording: Recording) -> Recording:
    accelerometer = recording.accelerometer.copy()
    accelerometer["xyz"] *= -1.0
    return replace(recording, accelerometer=accelerometer)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulated().recording


def test_an_inverted_accelerometer_is_named(recording: Recording) -> None:
    result = run_recording(inverted(recording), configured())
    assert not result.run.estimates
    assert "the estimator did not initialize" in result.summary.failure
    assert INVERTED in result.summary.failure
    assert "multiply the readings by -1" in result.summary.failure


def test_other_causes_are_not_called_inverted(recording: Recording) -> None:
    backwards = recording.gyroscope.copy()
    backwards["xyz"] *= -1.0
    few = recording.observations[recording.observations["id"] % 40 == 0]
    causes = (replace(recording, observations=few), replace(recording, gyroscope=backwards))
    for changed in (*causes, inverted(causes[0])):
        result = run_recording(changed, configured())
        assert "the estimator did not initialize" in result.summary.failure
        assert "inverted" not in result.summary.failure


def test_a_run_that_initializes_is_not_repeated(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> str:
        raise AssertionError("repeated")

    monkeypatch.setattr("asyneio.pipeline.run.inverted_accelerometer", never)
    assert not run_recording(recording, configured()).summary.failure
