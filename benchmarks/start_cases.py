"""Random cases for initialization: simulated tracks of random motions, and front-end tracks of simulated
events."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asyneio.config import Config
from asyneio.simulation import AnalyticMotion, PinholeCamera, Sinusoids, TrackSpec, draw_motion
from asyneio.simulation.rig import C_F_C, calibration_of, simulate_inertial
from asyneio.simulation.tracks.observations import Viewer, simulate_tracks
from asyneio.simulation.tracks.scenario import Scenario
from asyneio.simulation.truth import Truth
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, FloatArray, RecordArray, Recording
from sequences import sequence, tracked
from true_tracks import as_tracks

#: Initialization is expected in the first 4 s, and then monitored for 2 s.
CASE_S = 6.2
#: Mean lifetime of a track [s]: half of them end within 0.35 s.
_MEAN_LIFE_S = 0.35 / np.log(2.0)
#: Scale is observable if over the first three seconds the acceleration varies by three times the
#: accelerometer's bias (m/s^2, standard deviation) and a track of mean life shows four standard deviations of
#: parallax (px).
OBSERVABLE_ACCELERATION = 0.3
OBSERVABLE_PARALLAX_PX = 2.0
#: Noise of simulated tracks, as of a front end with 30 to 50 observations per second.
_TRACKS = TrackSpec(
    features_alive=75,
    mean_life_s=_MEAN_LIFE_S,
    spacing_px=1.4,
    min_spacing_s=0.02,
    max_spacing_s=0.1,
    pixel_sigma=0.5,
    outlier_fraction=0.03,
)


@dataclass(frozen=True)
class Case:
    """A recording that begins when the estimator is switched on, its ground truth, and the random parameters.

    `speed` [m/s], `depth` [m], `acceleration` [m/s^2] (standard deviation over three seconds), `parallax_px`
    of a track of mean life, from the true speed and the depth.
    """

    recording: Recording
    truth: Truth
    start_ns: int
    speed: float
    depth: float
    acceleration: float
    parallax_px: float

    @property
    def observable(self) -> bool:
        """Whether scale is observable, from the true motion."""
        seen = self.parallax_px >= OBSERVABLE_PARALLAX_PX
        return bool(self.acceleration >= OBSERVABLE_ACCELERATION and seen)


def _case(recording: Recording, truth: Truth, start_ns: int, depth: float) -> Case:
    t_s = (start_ns - truth.start_ns) / NS_PER_S + np.arange(0.0, 3.0, 0.02)
    speed = float(np.sqrt(np.mean(np.sum(truth.motion.velocity_w(t_s) ** 2, axis=1))))
    acceleration = float(np.sqrt(truth.motion.acceleration_w(t_s).var(axis=0).sum()))
    focal = recording.calibration.camera.fx
    return Case(recording, truth, start_ns, speed, depth, acceleration, focal * speed * _MEAN_LIFE_S / depth)


def _landmarks(
    motion: AnalyticMotion, camera: PinholeCamera, T_b_c: FloatArray, depth: float, rng: np.random.Generator
) -> FloatArray:
    """Points (N,3) seen from random positions of the path at 0.6 to 1.8 times `depth`, none nearer than a
    third of it."""
    count = 4000
    T = motion.T_w_b(rng.uniform(0.0, CASE_S, count)) @ T_b_c
    ahead = np.column_stack([rng.uniform(-0.75, 0.75, count), rng.uniform(-0.6, 0.6, count), np.ones(count)])
    ahead *= depth * rng.uniform(0.6, 1.8, count)[:, None]
    points = np.einsum("nij,nj->ni", T[:, :3, :3], ahead) + T[:, :3, 3]
    way = motion.T_w_b(np.arange(0.0, CASE_S, 0.05))[:, :3, 3]
    nearest = np.min(np.linalg.norm(points[:, None] - way[None], axis=2), axis=1)
    return points[nearest > depth / 3.0]


def _drawn_motion(rng: np.random.Generator, speed: float) -> AnalyticMotion:
    """A motion of a random style with the given speed (RMS of the first three seconds)."""
    style = str(rng.choice(["gentle", "moderate", "aggressive"]))
    state = rng.bit_generator.state
    C_f_b = C_F_C @ Scenario().T_b_c[:3, :3].T
    motion = draw_motion(style, rng, C_f_b)
    now = np.sqrt(np.mean(np.sum(motion.velocity_w(np.arange(0.0, 3.0, 0.02)) ** 2, axis=1)))
    rng.bit_generator.state = state
    return draw_motion(style, rng, C_f_b, position_scale=speed / float(now))


def _turning(rng: np.random.Generator, offset_m: float, camera_centred: bool) -> AnalyticMotion:
    """A rotation about a point `offset_m` beside the camera, or beside the IMU."""
    scenario = Scenario()
    C_f_b = C_F_C @ scenario.T_b_c[:3, :3].T
    turning = draw_motion("rotation", rng, C_f_b, position_scale=0.0)
    beside = rng.normal(size=3)
    beside *= offset_m / np.linalg.norm(beside)
    return _About(turning.coordinates, C_f_b, arm=beside + (scenario.T_b_c[:3, 3] if camera_centred else 0.0))


@dataclass(frozen=True)
class _About(AnalyticMotion):
    """A rotation about the point `arm` (3,) of the body instead of about the body's origin."""

    arm: FloatArray = None  # type: ignore[assignment]

    def T_w_b(self, t_s: FloatArray) -> FloatArray:  # type: ignore[override]
        T = super().T_w_b(t_s)
        T[:, :3, 3] -= T[:, :3, :3] @ self.arm
        return T

    def velocity_w(self, t_s: FloatArray) -> FloatArray:  # type: ignore[override]
        C = super().T_w_b(t_s)[:, :3, :3]
        return super().velocity_w(t_s) - np.einsum(
            "nij,nj->ni", C, np.cross(self.angular_velocity_b(t_s), self.arm)
        )

    def acceleration_w(self, t_s: FloatArray) -> FloatArray:  # type: ignore[override]
        C, w = super().T_w_b(t_s)[:, :3, :3], self.angular_velocity_b(t_s)
        inner = np.cross(self.angular_acceleration_b(t_s), self.arm) + np.cross(w, np.cross(w, self.arm))
        return super().acceleration_w(t_s) - np.einsum("nij,nj->ni", C, inner)


