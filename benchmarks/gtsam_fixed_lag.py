"""Comparison with gtsam's incremental fixed-lag smoother (iSAM2, C++): same observations, same window.

    python benchmarks/gtsam_fixed_lag.py [--scenes suite_boxes_6dof] [--seconds 10] [--intervals 0.025 0.1]

Evidence: simulated events. The front end tracks once; both estimators use its observations, the same
undistorted pixels, inertial samples, noise densities (with the same inflation), Cauchy cost and window
length. One process and one thread each (except for threads of gtsam itself, if its build has any).

gtsam solves the common discrete problem, because it has no counterpart of observations at individual times:
states (pose, velocity, biases) at a fixed interval, connected by combined inertial factors, and explicit
points. For each track and state there is one projection factor: the observation nearest in time, interpolated
linearly to the time of the state. With states every 25 ms, nearly every observation has its own factor (the
front end observes a feature at most every 20 ms). With states every 100 ms, like our knots, three of four
observations are not used, which reduces gtsam's time; in another row all of them are used, moved by up to 50
ms. A point is triangulated at its fourth factor, with a weak prior. A state is initialized by propagation of
the inertial samples; the first one is the true state, which our estimator has to find.

For gtsam, only `update` is timed, with one call per state (one iteration of iSAM2 each), and preintegration
separately (its loop over samples is in Python); building factors is not. For our estimator everything is
timed, including covariance and health. Initialization is excluded for both. On a busy machine, compare CPU
times.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, L, V, X
from scipy.spatial.transform import Rotation

from asyneio.config import Config
from asyneio.evaluation import evaluate, pose_trajectory, protocol_named
from asyneio.geometry.camera import CameraModel
from asyneio.pipeline import run_recording
from asyneio.pipeline.packets import calibration_of
from asyneio.simulation import EventSimulation
from asyneio.studies.speed_stages import stage_times
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory, RecordArray
from common import run, table
from sequences import DEFAULT_CACHE, sequence

HEADER = [
    "estimator",
    "states a second",
    "visual factors per second",
    "ms per second of data",
    "CPU ms",
    "times real time",
    "ms per state: median",
    "99 %",
    "ATE cm",
    "remark",
]
#: Minimum number of factors of a point, its prior [m], and its maximum distance from the camera [m].
_BIRTH, _POINT_SIGMA, _FAR_M = 4, 10.0, 50.0
#: Factor on the walk of the biases for gtsam: with the true one, the Cholesky factorisation of states 25 ms
#: apart fails ("indeterminate linear system"), because it connects them a million times more strongly than
#: anything else.
_WALK = 10.0
#: Standard deviations of the first state, which is the true one: pose, velocity, biases.
_FIRST = (1e-3, 1e-2, 0.05)


@dataclass
class Costs:
    """Wall-clock seconds of each update, CPU seconds of all updates, and seconds of all preintegration."""

    update_s: list[float] = field(default_factory=list)
    cpu_s: float = 0.0
    preintegration_s: float = 0.0
    factors: int = 0
    remark: str = ""


@dataclass(frozen=True)
class Sightings:
    """Projection factors of one state: tracks and normalised image coordinates (n,2)."""

    track: IntArray
    xy: FloatArray


def sightings(
    simulation: EventSimulation, observations: RecordArray, states_ns: IntArray, every: bool = False
) -> list[Sightings]:
    """For each state, the nearest observation of each track, or `every` one nearest to this state,
    interpolated to its time."""
    camera = CameraModel(calibration_of(simulation.recording).camera)
    xy, _, valid = camera.undistort(np.column_stack([observations["u"], observations["v"]]))
    seen, xy = observations[valid], xy[valid]
    step_ns = int(states_ns[1] - states_ns[0])
    found: list[list[tuple[int, FloatArray]]] = [[] for _ in states_ns]
    order = np.lexsort((seen["t_ns"], seen["id"]))
    _, begins = np.unique(seen["id"][order], return_index=True)
    for rows in np.split(order, begins[1:]):
        if len(rows) < 2:
            continue
        t_ns, track = seen["t_ns"][rows], int(seen["id"][rows[0]])
        state = np.rint((t_ns - states_ns[0]) / step_ns).astype(np.int64)
        inside = np.flatnonzero((state >= 0) & (state < len(states_ns)))
        off_ns = states_ns[np.clip(state, 0, len(states_ns) - 1)] - t_ns
        if not every:
            # Of those of one state the nearest comes first.
            inside = inside[np.lexsort((np.abs(off_ns[inside]), state[inside]))]
            inside = inside[np.unique(state[inside], return_index=True)[1]]
        for n in inside.tolist():
            a = min(max(n if off_ns[n] >= 0 else n - 1, 0), len(rows) - 2)
            slope = (xy[rows[a + 1]] - xy[rows[a]]) / max(int(t_ns[a + 1] - t_ns[a]), 1)
            found[int(state[n])].append((track, xy[rows[n]] + slope * off_ns[n]))
    return [
        Sightings(np.array([t for t, _ in one], dtype=np.int64), np.array([p for _, p in one]).reshape(-1, 2))
        for one in found
    ]


class FixedLag:
    """States and points in gtsam's incremental fixed-lag smoother."""

    def __init__(self, simulation: EventSimulation, config: Config, interval_s: float) -> None:
        self._recording, self._config, self._interval_s = simulation.recording, config, interval_s
        self._calibration = calibration = calibration_of(simulation.recording)
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(0.01)
        parameters.relinearizeSkip = 1
        self._smoother = gtsam.IncrementalFixedLagSmoother(config.window.length_s, parameters)
        self._preintegration = _preintegration(config, simulation)
        self._lens = gtsam.Cal3_S2(1.0, 1.0, 0.0, 0.0, 0.0)
        self._T_b_c = gtsam.Pose3(calibration.T_b_c)
        sigma = config.visual.pixel_sigma / (0.5 * (calibration.camera.fx + calibration.camera.fy))
        cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(config.visual.robust_scale)
        isotropic = gtsam.noiseModel.Isotropic.Sigma(2, sigma)
        self._pixel = gtsam.noiseModel.Robust.Create(cauchy, isotropic)
        self._pending: dict[int, list[tuple[int, FloatArray]]] = defaultdict(list)
        self._last_seen: dict[int, int] = {}
        self._poses: dict[int, gtsam.Pose3] = {}
        self._bias = gtsam.imuBias.ConstantBias()
        self._state = gtsam.NavState()
        self.costs = Costs()

    def begin(self, pose: FloatArray, velocity: FloatArray) -> None:
        """State 0 at its true pose (4,4) and velocity (3,)."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._state = gtsam.NavState(gtsam.Pose3(pose), velocity)
        models = [gtsam.noiseModel.Isotropic.Sigma(d, s) for d, s in zip((6, 3, 6), _FIRST, strict=True)]
        graph.add(gtsam.PriorFactorPose3(X(0), self._state.pose(), models[0]))
        graph.add(gtsam.PriorFactorVector(V(0), velocity, models[1]))
        graph.add(gtsam.PriorFactorConstantBias(B(0), self._bias, models[2]))
        self._insert(values, 0)
        self._update(0, graph, values, [])

    def advance(self, k: int, bounds_ns: tuple[int, int], seen: Sightings) -> FloatArray:
        """Add state k from the samples since state k - 1 and its observations; returns its pose (4,4)."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        started = time.perf_counter()
        measured = self._integrate(bounds_ns)
        self.costs.preintegration_s += time.perf_counter() - started
        graph.add(gtsam.CombinedImuFactor(X(k - 1), V(k - 1), X(k), V(k), B(k - 1), B(k), measured))
        self._state = measured.predict(self._state, self._bias)
        self._insert(values, k)
        touched = [
            track
            for track, xy in zip(seen.track.tolist(), seen.xy, strict=True)
            if self._see(graph, values, k, track, xy)
        ]
        self._update(k, graph, values, touched)
        pose = self._smoother.calculateEstimatePose3(X(k))
        self._state = gtsam.NavState(pose, self._smoother.calculateEstimateVector(V(k)))
        self._bias = self._smoother.calculateEstimateConstantBias(B(k))
        self._poses[k] = pose
        return np.asarray(pose.matrix())

    def _integrate(self, bounds_ns: tuple[int, int]) -> gtsam.PreintegratedCombinedMeasurements:
        measured = gtsam.PreintegratedCombinedMeasurements(self._preintegration, self._bias)
        gyroscope, accelerometer = self._recording.gyroscope, self._recording.accelerometer
        a, b = np.searchsorted(gyroscope["t_ns"], bounds_ns, side="right")
        ends_ns = np.r_[bounds_ns[0], gyroscope["t_ns"][a : b - 1], bounds_ns[1]]
        forces = np.column_stack(
            [
                np.interp(gyroscope["t_ns"][a:b], accelerometer["t_ns"], accelerometer["xyz"][:, axis])
                for axis in range(3)
            ]
        )
        for force, omega, dt_ns in zip(forces, gyroscope["xyz"][a:b], np.diff(ends_ns), strict=True):
            if dt_ns > 0:
                measured.integrateMeasurement(force, omega, float(dt_ns) / NS_PER_S)
        return measured

    def _see(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        k: int,
        track: int,
        xy: FloatArray,
    ) -> bool:
        """Add an observation; returns whether the track has a point."""
        lag = round(self._config.window.length_s / self._interval_s) - 1
        if track in self._last_seen and k - self._last_seen[track] < lag:
            self._project(graph, k, track, xy)
            self._last_seen[track] = k
            return True
        pending = [one for one in self._pending[track] if k - one[0] < lag and one[0] in self._poses]
        self._pending[track] = [*pending, (k, xy)]
        if len(pending) < _BIRTH - 1 or track in self._last_seen:
            return False
        point = self._triangulate(pending)
        if point is None:
            return False
        values.insert(L(track), point)
        weak = gtsam.noiseModel.Isotropic.Sigma(3, _POINT_SIGMA)
        graph.add(gtsam.PriorFactorPoint3(L(track), point, weak))
        for at, seen in self._pending.pop(track):
            self._project(graph, at, track, seen)
        self._last_seen[track] = k
        return True

    def _triangulate(self, seen: list[tuple[int, FloatArray]]) -> FloatArray | None:
        """The intersection of the rays, if it is in front of the camera and near enough."""
        A, b = np.zeros((3, 3)), np.zeros(3)
        T_w_c = [self._poses[at].matrix() @ self._calibration.T_b_c for at, _ in seen]
        for T, (_, xy) in zip(T_w_c, seen, strict=True):
            ray = T[:3, :3] @ np.array([*xy, 1.0])
            across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
            A, b = A + across, b + across @ T[:3, 3]
        if np.linalg.cond(A) > 1e6:
            return None
        point: FloatArray = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
        depth = (T_w_c[-1][:3, :3].T @ (point - T_w_c[-1][:3, 3]))[2]
        return point if 0.1 < depth < _FAR_M else None

    def _project(self, graph: gtsam.NonlinearFactorGraph, k: int, track: int, xy: FloatArray) -> None:
        graph.add(
            gtsam.GenericProjectionFactorCal3_S2(
                xy, self._pixel, X(k), L(track), self._lens, False, False, self._T_b_c
            )
        )
        self.costs.factors += 1

    def _insert(self, values: gtsam.Values, k: int) -> None:
        values.insert(X(k), self._state.pose())
        values.insert(V(k), self._state.velocity())
        values.insert(B(k), self._bias)
        self._poses[k] = self._state.pose()

    def _update(
        self, k: int, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, touched: list[int]
    ) -> None:
        """Add the factors; points remain as long as they are observed."""
        stamps = gtsam.FixedLagSmootherKeyTimestampMap()
        for key in (X(k), V(k), B(k), *(L(track) for track in touched)):
            stamps.insert((key, k * self._interval_s))
        started, started_cpu = time.perf_counter(), time.process_time()
        self._smoother.update(graph, values, stamps)
        self.costs.update_s.append(time.perf_counter() - started)
        self.costs.cpu_s += time.process_time() - started_cpu


