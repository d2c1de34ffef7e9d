"""Pixels and readout, one effect at a time: ramp response, latency, threshold noise, lamps, a limited bus."""

import dataclasses
import functools
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from asyneio.simulation import SensorSpec, simulate_events
from asyneio.simulation.events import source
from asyneio.simulation.events.readout import Readout, ReadoutCounts
from asyneio.simulation.events.response import (
    Curve,
    Light,
    Span,
    Square,
    curve_value,
    first_crossing,
    light_at,
    respond,
)
from asyneio.simulation.events.sensor import Circuit, EventBuffer, Pixels, make_pixels
from asyneio.simulation.events.source import Seeds, event_chunks, set_stage
from asyneio.types import CameraIntrinsics, FloatArray, IntArray, RecordArray
from tests.simulation.event_worlds import IDEAL, SMALL, drifting, small_scenario

SQUARE = CameraIntrinsics(60.0, 60.0, 31.5, 31.5, 64, 64)
STEADY = Light(1.0, 0.0, 0.0)
EQUAL = dataclasses.replace(IDEAL, threshold_mismatch=0.0, dark_intensity=0.0)


def drive(
    spec: SensorSpec, intensity: Callable[[float], float], t_us: FloatArray, light: Light = STEADY
) -> tuple[Pixels, IntArray, IntArray]:
    """Pixels, times [us] and pixels of the events after all of them saw a uniform picture at some times."""
    picture = np.full((64, 64), intensity(t_us[0]), np.float32)
    pixels = make_pixels(spec, SQUARE, picture, light.illumination, np.random.default_rng(0))
    buffer, t, k = EventBuffer.of_size(1 << 20), [], []
    for begin, end in pairwise(t_us):
        picture[:] = intensity(end)
        count = respond(
            picture, light, Square(0, 0, 64), Span(begin, end), Circuit.of(spec), pixels, buffer, 0
        )
        t.append(buffer.t_us[:count].copy())
        k.append(buffer.pixel[:count].copy())
    return pixels, np.concatenate(t), np.concatenate(k)


def ramp(t: float) -> float:
    """1.2 log units in 20 ms."""
    return 0.2 * float(np.exp(6e-5 * t))


@pytest.mark.parametrize("step_us", [50.0, 1000.0, 20000.0])
def test_the_photoreceptor_answers_a_ramp_as_the_formula_says(step_us: float) -> None:
    # So slow that the least bandwidth counts, which does not depend on light.
    spec = dataclasses.replace(EQUAL, bandwidth_hz=1e-6, least_bandwidth_hz=50.0)
    w, q, t_us = 2e-6 * np.pi * 50.0, 6e-5, np.arange(0.0, 20001.0, step_us)

    def level(t: float) -> float:
        return float(np.log(0.2) + q * t - q / w * (1.0 - np.exp(-w * t)))

    # A ramp of the logarithm is seen as one only where its ends are near: a long step is linear in intensity.
    drawn = ramp if step_us <= 1000.0 else (lambda t: 0.2 + (ramp(20000.0) - 0.2) * t / 20000.0)
    pixels, t, k = drive(spec, drawn, t_us)
    if step_us <= 1000.0:
        np.testing.assert_allclose(pixels.level, level(20000.0), atol=1e-4)
        expected = [brentq(lambda s, n=n: level(s) - level(0.0) - 0.25 * n, 0.0, 2e4) for n in (1, 2, 3, 4)]
        np.testing.assert_allclose(t[k == 7], expected, atol=1.5)
    else:
        fine, _, _ = drive(spec, drawn, np.arange(0.0, 20001.0, 20.0))
        np.testing.assert_allclose(pixels.level, fine.level, atol=5e-3)


