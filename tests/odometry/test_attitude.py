"""Attitude before scale: right within what it claims, on real and simulated rotation, and no pose with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.config import InertialConfig
from asyneio.io import open_recording
from asyneio.odometry.attitude import AttitudeFilter
from asyneio.odometry.learned_noise import LearnedNoise
from asyneio.simulation import MotionStyle, Truth, draw_motion, simulate
from asyneio.simulation.rig import C_F_C, InertialRun, simulate_inertial
from asyneio.types import Attitude, EventRecording, Health, ImuNoise, RecordArray
from tests.odometry.runs import INTERVAL_NS, SCENARIO, run, varied

NOISE = SCENARIO.noise


def learned_noise(noise: ImuNoise) -> LearnedNoise:
    return LearnedNoise(InertialConfig(), noise, INTERVAL_NS * 1e-9)


def filtered(
    gyroscope: RecordArray, accelerometer: RecordArray, noise: ImuNoise, interval_ns: int = INTERVAL_NS
) -> list[Attitude]:
    """One attitude after each packet of `interval_ns`."""
    attitudes, learned = AttitudeFilter(InertialConfig(), noise.gyroscope_walk), learned_noise(noise)
    start_ns = max(int(gyroscope["t_ns"][0]), int(accelerometer["t_ns"][0]))
    ends_ns = np.arange(start_ns + interval_ns, gyroscope["t_ns"][-1], interval_ns)
    cuts = [np.r_[0, np.searchsorted(s["t_ns"], ends_ns, side="right")] for s in (gyroscope, accelerometer)]
    found = []
    for end, a, b, c, d in zip(ends_ns, cuts[0], cuts[0][1:], cuts[1], cuts[1][1:], strict=False):
        learned.append(gyroscope[a:b], accelerometer[c:d])
        learned.learn_until(int(end))
        found.append(attitudes.update(gyroscope[a:b], accelerometer[c:d], int(end), learned.now()))
    return [a for a in found if a is not None]


def tilt_errors(found: list[Attitude], truth: Truth) -> np.ndarray:
    """Angle [rad] between estimated and true upward direction in the body."""
    up = np.array([a.C_w_b[2] for a in found])
    true_up = truth.at([a.t_ns for a in found]).T_w_b[:, 2, :3]
    return np.linalg.norm(np.cross(up, true_up), axis=1)


def turning(seed: int, seconds: float, motion_scale: float = 0.0) -> InertialRun:
    """What an IMU reads while it turns, and moves where `motion_scale` is not zero."""
    scenario = varied(seed, duration_s=seconds)
    motion = draw_motion(MotionStyle.ROTATION, np.random.default_rng(seed), C_F_C, motion_scale)
    streams = np.random.default_rng(100 + seed).spawn(2)
    return simulate_inertial(scenario, motion, streams[0], streams[1])


@pytest.mark.slow
def test_under_pure_rotation_it_says_so_and_gives_the_attitude() -> None:
    T_b_c = SCENARIO.T_b_c.copy()
    # The IMU sits in the camera: a lever arm moves the camera, and that is parallax of known length.
    T_b_c[:3, 3] = 0.0
    simulation = simulate(
        varied(0, motion=MotionStyle.ROTATION, duration_s=3.0, motion_scale=0.0, T_b_c=T_b_c)
    )
    outcome = run(simulation.recording)
    assert outcome.estimates == []
    assert {r.health for r in outcome.reports} == {Health.INITIALIZING}
    assert any("sideways" in r.reason for r in outcome.reports)
    assert not any(r.stationary for r in outcome.reports)
    found = [r.attitude for r in outcome.reports]
    assert [a.t_ns for a in found if a is not None] == [r.t_ns for r in outcome.reports]
    errors = tilt_errors([a for a in found if a is not None], simulation.truth)
    assert np.degrees(errors).max() < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("motion_scale", [0.0, 1.0])
def test_errors_are_what_is_claimed(motion_scale: float) -> None:
    """Over seeds and time, in sigmas of one axis; two axes together. With translation, which it takes for
    gravity, the claim is the greater."""
    squares, sigmas = [], []
    for seed in range(6):
        imu = turning(seed, 12.0, motion_scale)
        found = filtered(imu.gyroscope, imu.accelerometer, NOISE)
        sigma = np.array([a.tilt_sigma_rad for a in found])
        sigmas.append(np.degrees(sigma).mean())
        squares.append(tilt_errors(found, imu.truth) ** 2 / (2.0 * sigma**2))
    assert 0.02 < np.mean(squares) < 1.5
    assert np.max(squares) < 9.0
    assert np.mean(sigmas) < 5.0


def test_result_hardly_depends_on_how_it_is_cut() -> None:
    imu = turning(1, 3.0)
    streams = imu.gyroscope, imu.accelerometer, NOISE
    coarse, fine = (filtered(*streams, interval_ns=n) for n in (INTERVAL_NS, INTERVAL_NS // 4))
    last = {a.t_ns: a for a in fine}[coarse[-1].t_ns]
    np.testing.assert_allclose(coarse[-1].C_w_b[2], last.C_w_b[2], atol=2e-3)
    # Nothing observes yaw: what differs at first stays.
    np.testing.assert_allclose(coarse[-1].C_w_b, last.C_w_b, atol=2e-2)
    assert coarse[-1].tilt_sigma_rad == pytest.approx(last.tilt_sigma_rad, rel=0.2)


def test_proper_without_some_samples() -> None:
    """Silent or corrupt sensors: less sure, and a rotation all the same."""
    imu = turning(2, 4.0)
    gyroscope, accelerometer = imu.gyroscope, imu.accelerometer.copy()
    begin_ns = int(gyroscope["t_ns"][0])
    silent = (gyroscope["t_ns"] > begin_ns + 2_000_000_000) & (gyroscope["t_ns"] < begin_ns + 2_500_000_000)
    accelerometer["xyz"][100, 0] = np.nan
    accelerometer["xyz"][200, 1] = 1e200
    whole = filtered(gyroscope, imu.accelerometer, NOISE)
    found = filtered(gyroscope[~silent], accelerometer, NOISE)
    for attitude in found:
        np.testing.assert_allclose(attitude.C_w_b @ attitude.C_w_b.T, np.eye(3), atol=1e-9)
    assert found[24].tilt_sigma_rad > 1.3 * whole[24].tilt_sigma_rad
    attitudes, noise = AttitudeFilter(InertialConfig(), NOISE.gyroscope_walk), learned_noise(NOISE).now()
    assert attitudes.update(gyroscope, accelerometer[:0], begin_ns, noise) is None


def test_starts_again_after_a_long_gap() -> None:
    """Nothing is known of the rotation: as if the sensors had been switched on."""
    before, imu = turning(2, 2.0), turning(5, 2.0)
    noise = learned_noise(NOISE).now()
    used, fresh = (AttitudeFilter(InertialConfig(), NOISE.gyroscope_walk) for _ in range(2))
    end_ns = int(before.gyroscope["t_ns"][-1])
    used.update(before.gyroscope, before.accelerometer, end_ns, noise)
    streams = [stream.copy() for stream in (imu.gyroscope, imu.accelerometer)]
    for stream in streams:
        stream["t_ns"] += end_ns + 1_500_000_000 - int(imu.gyroscope["t_ns"][0])
    after_ns = int(streams[0]["t_ns"][-1])
    found, expected = (filter_.update(*streams, after_ns, noise) for filter_ in (used, fresh))
    assert found is not None
    assert expected is not None
    np.testing.assert_array_equal(found.C_w_b, expected.C_w_b)
    assert found.tilt_sigma_rad == expected.tilt_sigma_rad


@pytest.mark.parametrize("end_ns", [-(2**63), 2**63 - 1])
def test_a_packet_centuries_away_takes_no_memory(end_ns: int) -> None:
    imu = turning(6, 1.0)
    attitudes, noise = AttitudeFilter(InertialConfig(), NOISE.gyroscope_walk), learned_noise(NOISE).now()
    attitudes.update(imu.gyroscope, imu.accelerometer, int(imu.gyroscope["t_ns"][-1]), noise)
    found = attitudes.update(imu.gyroscope[:0], imu.accelerometer[:0], end_ns, noise)
    assert found is not None
    assert np.isfinite(found.C_w_b).all()


def test_yaw_is_the_gyroscopes_since_the_first_sample() -> None:
    imu = turning(3, 3.0)
    found = filtered(imu.gyroscope, imu.accelerometer, NOISE)
    start_ns, end = found[0].t_ns, found[-1]
    true_start, true_end = imu.truth.at([start_ns, end.t_ns]).T_w_b[:, :3, :3]
    turn = found[0].C_w_b.T @ end.C_w_b
    error = turn.T @ true_start.T @ true_end
    assert np.degrees(np.arccos(min((np.trace(error) - 1.0) / 2.0, 1.0))) < 2.5


def test_turning_disc(data_dir: Path) -> None:
    """Real IMU, 91 degrees of roll: against the mean force over 0.2 s, within a degree RMS."""
    recording = open_recording(data_dir / "davis240_imu" / "IMU_rotDisk.aedat")
    assert isinstance(recording, EventRecording)
    assert recording.calibration is not None
    found = filtered(recording.gyroscope, recording.accelerometer, recording.calibration.noise)
    t_ns = recording.accelerometer["t_ns"]
    force = np.array(
        [recording.accelerometer["xyz"][np.abs(t_ns - a.t_ns) < INTERVAL_NS].mean(axis=0) for a in found]
    )
    up = np.array([a.C_w_b[2] for a in found])
    rolls = [np.unwrap(np.arctan2(v[:, 0], v[:, 1])) for v in (up, force)]
    assert np.degrees(np.ptp(rolls[1])) > 80.0
    assert np.degrees(np.sqrt(np.mean((rolls[0] - rolls[1]) ** 2))) < 0.5
    tilt = np.linalg.norm(np.cross(up, force / np.linalg.norm(force, axis=1, keepdims=True)), axis=1)
    sigma = np.array([a.tilt_sigma_rad for a in found])
    assert np.mean(tilt**2 / (2.0 * sigma**2)) < 1.5
