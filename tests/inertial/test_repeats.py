"""A held value is one measurement; a value that repeats by chance has been measured again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.inertial.repeats import Renewals
from asyneio.io import open_recording, read_tracks_folder
from asyneio.simulation.faults import held, quantised, without
from asyneio.types import INERTIAL_DTYPE, RecordArray


def noisy(rng: np.random.Generator, count: int = 2000, sigma: float = 0.05) -> RecordArray:
    """A sensor at 1 kHz."""
    samples = np.zeros(count, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = np.arange(count) * 1_000_000
    samples["xyz"] = [0.3, -0.2, 9.8] + sigma * rng.normal(size=(count, 3))
    return samples


def through(renewals: Renewals, samples: RecordArray, packet: int = 25) -> RecordArray:
    return np.concatenate([renewals.passed(samples[a : a + packet]) for a in range(0, len(samples), packet)])


@pytest.mark.slow
@pytest.mark.parametrize("packet", [1, 7, 25, 500])
@pytest.mark.parametrize(("renewed", "rate_hz"), [(2.0, 500.0), (3.0, 333.3), (7 / 3, 428.6), (1.6, 625.0)])
def test_each_renewed_value_passes_once_when_first_read(
    rng: np.random.Generator, renewed: float, rate_hz: float, packet: int
) -> None:
    samples = noisy(rng)
    renewals = Renewals()
    passed = through(renewals, held(samples, renewed), packet)
    # Until holding is proven, everything passes.
    late = passed[passed["t_ns"] > 600_000_000]
    assert (np.diff(late["xyz"], axis=0) != 0.0).any(axis=1).all()
    np.testing.assert_array_equal(late["xyz"], samples["xyz"][late["t_ns"] // 1_000_000])
    assert len(late) == pytest.approx(1.4 * rate_hz, rel=0.01)
    assert renewals.rate_hz == pytest.approx(rate_hz, rel=0.05)


def test_nothing_is_left_out_of_a_sensor_that_measures_anew(rng: np.random.Generator) -> None:
    """From readings that never repeat to a sensor so coarse that it always does."""
    for step in (1e-6, 0.02, 0.1, 0.2, 0.3, 1.0):
        samples = quantised(noisy(rng), step)
        renewals = Renewals()
        np.testing.assert_array_equal(through(renewals, samples), samples)
        assert renewals.rate_hz == pytest.approx(1000.0)


def test_one_axis_that_repeats_is_not_holding(rng: np.random.Generator) -> None:
    samples = noisy(rng)
    samples["xyz"][:, :2] = held(samples, 3.0)["xyz"][:, :2]
    np.testing.assert_array_equal(through(Renewals(), samples), samples)


def test_a_rest_of_a_held_coarse_sensor_is_no_pause(rng: np.random.Generator) -> None:
    samples = noisy(rng)
    samples["xyz"][1000:] = samples["xyz"][999]
    passed = through(Renewals(), held(samples, 3.0))
    rest = passed["t_ns"][passed["t_ns"] > 1_000_000_000]
    assert np.diff(rest).max() == 3_000_000


def test_lost_samples_and_time_set_back_do_no_harm(rng: np.random.Generator) -> None:
    samples = held(noisy(rng), 3.0)
    thinned = samples[rng.random(len(samples)) > 0.01]
    renewals = Renewals()
    passed = through(renewals, thinned)
    assert renewals.held
    assert len(passed) < 0.36 * len(samples)
    paused = without(samples, 1_000_000_000, 1_300_000_000)
    paused["xyz"][1000:1003] = paused["xyz"][999]
    gaps = np.diff(through(Renewals(), paused)["t_ns"])
    assert gaps.max() <= 303_000_000
    renewals = Renewals()
    through(renewals, samples)
    again = through(renewals, samples)
    assert abs(len(again) - len(samples) / 3) < 3


def test_holding_that_ends_is_noticed(rng: np.random.Generator) -> None:
    samples = noisy(rng, 3000)
    samples["xyz"][:1000] = held(samples, 3.0)["xyz"][:1000]
    renewals = Renewals()
    passed = through(renewals, samples)
    assert not renewals.held
    np.testing.assert_array_equal(passed[-1900:], samples[-1900:])


@pytest.mark.parametrize("name", ["IMU_rotDisk", "IMU_translBoxes"])
def test_real_accelerometer_read_faster_than_renewed(data_dir: Path, name: str) -> None:
    recording = open_recording(data_dir / "davis240_imu" / f"{name}.aedat")
    renewals = Renewals()
    passed = through(renewals, recording.accelerometer, 46)
    assert len(passed) / len(recording.accelerometer) == pytest.approx(0.43, abs=0.01)
    assert renewals.rate_hz == pytest.approx(1000.0, rel=0.1)
    # Its gyroscope is not held: some readings repeat by chance.
    np.testing.assert_array_equal(through(Renewals(), recording.gyroscope, 46), recording.gyroscope)


def test_real_imus_that_measure_anew_pass_whole(data_dir: Path) -> None:
    recording = read_tracks_folder(data_dir / "tumvi_calib")
    for samples in (recording.gyroscope, recording.accelerometer):
        np.testing.assert_array_equal(through(Renewals(), samples), samples)


@pytest.mark.parametrize("packet", [1, 7, 500])
def test_duplicates_are_dropped_and_counted(rng: np.random.Generator, packet: int) -> None:
    samples = noisy(rng, 500)
    twice = np.repeat(samples, 1 + (rng.random(len(samples)) < 0.3))
    renewals, passed, duplicates = Renewals(), [], 0
    for a in range(0, len(twice), packet):
        passed.append(renewals.passed(twice[a : a + packet]))
        duplicates += renewals.duplicates
    np.testing.assert_array_equal(np.concatenate(passed), samples)
    assert duplicates == len(twice) - len(samples)
    assert not renewals.held
