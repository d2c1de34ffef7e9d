"""Real IMU, real motion, simulated events: from events to a trajectory, end to end.

Evidence: hybrid. A smooth path is fitted to the recorded poses and to the IMU (`asyneio.simulation.path_fit`);
a simulated DAVIS240C goes along it through a room, and the estimator is given its events and the real samples
of the IMU as they are, with the noise of its data sheet. Causal, with the default configuration.

    python benchmarks/hybrid.py [--names v1_01 tumvi] [--span BEGIN SECONDS] [--inflation X] [--cache DIR]
"""

from __future__ import annotations

import hashlib
import pickle
from pathlib import Path

import numpy as np

from asyneio.config import Config
from asyneio.io import read_inertial_file
from asyneio.io.calibration import read_imu_noise
from asyneio.io.truth_text import read_truth_file
from asyneio.io.atomic import atomic_file
from asyneio.simulation import EventScenario, EventSimulation, path_basis, path_fit, path_normal, path_terms
from asyneio.simulation.path_fit import PathFit
from asyneio.simulation.recorded_path import recorded_run
from asyneio.types import FloatArray
from common import data_folder
from sequences import DEFAULT_CACHE, TrackedRun, cached_sequence, code_of, tracked

#: Camera in the IMU: of EuRoC `cam0/sensor.yaml` (Burri et al. 2016, all flights), of the camchain beside
#: tumvi_calib inverted. Both look where the real camera looked.
_EUROC_T_b_c = np.array(
    [
        [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
        [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
        [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
_TUMVI_T_b_c = np.linalg.inv(
    [
        [-0.999534502198, 0.029104559657, -0.009148962972, 0.046455727138],
        [0.008168413610, -0.033632886581, -0.999400873503, -0.047829472490],
        [-0.029394828378, -0.999010387107, 0.033379492465, -0.072428149125],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
#: Folder, poses, samples, noise, camera.
_FILES = {
    "v1_01": (
        "euroc_V1_01",
        "groundtruth_20hz_full_state.csv",
        "imu0_data.csv",
        "imu0_sensor.yaml",
        _EUROC_T_b_c,
    ),
    "tumvi": ("tumvi_calib", "groundtruth.tum", "imu.csv", "imu.yaml", _TUMVI_T_b_c),
}


def hybrid_sequence(
    name: str,
    seconds: float | None = None,
    cache: Path = DEFAULT_CACHE,
    begin_s: float = 0.0,
) -> tuple[EventSimulation, PathFit]:
    """A hybrid sequence, its events from the cache where they are there; and the fit behind it.

    `simulation.recording` is the `EventRecording` to run, `simulation.truth.at` the true states (biases as
    the fit found them).

    Args:
        name: `v1_01` or `tumvi`.
        seconds: length; None for all that follows.
        cache: folder.
        begin_s: where to start, after the first instant that poses and IMU have in common.
    """
    folder, poses, samples, noise, T_b_c = _FILES[name]
    files = [data_folder() / folder / file for file in (poses, samples, noise)]
    return hybrid_of(name, *files, T_b_c, seconds, cache, begin_s)


def hybrid_of(
    name: str,
    poses_file: Path,
    imu_file: Path,
    noise_file: Path,
    T_b_c: FloatArray,
    seconds: float | None = None,
    cache: Path = DEFAULT_CACHE,
    begin_s: float = 0.0,
) -> tuple[EventSimulation, PathFit]:
    """As `hybrid_sequence`, of any file of poses (of the IMU), any of its samples, and its noise."""
    poses, _ = read_truth_file(poses_file)
    samples = read_inertial_file(imu_file)
    noise = read_imu_noise(noise_file)
    key = hashlib.sha256(b"".join(file.read_bytes() for file in (poses_file, imu_file, noise_file)))
    for module in (path_fit, path_terms, path_normal, path_basis):
        key.update(code_of(Path(str(module.__file__))).encode())
    kept = cache / f"hybrid_{name}-fit-{key.hexdigest()[:10]}.pickle"
    if kept.is_file():
        fit = pickle.loads(kept.read_bytes())
    else:
        fit = path_fit.fit_path(poses, samples.gyroscope, samples.accelerometer, noise)
        with atomic_file(kept) as file:
            pickle.dump(fit, file)
    run = recorded_run(fit, samples.gyroscope, samples.accelerometer, T_b_c[:3, 2], (begin_s, seconds))
    U, _, Vt = np.linalg.svd(T_b_c[:3, :3])
    T_b_c = T_b_c.copy()
    T_b_c[:3, :3] = U @ Vt
    label = f"hybrid_{name}" + (f"_from{begin_s:g}" if begin_s else "")
    scenario = EventScenario(name=label, T_b_c=T_b_c).along(run, noise)
    return cached_sequence(scenario, cache), fit


def hybrid_observations(simulation: EventSimulation, config: Config, cache: Path = DEFAULT_CACHE) -> TrackedRun:
    """What the front end makes of it, from the cache where it is there: for
    `run_recording(simulation.recording, config, observations=...)`."""
    return tracked(simulation, config, cache)