@given(st.floats(-2.0, 2.0), st.floats(-1e-3, 1e-3), st.floats(-2.0, 2.0), st.floats(1e-4, 0.02))
def test_a_crossing_is_the_first_one(offset: float, slope: float, swing: float, rate: float) -> None:
    curve = Curve(0.0, offset, slope, swing, rate)
    start = curve_value(curve, 0.0)
    upper, lower = start + 0.25, start - 0.22
    grid = np.linspace(0.0, 1000.0, 20001)
    level = offset + slope * grid + swing * np.exp(-rate * grid)
    outside = np.flatnonzero((level >= upper) | (level <= lower))
    t, way = first_crossing(curve, 0.0, 1000.0, upper, lower)
    if outside.size:
        assert way == (1 if level[outside[0]] >= upper else -1)
        assert t == pytest.approx(grid[outside[0]], abs=0.3)
    elif way:
        # Between two points of the grid.
        value = curve_value(curve, t)
        assert value == pytest.approx(upper if way > 0 else lower, abs=1e-3)


def test_the_comparator_answers_late_and_with_jitter() -> None:
    spec = dataclasses.replace(EQUAL, latency_s=200e-6, latency_jitter_s=40e-6)
    t_us = np.arange(0.0, 20001.0, 100.0)
    crossing = drive(EQUAL, ramp, t_us)[1][0]
    _, t, k = drive(spec, ramp, t_us)
    first = t[np.unique(k, return_index=True)[1]] - crossing
    assert first.mean() == pytest.approx(200.0, abs=3.0)
    assert first.std() == pytest.approx(40.0, rel=0.05)
    assert abs(np.mean(((first - first.mean()) / first.std()) ** 3)) < 0.15
    # Without jitter all answer together; the clock cuts off fractions of a microsecond.
    _, t, k = drive(dataclasses.replace(spec, latency_jitter_s=0.0), ramp, t_us)
    np.testing.assert_allclose(t[np.unique(k, return_index=True)[1]], crossing + 200, atol=1)


def test_each_event_has_a_threshold_of_its_own_and_errors_do_not_add_up() -> None:
    spec = dataclasses.replace(EQUAL, threshold_noise=0.02)
    _, t, k = drive(spec, ramp, np.arange(0.0, 20001.0, 100.0))
    climbed = 6e-5 * t
    for n in (1, 2, 3, 4):
        nth = [climbed[k == pixel][n - 1] for pixel in range(0, 4096, 3)]
        assert np.mean(nth) == pytest.approx(0.25 * n, abs=2e-3)
        assert np.std(nth) == pytest.approx(0.02, rel=0.08)
    _, t, k = drive(EQUAL, ramp, np.arange(0.0, 20001.0, 100.0))
    assert np.unique(t).size == 4


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [100.0, 120.0])
def test_lamps_make_events_at_their_frequency_where_nothing_moves(rate_hz: float) -> None:
    depth, period_us = 0.5, 1e6 / rate_hz
    light = Light(1.0, rate_hz * 1e-6, depth)
    samples = np.array([light_at(light, t) for t in np.linspace(0.0, period_us, 4001)[:-1]])
    assert samples.mean() == pytest.approx(1.0, abs=1e-4)
    assert samples.min() == pytest.approx(1.0 - depth, abs=1e-3)
    assert samples.max() == pytest.approx(1.0 - depth + 0.5 * np.pi * depth, abs=1e-4)
    # Rendered as rarely as a static scene is.
    # With equal thresholds each period is like the one before.
    spec = dataclasses.replace(EQUAL, threshold_on=0.23, threshold_off=0.23)
    _, t, k = drive(spec, lambda _: 0.4, np.arange(0.0, 200_001.0, 10_000.0), light)
    swing = np.log(samples.max() / samples.min())
    one = t[k == 5]
    per_period = one.size / (0.2 * rate_hz)
    # As often as the thresholds fit into the swing, up and down.
    assert swing / 0.23 - 1.3 < per_period / 2.0 < swing / 0.23 + 0.1
    late = one[one > 3.0 * period_us]
    count = round(per_period)
    np.testing.assert_allclose(late[count:] - late[:-count], period_us, atol=30.0)
    assert drive(spec, lambda _: 0.4, np.arange(0.0, 200_001.0, 10_000.0))[1].size == 0


