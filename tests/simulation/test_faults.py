"""Each fault does what it says to the records concerned and nothing to the others."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.errors import SimulationError
from asyneio.simulation import SCENARIOS, Simulation, faults, simulate, simulate_events
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, RecordArray
from tests.simulation.event_worlds import small_scenario


def readings(count: int = 1000, period_ns: int = 10) -> RecordArray:
    records = np.zeros(count, dtype=INERTIAL_DTYPE)
    records["t_ns"] = period_ns * np.arange(count)
    records["xyz"] = np.random.default_rng(1).normal(size=(count, 3))
    return records


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate(dataclasses.replace(SCENARIOS["noise_free"], duration_s=3.0))


def test_spikes_have_the_asked_length_and_number(rng: np.random.Generator) -> None:
    clean = readings(20_000)
    kept = clean.copy()
    struck = faults.spikes(clean, 0.05, 7.0, rng)
    length = np.linalg.norm(struck["xyz"] - clean["xyz"], axis=1)
    hit = length > 0.0
    np.testing.assert_allclose(length[hit], 7.0)
    assert abs(hit.mean() - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / clean.size)
    # In all directions alike.
    assert np.abs((struck["xyz"] - clean["xyz"])[hit].mean(axis=0)).max() < 4.0 * 7.0 / np.sqrt(3 * hit.sum())
    np.testing.assert_array_equal(struck["t_ns"], clean["t_ns"])
    np.testing.assert_array_equal(clean, kept)


def test_a_saturated_sensor_reads_its_limit() -> None:
    clean = readings()
    clipped = faults.saturated(clean, 0.8)
    beyond = np.abs(clean["xyz"]) > 0.8
    assert beyond.any()
    np.testing.assert_array_equal(clipped["xyz"][beyond], 0.8 * np.sign(clean["xyz"][beyond]))
    np.testing.assert_array_equal(clipped["xyz"][~beyond], clean["xyz"][~beyond])


def test_a_quantised_sensor_reads_multiples_of_its_step() -> None:
    clean = readings()
    coarse = faults.quantised(clean, 0.25)
    np.testing.assert_array_equal(coarse["xyz"] / 0.25, np.rint(coarse["xyz"] / 0.25))
    assert np.abs(coarse["xyz"] - clean["xyz"]).max() <= 0.125
    np.testing.assert_array_equal(coarse["t_ns"], clean["t_ns"])


@pytest.mark.parametrize(("renewed", "lengths"), [(1.0, {1}), (3.0, {3}), (7 / 3, {2, 3}), (1.6, {1, 2})])
def test_a_held_value_is_the_first_one_and_lasts(renewed: float, lengths: set[int]) -> None:
    clean = readings(2100)
    kept = faults.held(clean, renewed)
    first = np.flatnonzero(np.append(True, (np.diff(kept["xyz"], axis=0) != 0.0).any(axis=1)))
    np.testing.assert_array_equal(kept["xyz"][first], clean["xyz"][first])
    assert set(np.diff(first).tolist()) == lengths
    assert abs(2100 / len(first) - renewed) < 0.01
    np.testing.assert_array_equal(kept["t_ns"], clean["t_ns"])


@settings(max_examples=30, deadline=None, derandomize=True)
@given(start=st.integers(-50, 11_000), length=st.integers(0, 11_000))
def test_a_silent_sensor_lacks_exactly_the_interval(start: int, length: int) -> None:
    clean = readings()
    inside = (clean["t_ns"] >= start) & (clean["t_ns"] < start + length)
    np.testing.assert_array_equal(faults.without(clean, start, start + length), clean[~inside])
    jumped = faults.skipped(clean, start, start + length)
    np.testing.assert_array_equal(jumped["xyz"], clean["xyz"][~inside])
    after = clean["t_ns"][~inside] >= start + length
    np.testing.assert_array_equal(jumped["t_ns"], clean["t_ns"][~inside] - length * after)


def test_what_is_skipped_leaves_no_gap() -> None:
    jumped = faults.skipped(readings(), 2000, 4500)
    assert np.all(np.diff(jumped["t_ns"]) == 10)


def test_kidnapping_jumps_in_all_sensors_and_in_the_truth_alike(run: Simulation) -> None:
    recording, start = run.recording, run.scenario.start_ns
    a, b = start + 10**9, start + 17 * 10**8
    jumped = faults.kidnapped(recording, a, b)
    assert recording.ground_truth is not None
    assert jumped.ground_truth is not None
    for before, after in (
        (recording.gyroscope, jumped.gyroscope),
        (recording.accelerometer, jumped.accelerometer),
    ):
        np.testing.assert_array_equal(after, faults.skipped(before, a, b))
    # The truth afterwards is the pose of 0.7 s later.
    late = jumped.ground_truth.t_ns >= a
    expected = run.truth.at(jumped.ground_truth.t_ns[late] + (b - a)).T_w_b[:, :3, 3]
    np.testing.assert_allclose(jumped.ground_truth.position[late], expected)
    assert np.all(np.diff(jumped.ground_truth.t_ns) > 0)
    # No track leads over the jump.
    observations = jumped.observations
    assert np.all(np.diff(observations["t_ns"]) >= 0)
    early = observations["t_ns"] < a
    assert early.any()
    assert not early.all()
    assert np.intersect1d(observations["id"][early], observations["id"][~early]).size == 0
    # Without new ids some would.
    before, after = recording.observations["t_ns"] < a, recording.observations["t_ns"] >= b
    assert np.intersect1d(recording.observations["id"][before], recording.observations["id"][after]).size > 0


@pytest.mark.slow
def test_events_are_kidnapped_in_their_own_clock() -> None:
    recording = simulate_events(small_scenario(duration_s=0.2)).recording
    assert recording.calibration is not None
    shift_ns = recording.calibration.timeshift_ns
    a = recording.gyroscope["t_ns"][0] + 50_000_000
    jumped = faults.kidnapped(recording, a, a + 60_000_000)
    expected = faults.skipped(recording.events, a - shift_ns, a - shift_ns + 60_000_000)
    np.testing.assert_array_equal(jumped.events, expected)
    assert 0 < jumped.events.size < recording.events.size


def test_bias_is_taken_away_to_the_last_bit_of_noise(run: Simulation) -> None:
    noisy = simulate(dataclasses.replace(run.scenario, initial_gyroscope_bias_sigma=0.01))
    stream = noisy.recording.gyroscope
    found = faults.without_bias(stream, noisy.truth.at(stream["t_ns"]).bias_gyroscope)
    np.testing.assert_allclose(found["xyz"], run.recording.gyroscope["xyz"], atol=1e-12)
    assert np.abs(stream["xyz"] - run.recording.gyroscope["xyz"]).max() > 1e-3


def test_impossible_faults_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(SimulationError, match="a share of 2"):
        faults.spikes(readings(), 2.0, 1.0, rng)
    with pytest.raises(SimulationError, match="a limit of 0"):
        faults.saturated(readings(), 0.0)
    with pytest.raises(SimulationError, match="positive"):
        faults.quantised(readings(), 0.0)
    with pytest.raises(SimulationError, match="1 or more"):
        faults.held(readings(), 0.5)
    with pytest.raises(SimulationError, match="an interval from 5 to 4"):
        faults.without(readings(), 5, 4)


def some_events(count: int = 2000, period_ns: int = 50_000) -> RecordArray:
    events = np.zeros(count, dtype=EVENT_DTYPE)
    events["t_ns"] = period_ns * np.arange(count)
    events["x"] = np.arange(count) % 20
    return events


def test_a_repeated_record_arrives_twice_with_one_stamp(rng: np.random.Generator) -> None:
    clean = readings()
    twice = faults.repeated(clean, 0.3, rng)
    added = twice.size - clean.size
    assert 200 < added < 400
    assert np.count_nonzero(np.diff(twice["t_ns"]) == 0) == added
    np.testing.assert_array_equal(np.unique(twice["t_ns"]), clean["t_ns"])
    with pytest.raises(SimulationError, match="share of 2"):
        faults.repeated(clean, 2, rng)


def test_stamps_set_back_are_those_of_the_interval() -> None:
    clean = readings()
    wrong = faults.set_back(clean, 2000, 3000, 500)
    np.testing.assert_array_equal(
        clean["t_ns"] - wrong["t_ns"], 500 * ((clean["t_ns"] >= 2000) & (clean["t_ns"] < 3000))
    )
    np.testing.assert_array_equal(wrong["xyz"], clean["xyz"])


def test_disordered_records_are_the_same_in_another_order(rng: np.random.Generator) -> None:
    clean = readings()
    mixed = faults.disordered(clean, 2000, 6000, 300, rng)
    latest = np.maximum.accumulate(mixed["t_ns"])
    assert 0 < (latest - mixed["t_ns"]).max() <= 300
    np.testing.assert_array_equal(mixed[np.argsort(mixed["t_ns"])], clean)
    np.testing.assert_array_equal(mixed[clean["t_ns"] < 2000], clean[clean["t_ns"] < 2000])


def test_disorder_keeps_that_of_another_interval(rng: np.random.Generator) -> None:
    first = faults.disordered(readings(), 6000, 8000, 300, rng)
    both = faults.disordered(first, 2000, 3000, 300, rng)
    latest = np.maximum.accumulate(both["t_ns"])
    late = both["t_ns"][both["t_ns"] < latest]
    assert (late < 4000).any()
    assert (late > 5000).any()


def test_a_burst_adds_its_rate_inside_the_sensor(rng: np.random.Generator) -> None:
    events = some_events()
    a, b = 30_000_000, 40_000_000
    burst = faults.with_burst(events, a, b, 1e6, (20, 10), rng)
    assert burst.size == events.size + 10_000
    assert (np.diff(burst["t_ns"]) >= 0).all()
    outside = (burst["t_ns"] < a) | (burst["t_ns"] >= b)
    np.testing.assert_array_equal(burst[outside], events[(events["t_ns"] < a) | (events["t_ns"] >= b)])
    assert burst["x"].max() < 20
    assert burst["y"].max() < 10


def test_events_keep_their_layout(rng: np.random.Generator) -> None:
    # As memory-mapped events are: the same layout, but not marked as a compiler's.
    plain = np.lib.format.descr_to_dtype(np.lib.format.dtype_to_descr(EVENT_DTYPE))
    events = some_events().view(plain)
    changed = (
        faults.without(events, 20_000_000, 30_000_000),
        faults.skipped(events, 20_000_000, 30_000_000),
        faults.with_burst(events, 20_000_000, 30_000_000, 1e4, (20, 10), rng),
        faults.darkened(events, 20_000_000, 60_000_000, (20, 10), rng),
    )
    assert {records.dtype.itemsize for records in changed} == {EVENT_DTYPE.itemsize}


def test_darkness_begins_with_off_and_ends_with_on_of_every_pixel(rng: np.random.Generator) -> None:
    events = some_events()
    a, b = 20_000_000, 60_000_000
    dark = faults.darkened(events, a, b, (20, 10), rng)
    inside = dark[(dark["t_ns"] >= a) & (dark["t_ns"] < b)]
    assert inside.size == 200
    assert not inside["p"].any()
    assert np.unique(inside["y"] * 20 + inside["x"]).size == 200
    assert inside["t_ns"].max() < a + 20_000_000
    assert np.count_nonzero(dark["p"]) == 200
    assert (dark["t_ns"][dark["p"] == 1] >= b).all()
