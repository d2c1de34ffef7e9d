"""The folder of the UZH event camera data set.

events.txt       t x y p                        seconds, camera clock
imu.txt          t ax ay az gx gy gz            optional; m/s^2 and rad/s, IMU clock
groundtruth.txt  t px py pz qx qy qz qw         optional
calib.txt        fx fy cx cy k1 k2 p1 p2 k3     optional; radtan
camchain-imucam.yaml, imu.yaml                  optional; Kalibr's layout: extrinsics, time shift, IMU noise
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import CalibrationError, RecordingError
from asyneio.io.csv_table import bad_lines_note, read_text
from asyneio.io.event_assembly import assemble, find_rig, prepare_samples, with_camera
from asyneio.io.event_cache import EventTable, load_events
from asyneio.io.event_checks import SensorSizeError
from asyneio.io.event_source import SAMPLE_DTYPE, Progress
from asyneio.io.event_text import TextEvents
from asyneio.io.kalibr import parse_intrinsics
from asyneio.io.seconds_table import read_rows
from asyneio.io.tum import read_tum
from asyneio.types import CameraIntrinsics, Distortion, EventRecording, PoseTrajectory, RecordArray

EVENTS_FILE, SAMPLES_FILE, TRUTH_FILE, LENS_FILE = "events.txt", "imu.txt", "groundtruth.txt", "calib.txt"

#: Sensors tried in this order where no file tells the size: DAVIS240, DVXplorer Lite, DAVIS346, VGA, HD.
_USUAL_SIZES = ((240, 180), (320, 240), (346, 260), (640, 480), (1280, 720))


def read_uzh_folder(
    path: Path,
    calibration: Path | None = None,
    imu: Path | None = None,
    progress: Progress | None = None,
    cache_from: int | None = None,
) -> EventRecording:
    """Read and validate a folder, or a file of events with the others beside it.

    Args:
        path: the folder (its events in events.txt) or the file of events.
        calibration: Kalibr camera file; None: camchain-imucam.yaml in the folder, if there is one.
        imu: Kalibr IMU file; None: imu.yaml in the folder, if there is one.
        progress: is told the fraction of the events converted.
        cache_from: see `load_events`.

    Raises:
        RecordingError: a file is missing, malformed or contradicts the others.
        CalibrationError: a calibration file is malformed or impossible.
    """
    events_path = path / EVENTS_FILE if path.is_dir() else path
    folder = events_path.parent
    if not events_path.is_file():
        raise RecordingError(f"{path} holds no {EVENTS_FILE}; expected lines of t[s] x y p")
    rig = find_rig(folder, calibration, imu)
    declared_hz = rig.calibration.noise.rate_hz if rig.calibration else None
    samples, samples_notes = _read_samples(folder / SAMPLES_FILE)
    inertial = prepare_samples(samples, declared_hz, SAMPLES_FILE)
    truth, truth_notes = _read_truth(folder / TRUTH_FILE)
    table, size, size_notes = _load(events_path, rig.camera, progress, cache_from)
    if rig.camera is None and (folder / LENS_FILE).is_file():
        rig = with_camera(rig, read_lens(folder / LENS_FILE, *size))
    name = folder.resolve().name if events_path.name == EVENTS_FILE else events_path.stem
    return assemble(name, table, size, rig, inertial, truth, size_notes + samples_notes + truth_notes)


def read_lens(path: Path, width: int, height: int) -> CameraIntrinsics:
    """`calib.txt`, which does not tell the sensor's size. Raises CalibrationError where it is no lens."""
    tokens = read_text(path).split()
    try:
        values = [float(token) for token in tokens]
    except ValueError:
        values = []
    if len(values) not in (8, 9):
        raise CalibrationError(f"{path} holds no lens; expected nine numbers: fx fy cx cy k1 k2 p1 p2 k3")
    section = {
        "intrinsics": values[:4],
        "resolution": [width, height],
        "distortion_model": str(Distortion.RADTAN),
        "distortion_coeffs": values[4:],
    }
    return parse_intrinsics(section, path)


def _load(
    path: Path, camera: CameraIntrinsics | None, progress: Progress | None, cache_from: int | None
) -> tuple[EventTable, tuple[int, int], tuple[str, ...]]:
    """Events, the size of the sensor, and a sentence where it was guessed."""
    if camera is not None:
        size = camera.width, camera.height
        return load_events(TextEvents(path), *size, progress, cache_from), size, ()
    for size in _USUAL_SIZES:
        try:
            table = load_events(TextEvents(path), *size, progress, cache_from)
        except SensorSizeError:
            continue
        text = f"no file tells the sensor's size: taken to be {size[0]} x {size[1]}, which holds the events"
        return table, size, (text,)
    raise RecordingError(
        f"the events of {path} fit no usual sensor (up to {size[0]} x {size[1]}); give the size as the "
        "resolution in camchain-imucam.yaml"
    )


def _read_samples(path: Path) -> tuple[RecordArray, tuple[str, ...]]:
    """Samples as they stand in the file; none where there is no file."""
    if not path.is_file():
        return np.empty(0, dtype=SAMPLE_DTYPE), ()
    rows, bad = read_rows(path, "t[s] ax ay az gx gy gz")
    samples = np.array([(t_ns, values[3:], values[:3]) for t_ns, values in rows], dtype=SAMPLE_DTYPE)
    return samples, bad_lines_note(path, bad)


def _read_truth(path: Path) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    return read_tum(path) if path.is_file() else (None, ())