@pytest.mark.slow
def test_a_scenario_has_lamps() -> None:
    seeds = Seeds.of(0)
    stage = dataclasses.replace(
        set_stage(small_scenario(sensor=IDEAL), seeds), motion=drifting((0.0, 0.0, 0.0))
    )
    lit = dataclasses.replace(stage, scenario=dataclasses.replace(stage.scenario, flicker_depth=0.3))
    steady, flickering = (np.concatenate(list(event_chunks(one, seeds.sensor))) for one in (stage, lit))
    assert steady.size == 0
    # From 0.7 to 1.17: a swing of twice the threshold, hundred times a second, at every pixel.
    assert 2 * 30 * 7200 * 0.9 < flickering.size < 6 * 30 * 7200


def crowd(count: int, span_us: int, rng: np.random.Generator) -> list[EventBuffer]:
    """Events of random pixels of `SMALL` in disorder; in two parts."""
    t = rng.integers(0, span_us, count)
    pixel = rng.integers(0, SMALL.width * SMALL.height, count).astype(np.int32)
    on = rng.integers(0, 2, count).astype(np.uint8)
    half = count // 2
    return [EventBuffer(t[:half], pixel[:half], on[:half]), EventBuffer(t[half:], pixel[half:], on[half:])]


def read(spec: SensorSpec, parts: list[EventBuffer], cuts: list[int]) -> tuple[RecordArray, ReadoutCounts]:
    readout = Readout(spec, SMALL, 0, 1_000_000)
    chunks, before = [], -1
    for cut in cuts:
        new = [EventBuffer(*(c[(p.t_us > before) & (p.t_us <= cut)] for c in p)) for p in parts]
        chunks.append(readout.deliver(new, cut))
        before = cut
    return np.concatenate(chunks), readout.counts


def most_within(t_us: IntArray, window_us: int) -> int:
    return int(np.max(np.arange(1, t_us.size + 1) - np.searchsorted(t_us, t_us - window_us, side="right")))


def test_the_array_serves_no_faster_than_it_can(rng: np.random.Generator) -> None:
    parts = crowd(30_000, 10_000, rng)
    events, counts = read(dataclasses.replace(IDEAL, readout_hz=1e6), parts, [200_000])
    t_us = events["t_ns"] // 1000
    assert np.all(np.diff(t_us) >= 0)
    for window_us in (1, 10, 1000):
        assert most_within(t_us, window_us) <= window_us + 1
    # Three times as many as it can serve: most wait, and a pixel that waits has nothing else to say.
    assert counts.lost_in_array > 1000
    assert counts.lost_on_bus == 0
    assert counts.read == events.size == 30_000 - counts.dropped
    assert counts.delayed > 0.9 * counts.read
    assert t_us[-1] > 14_000


def test_the_bus_drops_what_its_memory_cannot_hold(rng: np.random.Generator) -> None:
    parts = crowd(30_000, 10_000, rng)
    spec = dataclasses.replace(IDEAL, bus_hz=1e6, bus_buffer=500)
    events, counts = read(spec, parts, [200_000])
    t_us = events["t_ns"] // 1000
    for window_us in (10, 1000, 10_000):
        assert most_within(t_us, window_us) <= window_us + 500 + 1
    assert events.size == pytest.approx(10_500, abs=20)
    assert counts.lost_on_bus == counts.dropped == 30_000 - events.size
    assert counts.delayed == 0


def test_no_limit_loses_nothing_and_cuts_change_nothing(rng: np.random.Generator) -> None:
    parts = crowd(5_000, 10_000, rng)
    everything, counts = read(IDEAL, parts, [200_000])
    assert everything.size == 5_000
    assert counts == ReadoutCounts(read=5_000)
    spec = dataclasses.replace(IDEAL, readout_hz=3e5, bus_hz=2e5, bus_buffer=100)
    whole, counted = read(spec, parts, [200_000])
    pieces, also = read(spec, parts, [1000, 1001, 5000, 9000, 200_000])
    np.testing.assert_array_equal(whole, pieces)
    assert counted == also
    assert counted.lost_in_array > 0
    assert counted.lost_on_bus > 0


