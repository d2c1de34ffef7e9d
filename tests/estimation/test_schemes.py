"""Measurements of each inertial scheme from the samples of one interval."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from asyneio.errors import EstimationError
from asyneio.estimation.problem.schemes import SCHEMES, IntervalInertial, measure
from asyneio.inertial.increments import ImuWindow, SampleNoise
from asyneio.inertial.noise import InertialNoise, SensorNoise
from asyneio.inertial.projection import NODES
from asyneio.types import INERTIAL_DTYPE, RecordArray
from tests.inertial.windows import difference, noise_at, shaken, true_increments, window_of

Array = NDArray[np.float64]

MS = 1_000_000
START = 1_600_000_000_123_456_789
DURATION_NS = 100 * MS
BOUNDS = (START, START + DURATION_NS)
#: White noise of single samples, and the same as densities at the rates of `regular`.
NOISE = SampleNoise(0.01, 0.1)
DENSITIES = (0.01 / np.sqrt(200.0), 0.1 / np.sqrt(250.0))
BIAS = np.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.05])
PREINTEGRATING = ["gpp", "preint", "extpreint"]
every_rule = pytest.mark.parametrize("name", PREINTEGRATING)


def stream(t_ns: Array, size: float) -> RecordArray:
    """A smooth signal sampled at `t_ns` after the start of the interval."""
    out = np.zeros(len(t_ns), dtype=INERTIAL_DTYPE)
    out["t_ns"] = START + t_ns.astype(np.int64)
    t = np.asarray(t_ns) * 1e-9
    out["xyz"] = size * np.column_stack([np.sin(20.0 * t), np.cos(13.0 * t), np.sin(9.0 * t + 1.0)])
    return out


def regular() -> tuple[RecordArray, RecordArray]:
    """From four samples before the interval to its end, at 200 and 250 Hz."""
    gyroscope = stream(np.arange(-18 * MS, DURATION_NS + 1, 5 * MS), 1.0)
    return gyroscope, stream(np.arange(-15 * MS, DURATION_NS + 1, 4 * MS), 10.0)


def white(factor: float = 1.0) -> InertialNoise:
    first, second = DENSITIES
    return InertialNoise(SensorNoise(factor * first, 200.0), SensorNoise(factor * second, 250.0))


def measured(name: str, streams: tuple[RecordArray, RecordArray], inflation: float = 1.0) -> IntervalInertial:
    """With noise that is larger than the sensor's own by a factor."""
    return measure(SCHEMES[name], *streams, BOUNDS, BIAS, white(inflation), inflation)


def by_hand(streams: tuple[RecordArray, RecordArray]) -> ImuWindow:
    parts = [part for s in streams for part in ((s["t_ns"] - START) * 1e-9, s["xyz"])]
    return ImuWindow(*parts, DURATION_NS * 1e-9)


def variance(name: str, streams: tuple[RecordArray, RecordArray]) -> Array:
    """Of phi, nu, r, the smallest of the three axes."""
    covariance = measured(name, streams).covariance
    assert covariance is not None
    np.linalg.cholesky(covariance)
    return covariance.diagonal().reshape(3, 3).min(axis=1)


#: Sample times after the start of the interval, its ends often among them.
times = st.lists(
    st.one_of(st.sampled_from([0, DURATION_NS]), st.integers(-20 * MS, 120 * MS)), max_size=12, unique=True
).map(lambda t: np.array(sorted(t), dtype=np.int64))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(gyroscope_ns=times, accelerometer_ns=times, inflation=st.floats(0.1, 10.0))
def test_gpif_takes_what_lies_inside(gyroscope_ns: Array, accelerometer_ns: Array, inflation: float) -> None:
    streams = stream(gyroscope_ns, 1.0), stream(accelerometer_ns, 10.0)
    found = measured("gpif", streams, inflation)
    assert found.preintegration is None
    assert found.covariance is None
    sensors = zip(
        streams, (found.gyroscope, found.accelerometer), (NOISE.gyroscope, NOISE.accelerometer), strict=True
    )
    for given_samples, passed, sigma in sensors:
        inside = (given_samples["t_ns"] > BOUNDS[0]) & (given_samples["t_ns"] <= BOUNDS[1])
        if np.count_nonzero(inside) <= NODES:
            np.testing.assert_array_equal(passed.t_ns, given_samples["t_ns"][inside])
            np.testing.assert_array_equal(passed.value, given_samples["xyz"][inside])
            root = np.eye(np.count_nonzero(inside)) / (inflation * sigma)
            np.testing.assert_allclose(passed.root, root, rtol=1e-12)
        else:
            # Their joint information: `tests/inertial/test_projection.py`.
            assert len(passed.t_ns) <= NODES
            assert passed.t_ns.min() >= BOUNDS[0]
            assert passed.t_ns.max() <= BOUNDS[1]


