"""A run in rerun's viewer: events, tracks, landmarks, trajectory, IMU, biases and health over sensor time.

Needs the package rerun-sdk (extra `viz`). What is logged is thinned, so that an hour takes about 1 GB at 240 x 180 pixels.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asyneio.types import (
    NS_PER_S,
    OBSERVATION_DTYPE,
    Calibration,
    Estimate,
    FloatArray,
    Health,
    RecordArray,
    StepReport,
)

#: The viewer forgets the oldest data beyond this.
MEMORY_LIMIT = "1GB"
#: The picture of events holds those of the last so many nanoseconds of a packet; tracks are drawn for longer.
_PICTURE_NS, _TRAIL_NS = 30_000_000, 300_000_000
#: Samples of the IMU that are plotted, at most so many a second.
_PLOTTED_HZ = 100
#: Trajectory: the newest so many poses are drawn.
_MOST_POSES = 2000
_BACKGROUND, _BRIGHTER, _DARKER = 32, 255, 128
#: A covariance is drawn as an ellipse of three sigma; where it is not known, as one of this size [px].
_SIGMAS, _UNKNOWN_PX = 3.0, 1.0
_COLOURS = {
    Health.INITIALIZING: (120, 120, 120),
    Health.TRACKING: (60, 170, 80),
    Health.DEGRADED: (230, 160, 30),
    Health.LOST: (210, 50, 50),
}
#: Of the curve of health.
_LEVELS = {Health.LOST: 0, Health.INITIALIZING: 1, Health.DEGRADED: 2, Health.TRACKING: 3}


def available() -> bool:
    """Whether rerun is installed."""
    return importlib.util.find_spec("rerun") is not None


@dataclass(frozen=True)
class SceneStep:
    """What one packet adds. `events` EVENT_DTYPE, `observations` OBSERVATION_DTYPE, `gyroscope` and
    `accelerometer` INERTIAL_DTYPE, `landmarks` (N,3) [m] or None; `figures`: further curves by name."""

    report: StepReport
    estimates: tuple[Estimate, ...]
    events: RecordArray
    observations: RecordArray
    gyroscope: RecordArray
    accelerometer: RecordArray
    landmarks: FloatArray | None = None
    figures: dict[str, float] | None = None


class RerunScene:
    """Logs steps of one run.

    Args:
        name: of the run.
        size: width and height of the sensor [px].
        calibration: of the rig.
        show: open the viewer's window.
        file: also into this file (`.rrd`).

    Raises:
        RuntimeError: the viewer could not be started.
    """

    def __init__(
        self, name: str, size: tuple[int, int], calibration: Calibration, show: bool, file: Path | None
    ) -> None:
        import rerun

        self._rr: Any = rerun
        self._size, self._calibration = size, calibration
        self._stream = rerun.RecordingStream("asyneio")
        self._stream.send_recording_name(name)
        self._trail = np.empty(0, dtype=OBSERVATION_DTYPE)
        self._path: list[FloatArray] = []
        self._segment = -1
        self._connect(show, file)
        self._log_static()

    def add(self, step: SceneStep) -> None:
        """Log what a packet adds."""
        self._at(step.report.t_ns)
        self._log_events(step.events)
        self._log_tracks(step.observations, step.report.t_ns)
        self._log_health(step.report, step.figures or {})
        for estimate in step.estimates:
            self._log_estimate(estimate, step.report.health)
        if step.landmarks is not None and len(step.landmarks):
            points = self._rr.Points3D(step.landmarks, radii=0.02, colors=(80, 140, 220))
            self._log("world/landmarks", points)
        self._log_samples("gyroscope", step.gyroscope)
        self._log_samples("accelerometer", step.accelerometer)

    def close(self) -> None:
        """Write everything that is held back."""
        self._stream.flush()
        self._stream.disconnect()

    def _connect(self, show: bool, file: Path | None) -> None:
        rr = self._rr
        blueprint = _blueprint()
        if show:
            self._stream.spawn(memory_limit=MEMORY_LIMIT, hide_welcome_screen=True)
        if file is not None:
            file.unlink(missing_ok=True)
            sinks = [rr.FileSink(str(file))]
            self._stream.set_sinks(*sinks, *([rr.GrpcSink()] if show else []))
        self._stream.send_blueprint(blueprint)

    def _log_static(self) -> None:
        rr = self._rr
        width, height = self._size
        camera = self._calibration.camera
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log(
            "world/body/camera",
            rr.Transform3D(
                translation=self._calibration.T_b_c[:3, 3], mat3x3=self._calibration.T_b_c[:3, :3]
            ),
            rr.Pinhole(
                focal_length=(camera.fx, camera.fy),
                principal_point=(camera.cx, camera.cy),
                resolution=(width, height),
                image_plane_distance=0.3,
            ),
            static=True,
        )

    def _at(self, t_ns: int) -> None:
        self._stream.set_time("sensor", timestamp=np.datetime64(t_ns, "ns"))

    def _log(self, path: str, what: Any) -> None:
        self._stream.log(path, what)

    def _log_events(self, events: RecordArray) -> None:
        width, height = self._size
        if events.size:
            first = np.searchsorted(events["t_ns"], int(events["t_ns"][-1]) - _PICTURE_NS)
            events = events[first:]
        picture = np.full((height, width), _BACKGROUND, dtype=np.uint8)
        picture[events["y"], events["x"]] = np.where(events["p"] > 0, _BRIGHTER, _DARKER)
        self._log("camera/events", self._rr.Image(picture))

    def _log_tracks(self, observations: RecordArray, t_ns: int) -> None:
        rr = self._rr
        trail = np.concatenate([self._trail, observations])
        self._trail = trail[trail["t_ns"] > t_ns - _TRAIL_NS]
        newest = _newest_of_tracks(self._trail)
        centres = np.column_stack([newest["u"], newest["v"]])
        self._log("camera/tracks", rr.LineStrips2D(_strips(self._trail), colors=(255, 210, 60), radii=0.3))
        ellipses, radii = _ellipses(newest)
        self._log("camera/covariance", rr.LineStrips2D(ellipses, colors=(60, 200, 255), radii=0.2))
        self._log("camera/features", rr.Points2D(centres, colors=(60, 200, 255), radii=0.6))
        if radii.size:
            self._log("figures/track_sigma_px", rr.Scalars(float(np.median(radii))))

    def _log_health(self, report: StepReport, figures: dict[str, float]) -> None:
        rr = self._rr
        self._log("health/level", rr.Scalars(_LEVELS[report.health]))
        self._log(
            "health/log",
            rr.TextLog(f"{report.health}: {report.reason}" if report.reason else str(report.health)),
        )
        self._log("figures/landmarks", rr.Scalars(report.landmarks))
        for name, value in figures.items():
            self._log(f"figures/{name}", rr.Scalars(value))

    def _log_estimate(self, estimate: Estimate, health: Health) -> None:
        rr = self._rr
        self._at(estimate.t_ns)
        if estimate.segment != self._segment:
            self._segment, self._path = estimate.segment, []
        self._path = [*self._path[-_MOST_POSES + 1 :], estimate.T_w_b[:3, 3]]
        pose = rr.Transform3D(translation=estimate.T_w_b[:3, 3], mat3x3=estimate.T_w_b[:3, :3])
        self._log("world/body", pose)
        path = rr.LineStrips3D([np.array(self._path)], colors=_COLOURS[health], radii=0.005)
        self._log(f"world/trajectory/{estimate.segment}", path)
        for name, bias, block in (
            ("gyroscope", estimate.bias_gyroscope, slice(18, 21)),
            ("accelerometer", estimate.bias_accelerometer, slice(21, 24)),
        ):
            sigma = _SIGMAS * np.sqrt(np.diag(estimate.covariance)[block])
            bounds = np.concatenate([bias, bias - sigma, bias + sigma])
            self._log(f"bias/{name}", rr.Scalars(bounds))
        self._log("velocity", rr.Scalars(estimate.velocity_w))

    def _log_samples(self, sensor: str, samples: RecordArray) -> None:
        rr = self._rr
        if samples.size < 2:
            return
        span_s = (int(samples["t_ns"][-1]) - int(samples["t_ns"][0])) / NS_PER_S
        step = max(round(samples.size / max(span_s * _PLOTTED_HZ, 1.0)), 1)
        thinned = samples[::step]
        times = rr.TimeColumn("sensor", timestamp=thinned["t_ns"].astype("datetime64[ns]"))
        columns = rr.Scalars.columns(scalars=thinned["xyz"].reshape(-1)).partition([3] * thinned.size)
        self._stream.send_columns(f"imu/{sensor}", indexes=[times], columns=columns)


def _newest_of_tracks(observations: RecordArray) -> RecordArray:
    """The newest observation of each track."""
    order = np.lexsort((observations["t_ns"], observations["id"]))
    rows = observations[order]
    last = np.r_[rows["id"][1:] != rows["id"][:-1], True] if rows.size else np.empty(0, dtype=bool)
    return rows[last]


def _strips(observations: RecordArray) -> list[FloatArray]:
    """Positions of each track with more than one observation, (K,2) in order of time."""
    order = np.lexsort((observations["t_ns"], observations["id"]))
    rows = observations[order]
    points = np.column_stack([rows["u"], rows["v"]])
    cuts = np.flatnonzero(np.diff(rows["id"])) + 1
    return [strip for strip in np.split(points, cuts) if len(strip) > 1]


def _ellipses(observations: RecordArray) -> tuple[list[FloatArray], FloatArray]:
    """Outlines (17,2) of three sigma [px], and the larger sigma of each observation [px]."""
    turn = np.linspace(0.0, 2.0 * np.pi, 17)
    circle = np.vstack([np.cos(turn), np.sin(turn)])
    outlines, radii = [], []
    for row in observations:
        uu, uv, vv = (float(c) for c in row["covariance"])
        known = uu > 0.0 and vv > 0.0
        values, axes = np.linalg.eigh([[uu, uv], [uv, vv]])
        sigmas = np.sqrt(np.maximum(values, 0.0)) if known else np.full(2, _UNKNOWN_PX / _SIGMAS)
        outline = (axes * (_SIGMAS * sigmas)) @ circle
        outlines.append(outline.T + np.array([row["u"], row["v"]]))
        if known:
            radii.append(float(sigmas.max()))
    return outlines, np.array(radii)


def _blueprint() -> Any:
    """Image and tracks on the left, the world in the middle, curves on the right."""
    import rerun.blueprint as rrb

    curves = (
        rrb.TimeSeriesView(origin="imu/gyroscope", name="gyroscope [rad/s]"),
        rrb.TimeSeriesView(origin="imu/accelerometer", name="accelerometer [m/s^2]"),
        rrb.TimeSeriesView(origin="bias/gyroscope", name="gyroscope bias, three sigma [rad/s]"),
        rrb.TimeSeriesView(origin="bias/accelerometer", name="accelerometer bias, three sigma [m/s^2]"),
    )
    left = rrb.Vertical(
        rrb.Spatial2DView(origin="camera", name="events and tracks"),
        rrb.TimeSeriesView(origin="health/level", name="health (3: tracking, 0: lost)"),
        rrb.TimeSeriesView(origin="figures", name="latency, landmarks"),
    )
    world = rrb.Spatial3DView(origin="world", name="trajectory and landmarks")
    return rrb.Blueprint(rrb.Horizontal(left, world, rrb.Vertical(*curves), column_shares=[2, 3, 2]))
