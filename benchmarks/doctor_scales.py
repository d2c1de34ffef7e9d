"""Separation of a wrong focal length and a wrong gyroscope scale by `asyneio doctor`.

The given recordings are checked unchanged, with the calibrated focal length off by 5 and 10 %, and with the
gyroscope scaled. Columns: results of `image scale` and `imu scale`, the gyroscope's scale from the image and
from gravity, and true over calibrated focal length, each with its standard deviation if observable.

    python benchmarks/doctor_scales.py RECORDING ... [--focal 1 1.05 0.9] [--gyroscope 1 1.1 2]
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

from asyneio.doctor import Report, examine
from asyneio.io import open_recording, write_events_hdf5, write_tracks_folder
from asyneio.types import EventRecording, Recording
from common import table


def _changed(recording: Recording | EventRecording, focal: float, gyroscope: float, folder: Path) -> Path:
    """Path of a copy of the recording with scaled focal length and gyroscope readings."""
    calibration = recording.calibration
    assert calibration is not None
    camera = replace(calibration.camera, fx=focal * calibration.camera.fx, fy=focal * calibration.camera.fy)
    readings = recording.gyroscope.copy()
    readings["xyz"] *= gyroscope
    calibration = replace(calibration, camera=camera)
    if isinstance(recording, Recording):
        write_tracks_folder(
            replace(recording, calibration=calibration, gyroscope=readings), folder / "tracks"
        )
        return folder / "tracks"
    changed = replace(recording, calibration=calibration, camera=camera, gyroscope=readings)
    write_events_hdf5(changed, folder / "recording.h5")
    return folder / "recording.h5"


def _cells(report: Report) -> list[str]:
    found = {result.check: result for result in report.results}
    image, gravity = found.get("image scale"), found.get("imu scale")
    cells = [result.severity.name if result else "-" for result in (image, gravity)]
    for result, value, sigma in (
        (image, "gyroscope_scale", "gyroscope_log_sigma"),
        (gravity, "gyroscope_scale", "log_sigma"),
        (image, "focal_factor", "focal_log_sigma"),
    ):
        values = result.values if result else {}
        observable = values.get(value) is not None
        cells.append(f"{values[value]:.3f} ({values[sigma]:.1%})" if observable else "-")
    return cells


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--focal", type=float, nargs="+", default=[1.0, 1.05, 0.95, 1.1, 0.9])
    parser.add_argument("--gyroscope", type=float, nargs="+", default=[1.0, 1.1, 2.0])
    options = parser.parse_args()
    cases = [(focal, 1.0) for focal in options.focal] + [(1.0, g) for g in options.gyroscope if g != 1.0]
    rows = []
    for path in options.recordings:
        recording = open_recording(path)
        for focal, gyroscope in cases:
            with tempfile.TemporaryDirectory() as folder:
                report = examine(_changed(recording, focal, gyroscope, Path(folder)))
            rows.append([path.stem, f"{focal:g}", f"{gyroscope:g}", *_cells(report)])
    header = ["recording", "focal", "gyroscope", "image scale", "imu scale", "from the image", "from gravity"]
    print(table([*header, "focal length"], rows))


if __name__ == "__main__":
    main()