def _preintegration(config: Config, simulation: EventSimulation) -> gtsam.PreintegrationCombinedParams:
    noise, inertial = calibration_of(simulation.recording).noise, config.inertial
    white = inertial.noise_inflation * np.array([noise.gyroscope_density, noise.accelerometer_density])
    walk = _WALK * inertial.walk_inflation * np.array([noise.gyroscope_walk, noise.accelerometer_walk])
    parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(inertial.gravity)
    parameters.setGyroscopeCovariance(white[0] ** 2 * np.eye(3))
    parameters.setAccelerometerCovariance(white[1] ** 2 * np.eye(3))
    parameters.setBiasOmegaCovariance(walk[0] ** 2 * np.eye(3))
    parameters.setBiasAccCovariance(walk[1] ** 2 * np.eye(3))
    parameters.setIntegrationCovariance(1e-10 * np.eye(3))
    return parameters


def run_fixed_lag(
    simulation: EventSimulation,
    config: Config,
    observations: RecordArray,
    states: tuple[float, bool],
    start_ns: int,
) -> tuple[Costs, PoseTrajectory | None]:
    """Process the recording from `start_ns` on, or until gtsam fails.

    `states`: their interval [s], and whether every observation is used.
    """
    interval_s, every = states
    end_ns = int(observations["t_ns"][-1])
    step_ns = round(interval_s * NS_PER_S)
    states_ns: IntArray = np.arange(start_ns, end_ns, step_ns, dtype=np.int64)
    seen = sightings(simulation, observations, states_ns, every)
    smoother = FixedLag(simulation, config, interval_s)
    truth = simulation.truth.at(states_ns[:1])
    smoother.begin(truth.T_w_b[0], truth.velocity_w[0])
    poses = [truth.T_w_b[0]]
    try:
        for k in range(1, len(states_ns)):
            bounds_ns = (int(states_ns[k - 1]), int(states_ns[k]))
            poses.append(smoother.advance(k, bounds_ns, seen[k]))
    except (RuntimeError, IndexError, ValueError) as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        smoother.costs.remark = f"failed after {(len(poses) - 1) * interval_s:.2f} s: {first}"
    T = np.array(poses)
    quaternions = Rotation.from_matrix(T[:, :3, :3]).as_quat()
    return smoother.costs, PoseTrajectory(states_ns[: len(T)], T[:, :3, 3].copy(), quaternions)


