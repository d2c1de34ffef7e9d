# SPDX-License-Identifier: Apache-2.0
"""A run in rerun's viewer: events, tracks, landmarks, trajectory, IMU, biases and health over sensor time.

Needs the package rerun-sdk (extra `viz`). Of the events, an image of the last 10 ms of each packet is logged;
of the inertial samples, 100 per second.
"""

from __future__ import annotations

import importlib.util
import os
import time
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
from asyneio.viz.rerun_shapes import ellipses, near, newest_of_tracks, strips
from asyneio.viz.rerun_viewer import Viewer, start_viewer

#: The event image shows the last events of a packet, over this time [ns]; tracks are drawn for longer.
_PICTURE_NS, _TRAIL_NS = 10_000_000, 300_000_000
#: The viewer must receive a step within this time [s].
_ANSWER_S = 5.0
#: Largest rate of plotted IMU samples.
_PLOTTED_HZ = 100
#: Poses per piece of the drawn trajectory: a new pose redraws its piece only.
_PIECE_POSES = 50
_BACKGROUND, _BRIGHTER, _DARKER = 32, 255, 128
#: Drawn bounds of biases, in standard deviations.
_SIGMAS = 3.0
_COLOURS = {
    Health.INITIALIZING: (120, 120, 120),
    Health.TRACKING: (60, 170, 80),
    Health.DEGRADED: (230, 160, 30),
    Health.LOST: (210, 50, 50),
}
#: Colours of the axes x, y, z.
_AXES = ((200, 70, 60), (70, 160, 80), (60, 110, 210))
#: Values of the curve of health.
_LEVELS = {Health.LOST: 0, Health.INITIALIZING: 1, Health.DEGRADED: 2, Health.TRACKING: 3}


def available() -> bool:
    """Whether rerun is installed."""
    return importlib.util.find_spec("rerun") is not None


