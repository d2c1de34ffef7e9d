"""Real IMU, real motion, simulated events: end-to-end from events to a trajectory.

Evidence: hybrid. A smooth path is fitted to the recorded poses and the IMU (`simulation.path_fit`). A
simulated DAVIS240C moves along it through a room, and the estimator uses its events and the real IMU samples,
with the noise of the data sheet. Causal, with the default configuration.

Values are for the longest segment. `after motion`: time of the first estimate since the beginning of motion.
NEES: mean over time; 3 for a consistent covariance. `--inflation 40` also runs with that
`inertial.noise_inflation`.

    python benchmarks/hybrid.py [--names v1_01 tumvi] [--begin S] [--seconds S] [--inflation X ...]
        [--keep-tracks] [--cache DIR]
"""

from __future__ import annotations

import argparse
import hashlib
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accuracy import COLUMNS as _ACCURACY
from accuracy import figures
from asyneio.config import Config, load_config
from asyneio.io import read_inertial_file
from asyneio.io.calibration import read_imu_noise
from asyneio.io.parsing.atomic import atomic_file
from asyneio.io.recording.trajectory_reader import read_trajectory
from asyneio.pipeline import run_recording
from asyneio.simulation import EventScenario, EventSimulation, path_basis, path_fit, path_normal, path_terms
from asyneio.simulation.path_fit import PathFit
from asyneio.simulation.recorded_path import recorded_run
from asyneio.types import NS_PER_S, FloatArray
from common import data_folder, table
from sequences import DEFAULT_CACHE, TrackedRun, cached_sequence, code_of, tracked