def main() -> None:
    """Print a table for each scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=["suite_boxes_6dof"])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--intervals", type=float, nargs="+", default=[0.025, 0.1], help="of gtsam's states")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    options = parser.parse_args()
    for scene in options.scenes:
        simulation = sequence(scene, 0, options.seconds, options.cache)
        print(f"## {scene}, {options.seconds:g} s\n\n{table(HEADER, rows(simulation, options.intervals))}\n")


def rows(simulation: EventSimulation, intervals: list[float]) -> list[list[str]]:
    """Our estimator, and gtsam with states at each of the intervals, over the time span of our estimates."""
    config, recording = Config(), simulation.recording
    tracked = run(recording, config)
    # A second run on its observations, without the front end in parallel.
    with stage_times() as times:
        ours = run_recording(recording, config, observations=tracked.observations)
    cpu_s = sum(spent for name, spent in times.cpu_seconds.items() if name != "start")
    start_ns = ours.run.estimates[0].t_ns
    steps = np.array([report.seconds for report in ours.run.reports if report.t_ns >= start_ns])
    seconds = (ours.run.reports[-1].t_ns - start_ns) / NS_PER_S
    used = tracked.observations["t_ns"] >= start_ns
    poses = pose_trajectory(ours.run.estimates)
    # Without initialization, because gtsam is given its first state.
    ate = _ate_cm(poses, simulation)
    found = [_row("asyneio", steps[1:], cpu_s, int(used.sum()), seconds, [ate, ""])]
    # If several observations of a track are near one state, also with all of them.
    kinds = [(s, every) for s in intervals for every in ((False, True) if s > 0.03 else (False,))]
    for interval_s, every in kinds:
        states = interval_s, every
        costs, trajectory = run_fixed_lag(simulation, config, tracked.observations, states, start_ns)
        done_s = max(len(costs.update_s) - 1, 1) * interval_s
        remark = f"preintegration {1e3 * costs.preintegration_s / done_s:.0f} ms per second. {costs.remark}"
        ate = _ate_cm(trajectory, simulation)
        update_s = np.array(costs.update_s[1:])
        name = f"gtsam, {interval_s:g} s{', all observations' if every else ''}"
        found.append(_row(name, update_s, costs.cpu_s, costs.factors, done_s, [ate, remark.strip()]))
    return found


def _ate_cm(trajectory: PoseTrajectory | None, simulation: EventSimulation) -> str:
    truth = simulation.recording.ground_truth
    if trajectory is None or truth is None or len(trajectory.t_ns) < 10:
        return "-"
    return f"{100 * evaluate(trajectory, truth, protocol_named('posyaw')).position_m.rmse:.2f}"


def _row(
    name: str, step_s: FloatArray, cpu_s: float, factors: int, seconds: float, more: list[str]
) -> list[str]:
    if step_s.size == 0:
        return [name, *["-"] * 7, *more]
    total_s = float(step_s.sum())
    median, p99 = np.percentile(step_s, [50.0, 99.0])
    return [
        name,
        f"{len(step_s) / seconds:.0f}",
        f"{factors / seconds:.0f}",
        f"{1e3 * total_s / seconds:.0f}",
        f"{1e3 * cpu_s / seconds:.0f}",
        f"{seconds / total_s:.2f}",
        f"{1e3 * median:.1f}",
        f"{1e3 * p99:.1f}",
        *more,
    ]


if __name__ == "__main__":
    main()