def _with_drifting_tracks(
    observations: RecordArray, share: float, together: bool, rng: np.random.Generator
) -> RecordArray:
    """Make a share of the tracks drift at 10 to 60 px/s from birth on, individually or all alike (an
    object)."""
    out = observations.copy()
    _, first, member = np.unique(out["id"], return_index=True, return_inverse=True)
    count = first.size
    angle, rate = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(10.0, 60.0, count)
    if together:
        angle, rate = np.full(count, angle[0]), np.full(count, rate[0])
    drift = (
        (rng.random(count) < share)[:, None] * rate[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    )
    age_s = (out["t_ns"] - out["t_ns"][first][member]) / NS_PER_S
    moved = age_s[:, None] * drift[member]
    out["u"] += moved[:, 0]
    out["v"] += moved[:, 1]
    return out


def simulated(number: int, variant: str) -> Case:
    """Case `number` of a variant of simulated tracks; the same draws of motion and depth in all variants."""
    rngs = [np.random.default_rng(s) for s in np.random.SeedSequence([number, 7]).spawn(6)]
    draw, for_scene, for_tracks, for_gyroscope, for_accelerometer, for_faults = rngs
    speed, depth = (
        float(np.exp(draw.uniform(np.log(0.2), np.log(2.0)))),
        float(np.exp(draw.uniform(0.0, np.log(15.0)))),
    )
    scenario = Scenario(
        name=f"{variant}-{number}",
        duration_s=CASE_S,
        seed=number,
        initial_gyroscope_bias_sigma=float(draw.uniform(0.01, 0.02)),
        initial_accelerometer_bias_sigma=float(draw.uniform(0.05, 0.1)),
    )
    motion = _drawn_motion(draw, speed)
    if variant == "rotation":
        motion = _turning(draw, draw.choice([0.0, 0.003, 0.008]), bool(number % 2))
    elif variant == "still":
        motion = AnalyticMotion(Sinusoids(np.zeros((6, 1)), np.ones((6, 1)), np.zeros((6, 1))), motion.C_f_b)
    camera = PinholeCamera.from_intrinsics(scenario.camera)
    viewer = Viewer(
        motion, camera, scenario.T_b_c, _landmarks(motion, camera, scenario.T_b_c, depth, for_scene)
    )
    spec = replace(_TRACKS, features_alive=int(draw.integers(60, 91)))
    tracks = simulate_tracks(viewer, spec, 0.01, scenario.duration_s, for_tracks)
    inertial = simulate_inertial(scenario, motion, for_gyroscope, for_accelerometer)
    records = np.zeros(tracks.t_ns.size, dtype=OBSERVATION_DTYPE)
    records["t_ns"], records["id"] = scenario.start_ns + tracks.t_ns, tracks.track
    records["u"], records["v"] = tracks.pixels.T
    if variant == "bad_tracks":
        records = _with_drifting_tracks(records, 0.3, False, for_faults)
    elif variant == "moving_object":
        records = _with_drifting_tracks(records, 1.0 / 3.0, True, for_faults)
    elif variant == "clock":
        records["t_ns"] += round(float(for_faults.choice([-1.0, 1.0]) * for_faults.uniform(3e6, 5e6)))
    recording = Recording(
        scenario.name, records, inertial.gyroscope, inertial.accelerometer, calibration_of(scenario)
    )
    return _case(recording, inertial.truth, scenario.start_ns, depth)


#: Typical distance [m] of the scene in the event sequences.
_EVENT_DEPTH_M = 2.5


def from_events(scene: str, number: int, cache: Path, tracks_cache: Path) -> Case:
    """Case `number` of a sequence of the suite as the front end tracks it, from a random instant on."""
    simulation = sequence(scene, 0, None, cache)
    run = tracked(simulation, Config(), tracks_cache)
    recording, truth = as_tracks(simulation.recording, run.observations), simulation.truth
    rng = np.random.default_rng([number, simulation.scenario.seed])
    # Minus the time that the simulator and the front end need at the beginning.
    latest_s = simulation.scenario.duration_s - CASE_S - 0.5
    start_ns = truth.start_ns + round(rng.uniform(0.3, latest_s) * NS_PER_S)

    def later(records: RecordArray) -> RecordArray:
        return records[(records["t_ns"] >= start_ns) & (records["t_ns"] <= start_ns + CASE_S * NS_PER_S)]

    cut = replace(
        recording,
        observations=later(recording.observations),
        gyroscope=later(recording.gyroscope),
        accelerometer=later(recording.accelerometer),
    )
    return _case(cut, truth, start_ns, _EVENT_DEPTH_M)