#: Camera pose in the IMU: from EuRoC `cam0/sensor.yaml` (Burri et al. 2016, all flights), and the inverse of
#: that in the camchain of tumvi_calib. Both have the viewing direction of the real camera.
_EUROC_T_b_c = np.array(
    [
        [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
        [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
        [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
_TUMVI_T_b_c: FloatArray = np.linalg.inv(
    [
        [-0.999534502198, 0.029104559657, -0.009148962972, 0.046455727138],
        [0.008168413610, -0.033632886581, -0.999400873503, -0.047829472490],
        [-0.029394828378, -0.999010387107, 0.033379492465, -0.072428149125],
        [0.0, 0.0, 0.0, 1.0],
    ]
).astype(np.float64)


@dataclass(frozen=True)
class Source:
    """Files of a recorded motion: poses of an IMU, its samples, its noise; and a camera on it (4,4)."""

    poses: Path
    samples: Path
    noise: Path
    T_b_c: FloatArray


_EUROC, _TUMVI = data_folder() / "euroc_V1_01", data_folder() / "tumvi_calib"
SOURCES = {
    "v1_01": Source(
        _EUROC / "groundtruth_20hz_full_state.csv",
        _EUROC / "imu0_data.csv",
        _EUROC / "imu0_sensor.yaml",
        _EUROC_T_b_c,
    ),
    "tumvi": Source(_TUMVI / "groundtruth.tum", _TUMVI / "imu.csv", _TUMVI / "imu.yaml", _TUMVI_T_b_c),
}
#: Limits for motion: m/s, rad/s.
_MOVES = (0.05, 0.1)
#: Residuals of a fit: RMS (and multiples of the data sheet's sigma), estimated gravity, t_imu - t_pose.
RESIDUALS = (
    "gyroscope rad/s",
    "accelerometer m/s^2",
    "position mm",
    "orientation deg",
    "gravity",
    "clock ms",
)
#: Columns and the formats of their numbers.
COLUMNS = {**_ACCURACY, "after motion s": "+.2f"}


def hybrid_sequence(
    name: str,
    seconds: float | None = None,
    cache: Path = DEFAULT_CACHE,
    begin_s: float = 0.0,
) -> tuple[EventSimulation, PathFit]:
    """A hybrid sequence, with its events from the cache if possible, and its fit.

    `simulation.recording` is the `EventRecording` to run, `simulation.truth.at` gives the true states (with
    the biases estimated by the fit).

    Args:
        name: one of `SOURCES`.
        seconds: duration; None for the rest of the recording.
        cache: folder.
        begin_s: beginning since the first common time of poses and IMU.
    """
    return hybrid_of(name, SOURCES[name], (begin_s, seconds), cache)


def hybrid_of(
    name: str, source: Source, span_s: tuple[float, float | None] = (0.0, None), cache: Path = DEFAULT_CACHE
) -> tuple[EventSimulation, PathFit]:
    """Like `hybrid_sequence`, for any files."""
    samples = read_inertial_file(source.samples)
    noise = read_imu_noise(source.noise)
    fit = _fit(name, source, cache)
    forward_b = source.T_b_c[:3, 2]
    run = recorded_run(fit, samples.gyroscope, samples.accelerometer, forward_b, span_s)
    label = f"hybrid_{name}" + (f"_from{span_s[0]:g}" if span_s[0] else "")
    U, _, Vt = np.linalg.svd(source.T_b_c[:3, :3])
    T_b_c = source.T_b_c.copy()
    T_b_c[:3, :3] = U @ Vt
    return cached_sequence(EventScenario(name=label, T_b_c=T_b_c).along(run, noise), cache), fit


def _fit(name: str, source: Source, cache: Path) -> PathFit:
    """The fit to the complete files, from the cache if possible."""
    files = source.poses, source.samples, source.noise
    key = hashlib.sha256(b"".join(file.read_bytes() for file in files))
    for module in (path_fit, path_terms, path_normal, path_basis):
        key.update(code_of(Path(str(module.__file__))).encode())
    kept = cache / f"hybrid_{name}-fit-{key.hexdigest()[:10]}.pickle"
    if kept.is_file():
        found: PathFit = pickle.loads(kept.read_bytes())
        return found
    poses, _ = read_trajectory(source.poses)
    samples = read_inertial_file(source.samples)
    fit = path_fit.fit_path(poses, samples.gyroscope, samples.accelerometer, read_imu_noise(source.noise))
    with atomic_file(kept) as stream:
        pickle.dump(fit, stream)
    return fit


def hybrid_observations(
    simulation: EventSimulation, config: Config, cache: Path | None = DEFAULT_CACHE
) -> TrackedRun:
    """Observations of the front end, from the cache if possible, for
    `run_recording(simulation.recording, config, observations=...)`."""
    return tracked(simulation, config, cache)


def motion_begins_s(simulation: EventSimulation) -> float:
    """Beginning of motion [s after the start]: 0.05 m/s or 0.1 rad/s along the fitted path."""
    truth = simulation.truth
    t_ns = np.arange(truth.start_ns, truth.end_ns, 50_000_000)
    states = truth.at(t_ns)
    moves = np.linalg.norm(states.velocity_w, axis=1) > _MOVES[0]
    moves |= np.linalg.norm(states.angular_velocity_b, axis=1) > _MOVES[1]
    return float(t_ns[int(np.argmax(moves))] - truth.start_ns) / NS_PER_S


def end_to_end(simulation: EventSimulation, config: Config, cache: Path | None) -> dict[str, float]:
    """The columns of one run. With a cache of tracks the real-time factor is the estimator's alone."""
    kept = hybrid_observations(simulation, config, cache).observations if cache else None
    result = run_recording(simulation.recording, config, observations=kept)
    found = figures(simulation, result)
    if "first s" in found:
        found["after motion s"] = found["first s"] - motion_begins_s(simulation)
    return found


def left_over(fit: PathFit) -> list[str]:
    """Cells of RESIDUALS."""
    r = fit.residuals
    return [
        f"{r.gyroscope:.4f} ({r.gyroscope_sigmas:.1f})",
        f"{r.accelerometer:.4f} ({r.accelerometer_sigmas:.1f})",
        f"{1e3 * r.position:.3f}",
        f"{np.degrees(r.orientation):.4f}",
        f"{np.linalg.norm(fit.gravity):.3f}",
        f"{1e3 * fit.clock_offset_s:+.2f}",
    ]


def main() -> None:
    """Print the residuals of the fits, and a row for each run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--names", nargs="+", default=list(SOURCES), choices=list(SOURCES))
    parser.add_argument("--begin", type=float, default=0.0, help="beginning [s]")
    parser.add_argument("--seconds", type=float, help="duration; default: the rest of the recording")
    parser.add_argument("--inflation", type=float, nargs="*", default=[], help="of IMU noise, further runs")
    parser.add_argument("--keep-tracks", action="store_true", help="cache the observations of the front end")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE, help="of events")
    options = parser.parse_args()
    fits, rows = [], []
    for name in options.names:
        simulation, fit = hybrid_sequence(name, options.seconds, options.cache, options.begin)
        fits.append([name, *left_over(fit)])
        print(" | ".join(fits[-1]), flush=True)
        for inflation in (None, *options.inflation):
            config = load_config(None, {"inertial": {"noise_inflation": inflation}} if inflation else None)
            found = end_to_end(simulation, config, options.cache if options.keep_tracks else None)
            label = f"{name}, noise times {inflation:g}" if inflation else name
            rows.append(
                [label, *(f"{found[c]:{form}}" if c in found else "-" for c, form in COLUMNS.items())]
            )
            print(" | ".join(rows[-1]), flush=True)
    print(f"\n{table(['poses and IMU', *RESIDUALS], fits)}\n\n{table(['run', *COLUMNS], rows)}")


if __name__ == "__main__":
    main()
