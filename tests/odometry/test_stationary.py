"""Stationary or not: what inertial samples and the image say together, situation by situation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from asyneio.config import InertialConfig
from asyneio.odometry.raw_measurements import RawMeasurements
from asyneio.odometry.stationary import StationaryDetector
from asyneio.types import INERTIAL_DTYPE, OBSERVATION_DTYPE, Estimate, Packet, RecordArray
from tests.inertial.windows import declared_noise
from tests.odometry.runs import INTERVAL_NS, SCENARIO, simulated

PIXEL_SIGMA = 0.3
NOISE = SCENARIO.noise
#: Of sensors that do not move: as declared.
CALM = declared_noise(NOISE, SCENARIO.gyroscope_rate_hz, SCENARIO.accelerometer_rate_hz)
BIAS = np.array([0.01, -0.02, 0.005]), np.array([0.05, -0.03, 0.08])
UP = np.array([0.0, 9.81, 0.0])


def nothing(t: np.ndarray) -> np.ndarray:
    return np.zeros((len(t), 3))


@dataclass(frozen=True)
class Situation:
    """What really happens, as functions of seconds: turn rate, acceleration, motion of the image [px]; and
    how many events a packet holds."""

    turn: Callable[[np.ndarray], np.ndarray] = nothing
    push: Callable[[np.ndarray], np.ndarray] = nothing
    image: Callable[[np.ndarray], np.ndarray] | None = None
    events: int | None = None
    tracks: int = 12

    def packets(self, seconds: float, seed: int = 0) -> list[Packet]:
        rng = np.random.default_rng(seed)
        ends = INTERVAL_NS * np.arange(1, round(seconds * 10) + 1)
        return [self._packet(int(end), rng) for end in ends]

    def _packet(self, end_ns: int, rng: np.random.Generator) -> Packet:
        t_ns = np.arange(end_ns - INTERVAL_NS + 5_000_000, end_ns + 1, 5_000_000)
        t = t_ns * 1e-9
        streams = []
        parts = ((self.turn(t), NOISE.gyroscope_density), (UP + self.push(t), NOISE.accelerometer_density))
        for (ideal, density), bias in zip(parts, BIAS, strict=True):
            samples = np.zeros(len(t), dtype=INERTIAL_DTYPE)
            samples["t_ns"] = t_ns
            samples["xyz"] = ideal + bias + density * np.sqrt(200.0) * rng.normal(size=(len(t), 3))
            streams.append(samples)
        return Packet(end_ns, self._observations(t_ns[::5], rng), streams[0], streams[1], self.events)

    def _observations(self, t_ns: np.ndarray, rng: np.random.Generator) -> RecordArray:
        if self.image is None:
            return np.empty(0, dtype=OBSERVATION_DTYPE)
        tracks = self.tracks
        out = np.zeros(len(t_ns) * tracks, dtype=OBSERVATION_DTYPE)
        out["t_ns"], out["id"] = np.repeat(t_ns, tracks), np.tile(np.arange(tracks), len(t_ns))
        uv = 100.0 + 5.0 * out["id"][:, None] + self.image(out["t_ns"] * 1e-9)[:, :2]
        out["u"], out["v"] = (uv + PIXEL_SIGMA * rng.normal(size=uv.shape)).T
        return out


def new_detector() -> tuple[RawMeasurements, StationaryDetector]:
    calibration = simulated().recording.calibration
    return RawMeasurements(), StationaryDetector(InertialConfig(), calibration, PIXEL_SIGMA)


def judged(situation: Situation, seconds: float = 1.5, known: Estimate | None = None) -> list[bool]:
    raw, detector = new_detector()
    answers = []
    for packet in situation.packets(seconds):
        raw.append(packet)
        answers.append(detector.update(raw, packet.t_end_ns - INTERVAL_NS, packet.t_end_ns, known, CALM))
    return answers


def known(speed: float, sigma: float = 0.02) -> Estimate:
    """An estimate of a body that goes straight on, sure of its biases to 1e-3."""
    covariance = np.diag(np.repeat([1e-2, sigma, 1.0, 1e-3], [6, 6, 6, 6]) ** 2)
    velocity = np.array([speed, 0.0, 0.0])
    return Estimate(0, np.eye(4), velocity, np.zeros(3), np.zeros(6), BIAS[0], BIAS[1], covariance)


def steady(speed: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: speed * np.asarray(t)[:, None] * np.array([1.0, 0.3, 0.0])


def even(size: float) -> Callable[[np.ndarray], np.ndarray]:
    """The same all the time, along the vertical."""
    return lambda t: nothing(t) + np.array([0.0, size, 0.0])


def wave(size: float, hz: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: size * np.sin(2.0 * np.pi * hz * np.asarray(t))[:, None] * np.array([1.0, -0.5, 0.7])


QUIET = Situation()
PIXELS = simulated().recording.calibration.camera.width * simulated().recording.calibration.camera.height
NOISE_EVENTS = round(0.05 * PIXELS)
MANY_EVENTS = round(0.5 * PIXELS)

AT_REST = {
    "nothing seen": (QUIET, None),
    "frames": (replace(QUIET, image=nothing), None),
    "noise events": (replace(QUIET, events=NOISE_EVENTS), None),
    "dark": (replace(QUIET, events=0), None),
    "estimate": (QUIET, known(0.01)),
    "poor estimate": (QUIET, known(0.5, sigma=0.2)),
    "frames against a wrong estimate": (replace(QUIET, image=nothing), known(0.5)),
    "flicker, once there is an estimate": (replace(QUIET, events=MANY_EVENTS), known(0.01)),
}
IN_MOTION = {
    "hand": (Situation(turn=wave(0.1, 1.0), push=wave(0.3, 0.8)), None),
    "hand, in the dark": (Situation(turn=wave(0.1, 1.0), push=wave(0.3, 0.8), events=0), known(0.3)),
    "turning slowly": (Situation(turn=even(0.15)), None),
    "turning at the pace of the bias": (Situation(turn=even(0.02)), known(0.0)),
    "gliding, seen by tracks": (Situation(image=steady(8.0)), None),
    "gliding, known from before": (Situation(), known(0.5)),
    "gliding, in the dark": (Situation(events=0), known(0.5)),
    "many events before the start": (Situation(events=MANY_EVENTS), None),
    "engine": (Situation(push=wave(1.5, 77.0)), None),
    "falling": (Situation(push=even(-9.81)), None),
    "speeding up evenly": (Situation(push=even(1.5)), None),
}


@pytest.mark.parametrize("name", AT_REST)
def test_stationary_situations(name: str) -> None:
    situation, estimate = AT_REST[name]
    answers = judged(situation, 1.5, estimate)
    needed = 2 if estimate is None else 5
    assert not any(answers[: needed - 1]), "a fifth of a second, or a half, has to be seen first"
    assert all(answers[needed:]), answers


@pytest.mark.parametrize("name", IN_MOTION)
def test_in_motion(name: str) -> None:
    situation, estimate = IN_MOTION[name]
    assert not any(judged(situation, 3.0, estimate))


def pushed_at(begin: float) -> Callable[[np.ndarray], np.ndarray]:
    """From rest to a walk: 0.4 m/s^2 from an instant on."""
    return lambda t: np.where(np.asarray(t)[:, None] > begin, 0.4, 0.0) * np.array([1.0, 0.0, 0.0])


def test_an_acceleration_ends_a_phase_at_once() -> None:
    answers = judged(Situation(push=pushed_at(1.5)), 2.5)
    assert all(answers[5:15])
    # Gliding on unseen looks like rest again; an estimate would know better.
    assert not any(answers[16:19])


def test_a_person_walks_through_the_image() -> None:
    """A rest that has begun goes on while every track moves, but none begins."""
    passer_by = Situation(image=lambda t: steady(30.0)(np.maximum(np.asarray(t) - 1.0, 0.0)))
    answers = judged(passer_by, 2.5)
    assert all(answers[5:])
    assert not any(judged(Situation(image=steady(30.0)), 2.5))


def test_lifted_too_softly_for_the_accelerometer_but_seen() -> None:
    """With moving tracks a push counts that is lost in the limits of the accelerometer alone."""

    def lift(t: np.ndarray) -> np.ndarray:
        return np.where(np.asarray(t)[:, None] > 1.0, 0.04, 0.0) * np.array([1.0, 0.0, 0.0])

    blind = Situation(push=lift)
    seen = replace(blind, image=lambda t: steady(20.0)(np.maximum(np.asarray(t) - 1.0, 0.0)))
    assert sum(judged(seen, 3.0)) < sum(judged(blind, 3.0))
    assert not judged(seen, 3.0)[-1]


def test_a_gap_in_the_samples_ends_it() -> None:
    raw, detector = new_detector()
    packets = QUIET.packets(2.0)
    packets[12] = replace(packets[12], gyroscope=packets[12].gyroscope[:0])
    answers = []
    for packet in packets:
        raw.append(packet)
        answers.append(detector.update(raw, packet.t_end_ns - INTERVAL_NS, packet.t_end_ns, None, CALM))
        assert (detector.phase is not None and not detector.phase.ended) == detector.stationary == answers[-1]
    assert all(answers[2:12])
    assert not any(answers[12:17])
    assert all(answers[18:])


@pytest.mark.parametrize("seed", range(5))
def test_rest_lasts(seed: int) -> None:
    """Half a minute of noise and walking biases: never interrupted."""
    raw, detector = new_detector()
    for n, packet in enumerate(QUIET.packets(30.0, seed)):
        drift = np.sqrt(n / 10.0)
        packet.accelerometer["xyz"] += NOISE.accelerometer_walk * drift
        packet.gyroscope["xyz"] -= NOISE.gyroscope_walk * drift
        raw.append(packet)
        assert (
            detector.update(raw, packet.t_end_ns - INTERVAL_NS, packet.t_end_ns, None, CALM) == (n >= 1)
            or n < 6
        )


def short_rest(seconds: float, image: Callable[[np.ndarray], np.ndarray] | None = None) -> StationaryDetector:
    """After a rest that a push ends, and half a second more."""

    def push(t: np.ndarray) -> np.ndarray:
        return np.where(np.asarray(t)[:, None] > seconds, wave(0.8, 1.0)(np.asarray(t) - seconds), 0.0)

    raw, detector = new_detector()
    for packet in Situation(push=push, image=image, tracks=40).packets(seconds + 0.5):
        raw.append(packet)
        detector.update(raw, packet.t_end_ns, packet.t_end_ns, None, CALM)
    return detector


@pytest.mark.parametrize("seconds", [0.2, 0.3, 0.5, 0.9])
def test_a_short_phase_is_remembered(seconds: float) -> None:
    phase = short_rest(seconds).phase
    assert phase is not None
    assert phase.ended
    assert phase.start_ns == 0
    assert abs(phase.end_ns * 1e-9 - seconds) < 0.15


def test_no_short_phase_while_all_tracks_creep() -> None:
    """By less than the noise of one track, but all of them alike."""
    assert short_rest(0.3, image=steady(3.5)).phase is None
    assert short_rest(0.3, image=nothing).phase is not None
