"""Short simulated recordings and runs over them; sparse on purpose, so that a run takes about a second."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asyneio.config import Config
from asyneio.odometry import Odometry
from asyneio.simulation import IDEAL_IMU, SCENARIOS, Scenario, Simulation, TrackSpec, simulate, with_imu
from asyneio.types import (
    INERTIAL_DTYPE,
    OBSERVATION_DTYPE,
    Calibration,
    Estimate,
    InitialState,
    Packet,
    Recording,
    StepReport,
)

Array = NDArray[np.float64]

PIXEL_SIGMA = 0.2
INTERVAL_NS = 100_000_000
TRACKS = TrackSpec(
    features_alive=40,
    mean_life_s=1.0,
    spacing_px=6.0,
    min_spacing_s=0.03,
    max_spacing_s=0.12,
    pixel_sigma=PIXEL_SIGMA,
)
#: The noise is what it is said to be: whether covariances are honest is judged by it.
SCENARIO = replace(
    with_imu(SCENARIOS["aggressive"], IDEAL_IMU),
    duration_s=4.0,
    gyroscope_rate_hz=200.0,
    accelerometer_rate_hz=190.0,
    tracks=TRACKS,
)


#: rad, m, m/s, rad/s, m/s^2.
CERTAIN = np.repeat([1e-4, 1e-4, 1e-3, 1e-4, 1e-3], 3)


def configured(**sections: dict[str, Any]) -> Config:
    """True noise; the errors that an ideal IMU does not have and an exact camera rotation are not estimated,
    nor part of the uncertainty. Knots every 0.1 s, a window of 1 s; `sections` override."""
    plain: dict[str, dict[str, Any]] = {
        "window": {"knot_interval_s": INTERVAL_NS * 1e-9, "length_s": 1.0},
        "visual": {"pixel_sigma": PIXEL_SIGMA},
        "inertial": {"noise_inflation": 1.0, "walk_inflation": 1.0, "gyroscope_g_sensitivity": 0.0},
        "calibration": {"estimate_imu_scale": False, "estimate_extrinsic_rotation": False},
    }
    for name, values in sections.items():
        plain.setdefault(name, {}).update(values)
    return Config.model_validate(plain)


@cache
def simulated(scenario_seed: int = 0, **changes: Any) -> Simulation:
    return simulate(varied(scenario_seed, **changes))


def varied(seed: int, **changes: Any) -> Scenario:
    return replace(SCENARIO, seed=seed, **changes)


@dataclass
class Outcome:
    """What a run gave, packet by packet."""

    odometry: Odometry
    steps: list[list[Estimate]] = field(default_factory=list)
    reports: list[StepReport] = field(default_factory=list)

    @property
    def estimates(self) -> list[Estimate]:
        return [estimate for step in self.steps for estimate in step]

    @property
    def origins(self) -> list[Estimate]:
        """The knot that defines the world of each segment."""
        return [report.origin for report in self.reports if report.origin is not None]


def cut(recording: Recording) -> list[Packet]:
    """Packets of one knot interval, each ending at a knot: the first also holds what came before."""
    streams = (recording.observations, recording.gyroscope, recording.accelerometer)
    start_ns = max(int(stream["t_ns"][0]) for stream in streams)
    end_ns = min(int(stream["t_ns"][-1]) for stream in streams[1:])
    ends_ns = np.arange(start_ns + INTERVAL_NS, end_ns + 1, INTERVAL_NS)
    cuts = [np.r_[0, np.searchsorted(stream["t_ns"], ends_ns, side="right")] for stream in streams]
    return [
        Packet(int(end), *(stream[c[k] : c[k + 1]] for stream, c in zip(streams, cuts, strict=True)))
        for k, end in enumerate(ends_ns)
    ]


def true_state(after_s: float, sigma: Array = CERTAIN) -> InitialState:
    simulation = simulated()
    t_ns = simulation.truth.start_ns + round(after_s * 1e9)
    true = simulation.truth.at(t_ns)
    return InitialState(
        t_ns, true.T_w_b[0], true.velocity_w[0], true.bias_gyroscope[0], true.bias_accelerometer[0], sigma
    )


def process(stream: Iterable[Packet], calibration: Calibration, config: Config | None = None) -> Outcome:
    return process_with(Odometry(config or configured(), calibration), stream)


def process_with(odometry: Odometry, stream: Iterable[Packet]) -> Outcome:
    outcome = Outcome(odometry)
    for packet in stream:
        estimates, report = outcome.odometry.process(packet)
        assert report.t_ns == packet.t_end_ns
        outcome.steps.append(estimates)
        outcome.reports.append(report)
    return outcome


def run(recording: Recording, config: Config | None = None) -> Outcome:
    return process(cut(recording), recording.calibration, config)


@cache
def plain_run() -> Outcome:
    """The run that others are compared with."""
    return run(simulated().recording)


def merged(stream: list[Packet]) -> Packet:
    """One packet with everything in it."""
    return Packet(
        stream[-1].t_end_ns,
        *(
            np.concatenate([getattr(packet, name) for packet in stream])
            for name in ("observations", "gyroscope", "accelerometer")
        ),
    )


def empty(t_end_ns: int) -> Packet:
    none = np.empty(0, dtype=INERTIAL_DTYPE)
    return Packet(t_end_ns, np.empty(0, dtype=OBSERVATION_DTYPE), none, none)


def as_bytes(estimate: Estimate) -> bytes:
    arrays = [
        estimate.T_w_b,
        estimate.velocity_w,
        estimate.angular_velocity_b,
        estimate.generalized_acceleration,
        estimate.bias_gyroscope,
        estimate.bias_accelerometer,
        estimate.covariance,
    ]
    return b"".join([estimate.t_ns.to_bytes(8, "little"), *(a.tobytes() for a in arrays)])


@dataclass(frozen=True)
class Errors:
    """Largest errors after the first estimate's position and yaw are taken as true: m, deg, m/s."""

    position: float
    tilt: float
    rotation: float
    velocity: float


def errors(simulation: Simulation, estimates: list[Estimate]) -> Errors:
    truth = simulation.truth.at([estimate.t_ns for estimate in estimates])
    T = np.array([estimate.T_w_b for estimate in estimates])
    turn = truth.T_w_b[0, :3, :3] @ T[0, :3, :3].T
    C = Rotation.from_euler("z", np.arctan2(turn[1, 0], turn[0, 0])).as_matrix()
    position = (T[:, :3, 3] - T[0, :3, 3]) @ C.T + truth.T_w_b[0, :3, 3]
    velocity = np.array([estimate.velocity_w for estimate in estimates]) @ C.T
    rotation = Rotation.from_matrix(C @ T[:, :3, :3])
    true_rotation = Rotation.from_matrix(truth.T_w_b[:, :3, :3])
    up, true_up = (R.inv().apply([0.0, 0.0, 1.0]) for R in (rotation, true_rotation))
    tilt = np.linalg.norm(np.cross(up, true_up), axis=1)
    return Errors(
        position=float(np.linalg.norm(position - truth.T_w_b[:, :3, 3], axis=1).max()),
        tilt=float(np.degrees(np.arcsin(np.minimum(tilt, 1.0))).max()),
        rotation=float(np.degrees((rotation.inv() * true_rotation).magnitude()).max()),
        velocity=float(np.linalg.norm(velocity - truth.velocity_w, axis=1).max()),
    )
