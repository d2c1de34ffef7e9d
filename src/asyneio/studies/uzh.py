# SPDX-License-Identifier: Apache-2.0
"""Benchmark on the UZH event camera data set (DAVIS240C): one measurement for each sequence in a folder.

The ground truth is the pose of the camera in the camera clock (Mueggler et al. 2017); the estimate is that of
the IMU. The estimate is therefore transformed to the camera by the extrinsics, and to its clock by the time
shift.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.config import Config
from asyneio.errors import EstimationError, EvaluationError, RecordingError, StudyError
from asyneio.evaluation import evaluate, protocol_named
from asyneio.io import ReadOptions, open_recording
from asyneio.pipeline import RunResult, run_recording
from asyneio.pipeline.packets import calibration_of
from asyneio.studies.published import COMPARED
from asyneio.studies.study import fingerprint
from asyneio.types import NS_PER_S, Calibration, Estimate, EventRecording, PoseTrajectory

#: Default sequences: those with translation and with ground truth over their whole duration.
SEQUENCES = (*COMPARED, "shapes_translation", "shapes_6dof")
#: Protocols of the comparison with ground truth: ours, and those of published results.
PROTOCOLS = ("posyaw", "uslam", "hku")

_EVENTS_FILE = "events.txt"
_ARCHIVES = (".bag", ".zip")


@dataclass(frozen=True)
class SequenceTask:
    """A sequence and its path; size and modification time identify its contents.

    `seconds`: duration of the measured part; 0: all.
    """

    sequence: str
    source: str
    size: int
    mtime_ns: int
    seconds: float
    seed: int = 0


@dataclass(frozen=True)
class BenchSettings:
    """Settings of all sequences. `calibration` and `imu` are paths, `camera` and `preset` are names."""

    config: Config
    preset: str | None
    calibration: str | None = None
    imu: str | None = None
    camera: str | None = None

    @property
    def fingerprint(self) -> str:
        """Hash of everything except the sequence that results depend on, including contents of files."""
        plain = asdict(replace(self, config=Config())) | {"config": self.config.model_dump()}
        for name in ("calibration", "imu"):
            if plain[name] is not None:
                plain[name] = _digest(Path(plain[name]))
        return fingerprint("bench-uzh", plain)


def find_sequences(data: Path, names: Sequence[str] = (), seconds: float = 0.0) -> tuple[SequenceTask, ...]:
    """Sequences in a folder or its subfolders: each is a folder, a bag or a zip archive with that name.

    Args:
        data: folder to search.
        names: names of sequences; empty: all of SEQUENCES that exist.
        seconds: duration of each that is measured.

    Raises:
        StudyError: the folder does not exist, or sequences are missing.
    """
    if not data.is_dir():
        raise StudyError(f"{data} is not a folder; expected the folder that contains the sequences")
    found = {name: source for name in names or SEQUENCES if (source := _source(data, name)) is not None}
    missing = [name for name in names if name not in found]
    if missing or not found:
        what = f"no sequence {', '.join(missing)}" if missing else "no sequence of the UZH data set"
        raise StudyError(
            f"{what} in {data}; expected folders with events.txt, or .bag or .zip files, with the data "
            f"set's names: {', '.join(SEQUENCES)}"
        )
    return tuple(_task(name, source, seconds) for name, source in found.items())


def measure_sequence(task: SequenceTask, settings: BenchSettings) -> dict[str, float]:
    """Run one sequence and compare it with its ground truth.

    Returns:
        For each protocol `mpe_percent_NAME` and `yaw_deg_per_m_NAME` (NaN where it does not apply), and
        `scale_error_percent`, `duration_s`, `path_m`, `covered_s` (seconds with an estimate), `events`,
        `processing_s`, `real_time_factor`.

    Raises:
        EstimationError: the trajectory is missing or incomplete.
        RecordingError, CalibrationError, EvaluationError: the sequence cannot be used.
    """
    calibration, imu = (Path(path) if path else None for path in (settings.calibration, settings.imu))
    options = ReadOptions(calibration, imu, camera=settings.camera, preset=settings.preset)
    recording = open_recording(Path(task.source), options)
    if not isinstance(recording, EventRecording):
        raise RecordingError(f"{task.source} contains tracks; expected events")
    if recording.ground_truth is None:
        raise EvaluationError(f"{task.source} has no ground truth; expected groundtruth.txt with the events")
    part = first_seconds(recording, task.seconds) if task.seconds else recording
    result = run_recording(part, settings.config)
    if result.summary.failure:
        raise EstimationError(result.summary.failure)
    trajectory = camera_trajectory(result.run.estimates, calibration_of(recording))
    return _figures(result, trajectory, recording.ground_truth)


def first_seconds(recording: EventRecording, seconds: float) -> EventRecording:
    """The recording up to `seconds` after its first event; the ground truth is not cut."""
    shift_ns = recording.calibration.timeshift_ns if recording.calibration else 0
    end_ns = int(recording.events["t_ns"][0]) + round(seconds * NS_PER_S)
    gyroscope, accelerometer = (
        stream[: np.searchsorted(stream["t_ns"], end_ns + shift_ns, side="right")]
        for stream in (recording.gyroscope, recording.accelerometer)
    )
    events = recording.events[: np.searchsorted(recording.events["t_ns"], end_ns, side="right")]
    return replace(recording, events=events, gyroscope=gyroscope, accelerometer=accelerometer)


def camera_trajectory(estimates: Sequence[Estimate], calibration: Calibration) -> PoseTrajectory:
    """Poses of the camera in its clock, from those of the IMU."""
    T_w_c = np.array([estimate.T_w_b for estimate in estimates]) @ calibration.T_b_c
    return PoseTrajectory(
        np.array([estimate.t_ns for estimate in estimates], dtype=np.int64) - calibration.timeshift_ns,
        T_w_c[:, :3, 3].copy(),
        Rotation.from_matrix(T_w_c[:, :3, :3]).as_quat(),
    )


def _figures(result: RunResult, trajectory: PoseTrajectory, truth: PoseTrajectory) -> dict[str, float]:
    figures: dict[str, float] = {}
    for name in PROTOCOLS:
        try:
            score = evaluate(trajectory, truth, protocol_named(name))
        except EvaluationError:
            if name == PROTOCOLS[0]:
                raise
            # A protocol whose window is beyond the end of a short run has no result.
            figures |= {f"mpe_percent_{name}": np.nan, f"yaw_deg_per_m_{name}": np.nan}
            continue
        figures |= {
            f"mpe_percent_{name}": score.mpe_percent,
            f"yaw_deg_per_m_{name}": score.yaw_error_deg_per_m,
        }
        if name == PROTOCOLS[0]:
            figures |= {
                "scale_error_percent": score.scale_error_percent,
                "path_m": score.path_length_m,
                "covered_s": score.duration_s,
            }
    summary = result.summary
    return figures | {
        "duration_s": summary.duration_s,
        "events": float(summary.events or 0),
        "processing_s": summary.processing_s,
        "real_time_factor": summary.real_time_factor,
    }


def _source(data: Path, name: str) -> Path | None:
    """Path of a sequence: a folder, else a bag, else an archive; in this folder, else in a subfolder."""
    for folder in (data, *sorted(path for path in data.iterdir() if path.is_dir())):
        if (folder / name / _EVENTS_FILE).is_file():
            return folder / name
        for suffix in _ARCHIVES:
            if (folder / f"{name}{suffix}").is_file():
                return folder / f"{name}{suffix}"
    return None


def _task(name: str, source: Path, seconds: float) -> SequenceTask:
    status = (source / _EVENTS_FILE if source.is_dir() else source).stat()
    return SequenceTask(name, str(source.resolve()), status.st_size, status.st_mtime_ns, seconds)


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise StudyError(f"cannot read {path}: {error.strerror or error}") from error