@pytest.mark.slow
def test_a_run_reports_what_its_readout_lost() -> None:
    free = simulate_events(small_scenario())
    assert free.readout is not None
    assert free.readout.read == free.recording.events.size
    assert free.readout.dropped == 0
    sensor = SensorSpec(bus_hz=20_000.0, bus_buffer=50)
    bound = simulate_events(small_scenario(sensor=sensor))
    assert bound.readout is not None
    assert bound.readout.lost_on_bus == free.recording.events.size - bound.recording.events.size > 0
    assert most_within(bound.recording.events["t_ns"] // 1000, 100_000) <= 2051


@pytest.mark.slow
def test_threads_ranges_and_buffers_do_not_change_the_events(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = Seeds.of(3)
    stage = set_stage(small_scenario(duration_s=0.1), seeds)
    usual = np.concatenate(list(event_chunks(stage, seeds.sensor)))
    monkeypatch.setattr(source, "_THREADS", 1)
    monkeypatch.setattr(source, "_RANGES", 3)
    monkeypatch.setattr(source, "_BUFFER", 64 * 128 + 10)
    alone = np.concatenate(list(event_chunks(stage, seeds.sensor)))
    np.testing.assert_array_equal(usual, alone)


@functools.cache
def paced(step_px: float, longest_s: float) -> RecordArray:
    """A tenth of a second of fast motion; light, circuit and thresholds alone decide about events."""
    sensor = dataclasses.replace(IDEAL, bandwidth_hz=4000.0, refractory_s=0.0015)
    scenario = small_scenario(
        motion="aggressive",
        motion_scale=0.3,
        sensor=sensor,
        duration_s=0.1,
        largest_step_px=step_px,
        longest_step_s=longest_s,
    )
    seeds = Seeds.of(5)
    return np.concatenate(list(event_chunks(set_stage(scenario, seeds), seeds.sensor)))


def unmatched(events: RecordArray, reference: RecordArray) -> tuple[float, FloatArray]:
    """Share of the reference's events that have no like within 1 ms, and errors [us] of the others."""
    errors: list[FloatArray] = []
    for polarity in (0, 1):
        keys = []
        for one in (reference, events):
            one = one[one["p"] == polarity]
            pixel = one["y"].astype(np.int64) * SMALL.width + one["x"]
            keys.append(np.sort(pixel * 1_000_000_000 + one["t_ns"] - events["t_ns"][0]))
        place = np.searchsorted(keys[1], keys[0])
        near = [np.abs(keys[1][np.clip(place + d, 0, keys[1].size - 1)] - keys[0]) for d in (-1, 0)]
        errors.append(np.minimum(*near) / 1000.0)
    error = np.concatenate(errors)
    return float(np.mean(error > 1000.0)), error[error <= 1000.0]


@pytest.mark.slow
def test_the_usual_steps_make_the_events_of_steps_of_25_microseconds() -> None:
    step_px = small_scenario().largest_step_px
    assert step_px <= 0.2
    reference = paced(1e9, 25e-6)
    assert reference.size > 10_000
    events = paced(step_px, 0.010)
    lost, error_us = unmatched(events, reference)
    coarse_lost, coarse_us = unmatched(paced(0.8, 0.010), reference)
    assert events.size == pytest.approx(reference.size, rel=0.01)
    # Fine texture a metre away: an order of magnitude more events a second than in a room.
    assert lost < 0.035
    assert np.median(error_us) < 25.0
    assert np.percentile(error_us, 99) < 650.0
    assert lost < 0.2 * coarse_lost
    assert np.median(error_us) < 0.2 * np.median(coarse_us)