@every_rule
def test_increments_are_the_rules(name: str) -> None:
    """On the same samples, those before the interval included."""
    streams = regular()
    found, rule = measured(name, streams), SCHEMES[name].rule
    assert found.preintegration is not None
    assert rule is not None
    expected = rule(by_hand(streams), BIAS, NOISE)
    for a, b in zip(found.preintegration.end(), expected.end(), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(found.preintegration.bias, BIAS)
    np.testing.assert_allclose(found.covariance, expected.covariance(DURATION_NS * 1e-9), rtol=1e-9)
    inside = tuple(s[s["t_ns"] > START] for s in streams)
    without = rule(by_hand(inside), BIAS, NOISE).end()
    assert np.abs(difference(without, found.preintegration.end())).max() > 1e-6


@every_rule
def test_inflation_scales_the_covariance_by_its_square(name: str) -> None:
    plain, inflated = measured(name, regular()), measured(name, regular(), 3.0)
    assert plain.covariance is not None
    np.testing.assert_allclose(inflated.covariance, 9.0 * plain.covariance, rtol=1e-12)
    assert plain.preintegration is not None
    assert inflated.preintegration is not None
    np.testing.assert_array_equal(inflated.preintegration.end().r, plain.preintegration.end().r)


@pytest.mark.parametrize("name", ["gpp", "preint"])
def test_others_have_no_factors_on_the_trajectory(name: str) -> None:
    found = measured(name, regular())
    assert len(found.gyroscope.t_ns) == len(found.accelerometer.t_ns) == 0


@pytest.mark.parametrize("period_ms", [1.0, 4.0, 7.0])
def test_fits_at_the_ends_are_least_squares_lines(period_ms: float) -> None:
    """Through the samples within 15 ms, or the nearest three; twice their variance, plus curvature."""
    rng = np.random.default_rng(5)
    t_ns = np.arange(-20.0, 100.0, period_ms) * MS + 0.3 * MS
    streams = stream(t_ns, 1.0), stream(t_ns[::2] + 0.2 * MS, 10.0)
    for samples in streams:
        samples["xyz"] += 0.1 * rng.normal(size=samples["xyz"].shape)
    found = measured("extpreint", streams, 2.0)
    for samples, fits, sigma, bend in (
        (streams[0], found.gyroscope, 2.0 * NOISE.gyroscope, 200.0),
        (streams[1], found.accelerometer, 2.0 * NOISE.accelerometer, 1000.0),
    ):
        np.testing.assert_array_equal(fits.t_ns, BOUNDS)
        inside = samples[(samples["t_ns"] > START) & (samples["t_ns"] <= BOUNDS[1])]
        for end in (0, 1):
            distance = np.abs(inside["t_ns"] - BOUNDS[end]) * 1e-9
            order = np.argsort(distance)
            near = order[: max(3, np.count_nonzero(distance <= 0.015))]
            for axis in range(3):
                line, covariance = np.polyfit(distance[near], inside["xyz"][near, axis], 1, cov="unscaled")
                np.testing.assert_allclose(fits.value[end, axis], line[1], atol=1e-12)
            bent = bend * distance[near].max() ** 2 / 6.0
            expected = np.sqrt(2.0 * covariance[1, 1] * sigma**2 + bent**2)
            assert 1.0 / fits.root[end, end] == pytest.approx(expected, rel=1e-9)


def test_no_fit_where_nothing_is_near() -> None:
    """No rate at an end without samples within 15 ms, nor from a single sample."""
    gyroscope, accelerometer = regular()
    late = gyroscope[gyroscope["t_ns"] > START + 20 * MS]
    single = accelerometer[-1:]
    found = measured("extpreint", (late, single))
    np.testing.assert_array_equal(found.gyroscope.t_ns, BOUNDS[1:])
    assert len(found.accelerometer.t_ns) == 0
    assert found.preintegration is not None


@pytest.mark.parametrize("sensor", [0, 1])
@pytest.mark.parametrize("gap_ms", [(-20, 30), (30, 65), (60, 101), (1, 101)], ids=str)
@every_rule
def test_gaps_inflate_the_covariance(name: str, gap_ms: tuple[int, int], sensor: int) -> None:
    """Missing ends and gaps inside: an unmeasured rotation affects all increments, an unmeasured acceleration
    all but the rotation."""
    streams = list(regular())
    whole = variance(name, regular())
    t = (streams[sensor]["t_ns"] - START) / MS
    streams[sensor] = streams[sensor][(t < gap_ms[0]) | (t >= gap_ms[1])]
    bare = variance(name, (streams[0], streams[1]))
    touched = slice(0, 3) if sensor == 0 else slice(1, 3)
    assert (bare[touched] > 10.0 * whole[touched]).all()
    np.testing.assert_array_less(0.9 * whole, bare)


@pytest.mark.parametrize("sensors", [(0,), (1,), (0, 1)], ids=["gyroscope", "accelerometer", "both"])
@pytest.mark.parametrize("gap_ms", [(20, 70), (45, 101)], ids=str)
@pytest.mark.parametrize("name", ["gpp", "preint"])
def test_errors_in_gaps_are_within_what_is_claimed(
    name: str, gap_ms: tuple[int, int], sensors: tuple[int, ...]
) -> None:
    """Fast motions with 50 ms of a sensor or both missing, errors in units of the claimed covariance."""
    noise, errors = noise_at(200.0), []
    for seed in range(20):
        motion = shaken(seed)
        window = window_of(motion, 0.1, 200.0, noise=noise, seed=seed)
        streams = []
        for sensor, (t, value) in enumerate(
            ((window.gyroscope_t, window.gyroscope), (window.accelerometer_t, window.accelerometer))
        ):
            lost = (sensor in sensors) & (t > gap_ms[0] * 1e-3) & (t < gap_ms[1] * 1e-3)
            keep = (t < 0.1 + 1e-9) & ~lost
            samples = np.zeros(np.count_nonzero(keep), dtype=INERTIAL_DTYPE)
            samples["t_ns"], samples["xyz"] = START + np.rint(t[keep] * 1e9).astype(np.int64), value[keep]
            streams.append(samples)
        sensors = (
            SensorNoise(sigma / np.sqrt(200.0), 200.0) for sigma in (noise.gyroscope, noise.accelerometer)
        )
        found = measure(SCHEMES[name], *streams, BOUNDS, np.zeros(6), InertialNoise(*sensors), 1.0)
        assert found.preintegration is not None
        error = difference(true_increments(motion, np.array([0.1])), found.preintegration.end())[0]
        errors.append(error**2 / found.covariance.diagonal())
    # The midpoint rule's own error at 200 Hz on such motion is three times what the noise explains.
    limit = 3.0 if name == "gpp" else 15.0
    assert np.mean(errors, axis=0).max() < limit


masks = st.lists(st.booleans(), min_size=20, max_size=20).map(np.array).filter(np.any)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(gyroscope=masks, accelerometer=masks, name=st.sampled_from(PREINTEGRATING))
def test_no_loss_of_samples_raises(gyroscope: Array, accelerometer: Array, name: str) -> None:
    """Any samples may be missing, as long as each sensor has one in the interval or shortly before."""
    grid_ns = np.arange(-19 * MS, DURATION_NS, 6 * MS)
    streams = stream(grid_ns[gyroscope], 1.0), stream(grid_ns[accelerometer], 10.0)
    found = measured(name, streams)
    assert found.preintegration is not None
    at = found.preintegration.at(np.linspace(0.0, found.preintegration.duration, 5))
    assert all(np.isfinite(part).all() for part in at)
    assert (variance(name, streams) > 0.0).all()


@pytest.mark.parametrize("missing", [(0,), (1,), (0, 1)], ids=["gyroscope", "accelerometer", "both"])
def test_no_samples_at_all(missing: tuple[int, ...]) -> None:
    first, second = (s[:0] if n in missing else s for n, s in enumerate(regular()))
    for name in ("preint", "extpreint"):
        found = measured(name, (first, second))
        assert found.preintegration is None
        assert found.covariance is None
        if name == "extpreint":
            # The other sensor's rates at the ends are still factors.
            assert [len(d.t_ns) for d in (found.gyroscope, found.accelerometer)] == [
                0 if n in missing else 2 for n in (0, 1)
            ]
    with pytest.raises(EstimationError) as caught:
        measured("gpp", (first, second))
    message = str(caught.value)
    assert f"between {BOUNDS[0]} and {BOUNDS[1]} ns" in message
    assert "gpp has nothing else to tie two knots" in message
    assert "use gpif" in message
