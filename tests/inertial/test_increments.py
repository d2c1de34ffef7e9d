"""Invalid input of preintegration raises an error that describes it: one test for each check."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from asyneio.errors import InertialError
from asyneio.inertial.gp_preintegration import gp_preintegration
from asyneio.inertial.increments import ImuWindow, Preintegration, SampleNoise
from asyneio.inertial.preintegration import midpoint, zero_order_hold
from asyneio.inertial.smoothness import Smoothness

from .windows import Array, noise_at, shaken, window_of

RULES = [midpoint, zero_order_hold, gp_preintegration]


def samples(count: int = 21, duration: float = 0.1) -> dict[str, Array]:
    t = np.linspace(0.0, duration, count)
    return {
        "gyroscope_t": t,
        "gyroscope": np.ones((count, 3)),
        "accelerometer_t": t.copy(),
        "accelerometer": np.ones((count, 3)),
    }


def test_good_samples_are_accepted() -> None:
    window = ImuWindow(**samples(), duration=0.1)
    assert window.gyroscope.shape == (21, 3)


@pytest.mark.parametrize("sensor", ["gyroscope", "accelerometer"])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, y: (t[:1], y[:1]), "1 samples"),
        (lambda t, y: (t[:0], y[:0]), "0 samples"),
        (lambda t, y: (t, y[:-1]), r"shape \(20, 3\)"),
        (lambda t, y: (t, y[:, :2]), r"shape \(21, 2\)"),
        (lambda t, y: (np.sort(np.append(t[1:], t[3])), y), "does not come after"),
        (lambda t, y: (t[::-1], y), "does not come after"),
        (lambda t, y: (np.append(t[:-1], np.nan), y), "sample 20"),
        (lambda t, y: (t, np.where(np.arange(21)[:, None] == 7, np.inf, y)), "sample 7"),
        (lambda t, y: (t[4:], y[4:]), "do not cover"),
        (lambda t, y: (t[:-4], y[:-4]), "do not cover"),
    ],
)
def test_bad_samples_are_refused(
    sensor: str, change: Callable[[Array, Array], tuple[Array, Array]], words: str
) -> None:
    given = samples()
    given[f"{sensor}_t"], given[sensor] = change(given[f"{sensor}_t"], given[sensor])
    with pytest.raises(InertialError, match=words) as caught:
        ImuWindow(**given, duration=0.1)
    assert sensor in str(caught.value)


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf])
def test_bad_durations_are_refused(duration: float) -> None:
    with pytest.raises(InertialError, match="interval lasts"):
        ImuWindow(**samples(), duration=duration)


def test_three_missing_periods_are_still_covered() -> None:
    given = samples()
    for name in given:
        given[name] = given[name][3:-3]
    window = ImuWindow(**given, duration=0.1)
    noise = SampleNoise(1e-3, 1e-2)
    for rule in RULES:
        found = rule(window, np.zeros(6), noise).end()
        assert np.isfinite(found.r).all()


@pytest.mark.parametrize("bad", [0.0, -1e-3, np.nan, np.inf])
def test_bad_noise_is_refused(bad: float) -> None:
    with pytest.raises(InertialError, match="gyroscope sample"):
        SampleNoise(bad, 1e-2)
    with pytest.raises(InertialError, match="accelerometer sample"):
        SampleNoise(1e-3, bad)
    with pytest.raises(InertialError, match="gyroscope's process"):
        Smoothness(bad, 1.0)
    with pytest.raises(InertialError, match="accelerometer's process"):
        Smoothness(1.0, bad)


@pytest.mark.parametrize("rule", RULES)
def test_bad_bias_and_times_are_refused(
    rule: Callable[[ImuWindow, Array, SampleNoise], Preintegration],
) -> None:
    window, noise = window_of(shaken(0), 0.1, 200.0), noise_at(200.0)
    for bias in (np.zeros(3), np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0])):
        with pytest.raises(InertialError, match="six finite numbers"):
            rule(window, bias, noise)
    found = rule(window, np.zeros(6), noise)
    for tau in (-1e-6, 0.1 + 1e-6, np.nan):
        with pytest.raises(InertialError, match="between 0 and"):
            found.at(np.array([0.05, tau]))
        with pytest.raises(InertialError, match="between 0 and"):
            found.covariance(tau)
    np.testing.assert_array_equal(found.bias, np.zeros(6))
    assert found.duration == 0.1
