"""The folder of the UZH event camera data set.

events.txt       t x y p                        seconds, camera clock
imu.txt          t ax ay az gx gy gz            optional; m/s^2 and rad/s, IMU clock
groundtruth.txt  t px py pz qx qy qz qw         optional
calib.txt        fx fy cx cy k1 k2 p1 p2 k3     optional; radtan
camchain-imucam.yaml, imu.yaml                  optional; Kalibr's layout: extrinsics, time shift, IMU noise
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from asyneio.errors import CalibrationError
from asyneio.io.beside import samples_beside
from asyneio.io.calibration import find_rig
from asyneio.io.calibration.lens import make_lens
from asyneio.io.contents import Contents, ReadOptions, Rig, Samples, no_samples, split_samples
from asyneio.io.csv_table import TextFile, bad_lines_note, read_text
from asyneio.io.event_source import SAMPLE_DTYPE, EventSource
from asyneio.io.event_text import TextEvents
from asyneio.io.gzip_file import GzipFile
from asyneio.io.seconds_table import read_rows
from asyneio.io.tum import read_tum
from asyneio.types import CameraIntrinsics, Distortion, PoseTrajectory

EVENTS_FILE, SAMPLES_FILE, TRUTH_FILE, LENS_FILE = "events.txt", "imu.txt", "groundtruth.txt", "calib.txt"


def read_uzh_folder(path: Path, options: ReadOptions) -> Contents:
    """A folder, or a file of events with the others beside it.

    Args:
        path: the folder (its events in events.txt) or the file of events.
        options: what the user says.

    Raises:
        RecordingError: a file is missing, malformed or contradicts the others.
        CalibrationError: a calibration file is malformed or impossible.
    """
    events_path = path / EVENTS_FILE if path.is_dir() else path
    return _beside_text(events_path, lambda: TextEvents(events_path), options)


def read_gzip_text(path: Path, options: ReadOptions) -> Contents:
    """As `read_uzh_folder`, of a file of events packed with gzip."""
    return _beside_text(path, lambda: TextEvents(path, GzipFile(path)), options)


def _beside_text(events_path: Path, decode: Callable[[], EventSource], options: ReadOptions) -> Contents:
    folder = events_path.parent
    rig = find_rig(folder, options.calibration, options.imu)
    usual = events_path.name.removesuffix(".gz") == EVENTS_FILE
    name = folder.resolve().name if usual else Path(events_path.name.removesuffix(".gz")).stem
    contents = uzh_contents(name, decode, rig, lambda file: folder / file)
    if options.samples is None and not (folder / SAMPLES_FILE).is_file():
        contents = replace(contents, samples=samples_beside(folder, options))
    return contents


def uzh_contents(
    name: str, decode: Callable[[], EventSource], rig: Rig, file: Callable[[str], TextFile], variant: str = ""
) -> Contents:
    """What is in the files beside the events, wherever they are.

    Args:
        name: of the recording.
        decode: makes a decoder of its events.
        rig: what Kalibr's files say.
        file: gives a file by its name.
        variant: tells apart recordings in one archive.

    Raises:
        RecordingError: a file is malformed.
    """
    truth, truth_notes = _read_truth(file(TRUTH_FILE))
    lens = file(LENS_FILE)
    return Contents(
        name=name,
        decode=decode,
        size=None,
        rig=rig,
        samples=_read_samples(file(SAMPLES_FILE)),
        lens=(lambda width, height: read_lens(lens, width, height)) if lens.is_file() else None,
        truth=truth,
        variant=variant,
        notes=truth_notes,
    )


def read_lens(path: TextFile, width: int, height: int) -> CameraIntrinsics:
    """`calib.txt`, which does not tell the sensor's size. Raises CalibrationError where it is no lens."""
    tokens = read_text(path).split()
    try:
        values = [float(token) for token in tokens]
    except ValueError:
        values = []
    if len(values) not in (8, 9):
        raise CalibrationError(f"{path} holds no lens; expected nine numbers: fx fy cx cy k1 k2 p1 p2 k3")
    return make_lens(values[:4], (width, height), Distortion.RADTAN, values[4:], Path(str(path)))


def _read_samples(path: TextFile) -> Samples:
    """Samples as they stand in the file; none where there is no file."""
    if not path.is_file():
        return no_samples(path.name)
    rows, bad = read_rows(path, "t[s] ax ay az gx gy gz")
    samples = np.array([(t_ns, values[3:], values[:3]) for t_ns, values in rows], dtype=SAMPLE_DTYPE)
    return split_samples(samples, path.name, bad_lines_note(path, bad))


def _read_truth(path: TextFile) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    return read_tum(path) if path.is_file() else (None, ())