@dataclass(frozen=True)
class SceneStep:
    """The content of one packet. `events` EVENT_DTYPE, `observations` OBSERVATION_DTYPE, `gyroscope` and
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
        # rerun warns that a file has no footer, and of much else.
        os.environ.setdefault("RUST_LOG", "error")
        import rerun

        self._rr: Any = rerun
        self._size, self._calibration, self._file = size, calibration, file
        self._stream = rerun.RecordingStream("asyneio")
        self._stream.send_recording_name(name)
        self._trail = np.empty(0, dtype=OBSERVATION_DTYPE)
        self._path: list[FloatArray] = []
        self._segment, self._piece = -1, 0
        self._viewer: Viewer | None = None
        self._connect(show, file)
        self._log_static()

    def add(self, step: SceneStep) -> None:
        """Log one packet. Raises RuntimeError: no data can be shown or written any more."""
        self._at(step.report.t_ns)
        self._log_events(step.events)
        self._log_tracks(step.observations, step.report.t_ns)
        self._log_health(step.report, step.figures or {})
        for estimate in step.estimates:
            self._log_estimate(estimate, step.report.health)
        if step.landmarks is not None and len(step.landmarks):
            points = self._rr.Points3D(near(step.landmarks), radii=0.02, colors=(80, 140, 220))
            self._log("world/landmarks", points)
        self._log_samples("gyroscope", step.gyroscope)
        self._log_samples("accelerometer", step.accelerometer)
        self._flush()

    def close(self) -> None:
        """Send or write all waiting data. Raises RuntimeError: as `add`."""
        self._flush()
        self._stream.disconnect()

    def _flush(self) -> None:
        """Wait until the viewer has received the data: rerun's own queue has no limit."""
        started_s = time.perf_counter()
        try:
            self._stream.flush(timeout_sec=_ANSWER_S)
        except RuntimeError as error:
            waited = time.perf_counter() - started_s > 0.5 * _ANSWER_S
            if waited:
                if self._viewer is not None:
                    self._viewer.end()  # rerun would wait for it without end.
                raise RuntimeError(f"the viewer does not answer within {_ANSWER_S:.0f} s") from error
            if self._viewer is None:
                raise RuntimeError(f"{self._file} cannot be written") from error
            if self._file is None:
                raise RuntimeError("the window of the viewer was closed") from error
            # The window was closed; the file continues.

    def _connect(self, show: bool, file: Path | None) -> None:
        rr = self._rr
        sinks: list[Any] = []
        if show:
            self._viewer = start_viewer()
            sinks.append(rr.GrpcSink(self._viewer.url))
        if file is not None:
            file.unlink(missing_ok=True)
            # The footer is an index of all data, which grows in memory during the run.
            sinks.append(rr.FileSink(str(file), write_footer=False))
        self._stream.set_sinks(*sinks)
        self._stream.send_blueprint(_blueprint())

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

        self._name_curves()

    def _name_curves(self) -> None:
        """Names and colours of the curves, which do not change."""
        rr = self._rr
        for path in ("imu/gyroscope", "imu/accelerometer"):
            self._stream.log(path, rr.SeriesLines(names=list("xyz"), colors=_AXES), static=True)
        # The bias, and bounds of three sigma in a paler colour.
        pale = [tuple((c + 2 * 160) // 3 for c in colour) for colour in _AXES]
        names = [f"{axis}{bound}" for bound in ("", " - 3 sigma", " + 3 sigma") for axis in "xyz"]
        lines = rr.SeriesLines(names=names, colors=[*_AXES, *pale, *pale], widths=[2.0] * 3 + [1.0] * 6)
        for path in ("bias/gyroscope", "bias/accelerometer"):
            self._stream.log(path, lines, static=True)

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
        newest = newest_of_tracks(self._trail)
        centres = np.column_stack([newest["u"], newest["v"]])
        self._log("camera/tracks", rr.LineStrips2D(strips(self._trail), colors=(255, 210, 60), radii=0.3))
        outlines = ellipses(newest)
        self._log("camera/covariance", rr.LineStrips2D(outlines, colors=(60, 200, 255), radii=0.2))
        self._log("camera/features", rr.Points2D(centres, colors=(60, 200, 255), radii=0.6))
        self._log("counts/features", rr.Scalars(newest.size))

    def _log_health(self, report: StepReport, figures: dict[str, float]) -> None:
        rr = self._rr
        self._log("health/level", rr.Scalars(_LEVELS[report.health]))
        self._log(
            "health/log",
            rr.TextLog(f"{report.health}: {report.reason}" if report.reason else str(report.health)),
        )
        self._log("counts/landmarks", rr.Scalars(report.landmarks))
        for name, value in figures.items():
            self._log(f"latency/{name}", rr.Scalars(value))

    def _log_estimate(self, estimate: Estimate, health: Health) -> None:
        rr = self._rr
        self._at(estimate.t_ns)
        if estimate.segment != self._segment:
            self._segment, self._piece, self._path = estimate.segment, 0, []
        if len(self._path) > _PIECE_POSES:
            self._piece, self._path = self._piece + 1, self._path[-1:]
        self._path.append(estimate.T_w_b[:3, 3])
        pose = rr.Transform3D(translation=estimate.T_w_b[:3, 3], mat3x3=estimate.T_w_b[:3, :3])
        self._log("world/body", pose)
        path = rr.LineStrips3D([np.array(self._path)], colors=_COLOURS[health], radii=0.005)
        self._log(f"world/trajectory/{estimate.segment}/{self._piece}", path)
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


def _blueprint() -> Any:
    """Image and tracks on the left, the world in the middle, curves on the right."""
    import rerun.blueprint as rrb

    # Nine curves have the colours of the axes above; their legend would cover them.
    hidden = rrb.PlotLegend(visible=False)
    curves = (
        rrb.TimeSeriesView(origin="imu/gyroscope", name="gyroscope [rad/s]"),
        rrb.TimeSeriesView(origin="imu/accelerometer", name="accelerometer [m/s^2]"),
        rrb.TimeSeriesView(
            origin="bias/gyroscope", name="gyroscope bias, three sigma [rad/s]", plot_legend=hidden
        ),
        rrb.TimeSeriesView(
            origin="bias/accelerometer",
            name="accelerometer bias, three sigma [m/s^2]",
            plot_legend=hidden,
        ),
    )
    left = rrb.Vertical(
        rrb.Spatial2DView(origin="camera", name="events and tracks"),
        rrb.TimeSeriesView(origin="health/level", name="health (3: tracking, 0: lost)"),
        rrb.TimeSeriesView(origin="latency", name="latency [ms]"),
        rrb.TimeSeriesView(origin="counts", name="features and landmarks"),
        row_shares=[4, 1, 1, 1],
    )
    world = rrb.Spatial3DView(origin="world", name="trajectory and landmarks")
    whole = rrb.Horizontal(left, world, rrb.Vertical(*curves), column_shares=[3, 3, 2])
    return rrb.Blueprint(whole, collapse_panels=True)
