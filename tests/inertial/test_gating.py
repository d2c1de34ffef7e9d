"""Invalid samples are rejected, and no others: real recordings lose none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.inertial.gating import SampleGate, SensorLimits
from asyneio.io import open_recording, read_tracks_folder
from asyneio.simulation.faults import saturated, spikes
from asyneio.types import INERTIAL_DTYPE, FloatArray, RecordArray

LIMITS = SensorLimits(sigma=0.05, least_range=12.0)


def swinging(rng: np.random.Generator, rate_hz: float = 200.0, seconds: float = 5.0) -> RecordArray:
    """An accelerometer that is shaken at 3 Hz by up to 20 m/s^2."""
    samples = np.zeros(round(seconds * rate_hz), dtype=INERTIAL_DTYPE)
    t = np.arange(len(samples)) / rate_hz
    samples["t_ns"] = np.rint(t * 1e9)
    waves = 20.0 * np.sin(2.0 * np.pi * 3.0 * t[:, None] + np.arange(3.0))
    samples["xyz"] = waves + 0.05 * rng.normal(size=(len(t), 3))
    return samples


def through(gate: SampleGate, samples: RecordArray, limits: SensorLimits, packet: int = 20) -> RecordArray:
    """The samples that pass, packet by packet."""
    parts = [gate.passed(samples[a : a + packet], limits) for a in range(0, len(samples), packet)]
    return np.concatenate(parts)


def test_good_samples_pass_untouched(rng: np.random.Generator) -> None:
    samples = swinging(rng)
    gate = SampleGate()
    np.testing.assert_array_equal(through(gate, samples, LIMITS), samples)
    assert gate.rejected == 0


@pytest.mark.parametrize("packet", [5, 20, 100, 1000])
def test_spikes_are_refused_and_little_else(rng: np.random.Generator, packet: int) -> None:
    samples = swinging(rng)
    hit = spikes(samples, 0.01, 50.0, rng)
    struck = np.flatnonzero((hit["xyz"] != samples["xyz"]).any(axis=1))
    gate = SampleGate()
    passed = through(gate, hit, LIMITS, packet)
    refused = np.flatnonzero(~np.isin(hit["t_ns"], passed["t_ns"]))
    # The first samples of all have nothing before them.
    assert set(struck[struck >= 5]) <= set(refused)
    # At the end of a short packet a spike may take a neighbour along.
    assert len(set(refused) - set(struck)) <= len(set(struck)) * (0.7 if packet < 10 else 0.2)


@pytest.mark.parametrize("offset", range(10))
def test_two_spikes_in_a_row_are_refused_wherever_the_packet_ends(
    rng: np.random.Generator, offset: int
) -> None:
    samples = swinging(rng)
    samples["xyz"][90 + offset : 92 + offset, 1] += [50.0, -45.0]
    passed = through(SampleGate(), samples, LIMITS, 10)
    refused = np.flatnonzero(~np.isin(samples["t_ns"], passed["t_ns"]))
    # At the end of a packet they may take a neighbour along.
    assert {90 + offset, 91 + offset} <= set(refused)
    assert len(refused) <= 3


def test_a_knock_of_some_samples_stays(rng: np.random.Generator) -> None:
    """A filtered shock of 100 m/s^2 that takes 25 ms."""
    samples = swinging(rng)
    at = slice(400, 405)
    samples["xyz"][at, 2] += 100.0 * np.array([0.3, 0.8, 1.0, 0.8, 0.3])
    gate = SampleGate()
    assert len(through(gate, samples, LIMITS)) == len(samples)


def test_saturated_samples_are_refused(rng: np.random.Generator) -> None:
    samples = swinging(rng)
    clipped = saturated(samples, 16.0)
    gate = SampleGate()
    passed = through(gate, clipped, LIMITS)
    at_limit = (np.abs(clipped["xyz"]) >= 16.0).any(axis=1)
    left = np.isin(clipped["t_ns"], passed["t_ns"]) & at_limit
    assert gate.saturated > 0.9 * np.count_nonzero(at_limit)
    # The first ones at each of the six ends, before it was known.
    assert np.count_nonzero(left) <= 4
    assert gate.saturated <= np.count_nonzero(at_limit)


def test_rest_is_not_saturation() -> None:
    """A coarse converter of a stationary sensor repeats its readings, gravity among them."""
    samples = np.zeros(400, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = np.arange(400) * 5_000_000
    samples["xyz"] = [0.0, 0.0, 9.81]
    gate = SampleGate()
    assert len(through(gate, samples, LIMITS)) == 400


def test_what_is_not_finite_or_not_in_order_is_refused(rng: np.random.Generator) -> None:
    samples = swinging(rng)
    samples["xyz"][100] = np.nan
    samples["xyz"][200, 1] = np.inf
    samples["t_ns"][300] = samples["t_ns"][299]
    samples["t_ns"][340] = samples["t_ns"][330]
    samples["xyz"][250] = 1e200
    gate = SampleGate()
    passed = through(gate, samples, LIMITS)
    assert gate.corrupt == 4
    assert gate.spikes == 1
    assert (np.diff(passed["t_ns"]) > 0).all()
    assert np.isfinite(passed["xyz"]).all()


def refused_share(samples: RecordArray, density: float, least_range: float) -> float:
    rate_hz = 1e9 / float(np.median(np.diff(samples["t_ns"])))
    gate = SampleGate()
    limits = SensorLimits(density * rate_hz**0.5, least_range)
    through(gate, samples, limits, round(rate_hz / 10.0))
    return gate.rejected / len(samples)


def test_real_hand_held_imu_loses_nothing(data_dir: Path) -> None:
    recording = read_tracks_folder(data_dir / "tumvi_calib")
    noise = recording.calibration.noise
    assert refused_share(recording.gyroscope, noise.gyroscope_density, 1.0) == 0.0
    assert refused_share(recording.accelerometer, noise.accelerometer_density, 12.0) == 0.0


def test_real_flying_imu_loses_nothing(data_dir: Path) -> None:
    path = data_dir / "euroc_V1_01" / "imu0_data.csv"
    t_ns = np.loadtxt(path, delimiter=",", comments="#", usecols=0, dtype=np.int64)
    values: FloatArray = np.loadtxt(path, delimiter=",", comments="#", usecols=range(1, 7))
    for columns, density, least_range in ((slice(0, 3), 1.7e-4, 1.0), (slice(3, 6), 2e-3, 12.0)):
        samples = np.zeros(len(t_ns), dtype=INERTIAL_DTYPE)
        samples["t_ns"], samples["xyz"] = t_ns, values[:, columns]
        assert refused_share(samples, density, least_range) == 0.0


@pytest.mark.parametrize("name", ["IMU_rotDisk", "IMU_translBoxes"])
def test_real_camera_imu_loses_nothing(data_dir: Path, name: str) -> None:
    recording = open_recording(data_dir / "davis240_imu" / f"{name}.aedat")
    assert refused_share(recording.gyroscope, 1e-3, 1.0) == 0.0
    assert refused_share(recording.accelerometer, 1e-2, 12.0) == 0.0
