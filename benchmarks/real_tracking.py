"""Feature tracks on real events: straightness on a slider, rotation against a gyroscope, counts and images.

Evidence: real events of a DAVIS240C (slider_depth, ecd_excerpts), a DAVIS240 with its IMU (davis240_imu) and
a DVS128 (dvs128).

    python benchmarks/real_tracking.py [--trackers gradient haste] [--pictures DIR] [--markdown FILE]

Slider: the camera moves along its x axis, so every undistorted track is a horizontal line; deviations are RMS
across it. Rotation: in-plane rotation of all tracks over 50 ms against the gyroscope about the optical axis,
whose clock is known to 10 ms only. The scene is a star of straight edges; positions along an edge are
uncertain, so weighting by the covariance matters.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import scipy.io

from asyneio.config import FrontendConfig
from asyneio.evaluation.tracks import Tracks, group_tracks
from asyneio.frontend import gyroscope_in_camera
from asyneio.geometry.camera import CameraModel
from asyneio.io import open_recording
from asyneio.io.parsing.atomic import atomic_file, write_text
from asyneio.pipeline.track import TrackRun, summarize_tracks, track_recording
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, CameraIntrinsics, EventRecording, FloatArray
from asyneio.viz.tracks import TrackScene, render_tracks
from common import data_folder, table
from track_motion import compare_rates, line_deviation, rotation_rates

SLIDER = "slider_depth"
ROTATION = "davis240_imu/IMU_rotDisk.aedat"
RECORDINGS = (
    SLIDER,
    ROTATION,
    "davis240_imu/IMU_translBoxes.aedat",
    "ecd_excerpts/shapes_rotation",
    "ecd_excerpts/dynamic_translation",
    "ecd_excerpts/boxes_translation",
    "dvs128/building.mat",
    "dvs128/stripes.mat",
)
HEADER = [
    "recording",
    "s",
    "Mev/s",
    "alive 10 %",
    "alive median",
    "alive at the end",
    "tracks",
    "life median s",
]
HEADER += ["life longest s", "speed Mev/s"]
#: Time between two observations of a track [s]: the shortest excerpts have 40 to 80 ms.
_INTERVAL_S = 0.02
_MIN_OBSERVATIONS = 4


def load(name: str) -> EventRecording:
    """A real recording by its path in the data folder."""
    path = data_folder() / name
    if path.suffix == ".mat":
        return _dvs128(path)
    recording = open_recording(path)
    if not isinstance(recording, EventRecording):
        raise RuntimeError(f"{path} contains tracks, not events")
    return recording


def undistorted(tracks: Tracks, camera: CameraIntrinsics) -> FloatArray:
    """Undistorted positions (N,2) [px]."""
    xy, _, _ = CameraModel(camera).undistort(tracks.uv)
    return xy * [camera.fx, camera.fy]


def slider_report(run: TrackRun, recording: EventRecording) -> str:
    """Deviation from the line, and ages."""
    if recording.camera is None:
        raise RuntimeError(f"{recording.name} has no calibration")
    tracks = group_tracks(run.observations)
    position = undistorted(tracks, recording.camera)
    level = line_deviation(tracks, position, fit=False, min_observations=_MIN_OBSERVATIONS)
    fitted = line_deviation(tracks, position, fit=True, min_observations=_MIN_OBSERVATIONS)
    life_s = tracks.life_s()
    followed = life_s[tracks.count > 1]
    travel = np.abs(position[tracks.last, 0] - position[tracks.first, 0])
    return "\n".join(
        (
            f"* {_met(level.rms < 0.4)}: RMS {level.rms:.3f} px across the horizontal, target 0.4 px; "
            f"{fitted.rms:.3f} px across a line fitted to each track ({level.tracks} tracks with at least "
            f"{_MIN_OBSERVATIONS} of {level.observations} observations); tracks travel "
            f"{np.percentile(travel, 90):.1f} px (90th percentile)",
            f"* {_met(float(np.median(life_s)) > 0.05)}: median age {1e3 * np.median(life_s):.0f} ms "
            f"over all {life_s.size} tracks, target 50 ms of {_duration_s(recording):.2f} s; "
            f"{1e3 * np.median(followed):.0f} ms over the {followed.size} observed more than once",
        )
    )


def rotation_report(run: TrackRun, recording: EventRecording) -> str:
    """Rotation rate against the gyroscope."""
    if recording.camera is None:
        raise RuntimeError(f"{recording.name} has no calibration")
    tracks = group_tracks(run.observations)
    position = undistorted(tracks, recording.camera)
    lines = []
    for weighted in (True, False):
        rates = rotation_rates(tracks, position, weighted)
        found = compare_rates(rates, gyroscope_in_camera(recording))
        lines.append(
            f"* {_met(found.correlation > 0.97)}, {'weighted by covariance' if weighted else 'unweighted'}: "
            f"correlation {found.correlation:.4f} over {found.intervals} intervals (median of "
            f"{np.median(rates.features):.0f} tracks), target 0.97; slope {found.slope:.3f}, RMS of the "
            f"difference {np.rad2deg(found.rms):.2f} deg/s, tracks later by {1e3 * found.lag_s:.0f} ms "
            f"(then {found.correlation_at_lag:.4f})"
        )
    return "\n".join(lines)


def row(run: TrackRun, recording: EventRecording) -> list[str]:
    """Counts, ages and speed."""
    summary = summarize_tracks(recording, run)
    life, alive = summary["life_s"], summary["alive"]
    return [
        recording.name,
        f"{summary['duration_s']:.3f}",
        f"{summary['event_rate_mev_s']:.2f}",
        f"{alive['tenth_percentile']:.0f}",
        f"{alive['median']:.0f}",
        f"{run.alive[-1]}",
        f"{summary['tracks']}",
        "-" if life["median"] is None else f"{life['median']:.3f}",
        "-" if life["longest"] is None else f"{life['longest']:.3f}",
        f"{summary['speed_mev_s']:.2f}",
    ]


def main() -> None:
    """Print the table and the comparisons of each tracker; draw images if requested."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trackers", nargs="+", default=["gradient", "haste"], choices=["gradient", "haste"])
    parser.add_argument("--pictures", type=Path, help="folder for images of the tracks")
    parser.add_argument("--markdown", type=Path, help="also write the tables here")
    options = parser.parse_args()
    parts = []
    for name in options.trackers:
        config = FrontendConfig.model_validate({"tracker": name, "min_interval_s": _INTERVAL_S})
        rows, reports = [], []
        for path in RECORDINGS:
            recording = load(path)
            run = track_recording(recording, config)
            rows.append(row(run, recording))
            if path == SLIDER:
                reports.append(f"{path}:\n\n{slider_report(run, recording)}")
            if path == ROTATION:
                reports.append(f"{path}:\n\n{rotation_report(run, recording)}")
            if options.pictures and run.observations.size:
                _draw(options.pictures / f"{recording.name}-{name}.png", run, recording)
        parts.append("\n\n".join([f"## {name}", table(HEADER, rows), *reports]))
    text = "\n\n".join(parts) + "\n"
    print(text)
    if options.markdown:
        write_text(options.markdown, text)


def _dvs128(path: Path) -> EventRecording:
    """A clip of a DVS128: rows of x, y, polarity (-1, 1), time [us]; no calibration."""
    rows = scipy.io.loadmat(path)["events"].astype(np.int64)
    rows = rows[np.argsort(rows[:, 3], kind="stable")]
    events = np.zeros(len(rows), dtype=EVENT_DTYPE)
    events["x"], events["y"], events["p"] = rows[:, 0], rows[:, 1], rows[:, 2] > 0
    events["t_ns"] = rows[:, 3] * 1000
    empty = np.empty(0, dtype=INERTIAL_DTYPE)
    return EventRecording(path.stem, events, 128, 128, empty, empty)


def _draw(path: Path, run: TrackRun, recording: EventRecording) -> None:
    scene = TrackScene(recording.events, recording.width, recording.height, run.observations)
    with atomic_file(path) as stream:
        stream.write(render_tracks(scene, f"{recording.name}, {run.tracker}"))


def _duration_s(recording: EventRecording) -> float:
    return float(recording.events["t_ns"][-1] - recording.events["t_ns"][0]) * 1e-9


def _met(met: bool) -> str:
    return "met" if met else "MISSED"


if __name__ == "__main__":
    main()
