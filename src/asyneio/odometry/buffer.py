"""Measurements on their way into the window: undistorted once at the door, cut by time."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.geometry.camera import CameraModel
from asyneio.inertial.gating import SampleGate, SensorLimits
from asyneio.odometry.neighbourhood import Neighbourhood
from asyneio.types import (
    INERTIAL_DTYPE,
    CameraIntrinsics,
    FloatArray,
    ImuNoise,
    IntArray,
    Packet,
    RecordArray,
)

#: Inertial samples before an interval that settle what happens at its start.
_EARLIER = 4
#: Full-scale ranges below these no sensor for this use has: rad/s (half the smallest on the market), m/s^2
#: (what gravity and a gentle hand make).
_LEAST_RANGES = (1.0, 12.0)
#: Refused tracks are remembered up to so many: far more than a tracker holds at a time.
_REFUSED = 10_000


class MeasurementBuffer:
    """Keeps what the window has not taken yet, and the last inertial samples before it.

    `invalid` counts the observations outside the lens model so far; `gated` the inertial samples of the last
    packet that were refused, and `saturated` tells whether some of those were at the end of the range.
    """

    def __init__(self, camera: CameraIntrinsics, pixel_sigma: float, noise: ImuNoise | None = None) -> None:
        """`noise` is that of the IMU; without it, inertial samples pass as they come."""
        self._camera = CameraModel(camera)
        self._pixel_sigma = pixel_sigma
        self.gyroscope: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self.accelerometer: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self.observations = TrackObservations.none()
        self.end_ns: int | None = None
        self.invalid = 0
        self.gated = 0
        self.saturated = False
        self._noise = noise
        self._gates = (SampleGate(), SampleGate())
        self._refused: IntArray = np.empty(0, dtype=np.int64)
        self._neighbourhood = Neighbourhood()

    def append(
        self, packet: Packet, rates_hz: tuple[float, float] | None = None
    ) -> tuple[RecordArray, RecordArray]:
        """Take over a packet; observations outside the lens model's valid set are counted and dropped.

        `rates_hz`: of the gyroscope and the accelerometer; without them, those of the packet's samples.

        Returns:
            The inertial samples of the packet that are believed: gyroscope, accelerometer.
        """
        gyroscope, accelerometer = self._gate(packet, rates_hz)
        self.gyroscope = np.concatenate([self.gyroscope, gyroscope])
        self.accelerometer = np.concatenate([self.accelerometer, accelerometer])
        self.end_ns = packet.t_end_ns
        raw = packet.observations
        xy, d_xy_d_uv, valid = self._camera.undistort(np.column_stack([raw["u"], raw["v"]]))
        self._neighbourhood.see(raw["t_ns"][valid], raw["id"][valid], xy[valid])
        wanted = ~np.isin(raw["id"], self._refused)
        self.invalid += int(np.count_nonzero(wanted & ~valid))
        valid &= wanted
        new = TrackObservations(
            raw["t_ns"][valid],
            raw["id"][valid],
            xy[valid],
            self._root_information(d_xy_d_uv[valid], raw["covariance"][valid]),
        )
        self.observations = self.observations.joined(new)
        return gyroscope, accelerometer

    def _gate(self, packet: Packet, rates_hz: tuple[float, float] | None) -> tuple[RecordArray, RecordArray]:
        """The inertial samples of a packet without spikes, saturated and corrupt ones, which are counted."""
        streams = packet.gyroscope, packet.accelerometer
        if self._noise is None:
            return streams
        if rates_hz is None:
            rates_hz = rate_hz(streams[0]), rate_hz(streams[1])
        before = [(gate.refused, gate.saturated) for gate in self._gates]
        densities = self._noise.gyroscope_density, self._noise.accelerometer_density
        first, second = (
            gate.passed(samples, SensorLimits(density * np.sqrt(rate), least))
            for gate, samples, density, rate, least in zip(
                self._gates, streams, densities, rates_hz, _LEAST_RANGES, strict=True
            )
        )
        self.gated = sum(g.refused - b[0] for g, b in zip(self._gates, before, strict=True))
        self.saturated = any(g.saturated > b[1] for g, b in zip(self._gates, before, strict=True))
        return first, second

    def refuse(self, ids: IntArray) -> None:
        """Drop what is held of some tracks, which contradict the motion, and take nothing more of them."""
        self._neighbourhood.condemn(ids)
        self._drop(ids)

    def refuse_doubtful(self, among: IntArray, t_ns: int) -> IntArray:
        """Refuse also those of some tracks that are too short at `t_ns` to be judged and lie among condemned
        ones; their ids."""
        ids = self._neighbourhood.doubtful(among, t_ns)
        self._drop(ids)
        return ids

    def refused_share(self, ids: IntArray) -> float:
        """What share of the tracks with these ids (N,), each given any number of times, is refused."""
        different = np.unique(ids)
        return float(np.mean(np.isin(different, self._refused))) if len(different) else 0.0

    def _drop(self, ids: IntArray) -> None:
        if len(ids) == 0:
            return
        self._refused = np.concatenate([self._refused, ids])[-_REFUSED:]
        self.observations = self.observations.chosen(~np.isin(self.observations.track, ids))

    def _root_information(self, d_xy_d_uv: FloatArray, covariance_uv: FloatArray) -> FloatArray:
        """(N,2,2): whitens normalised coordinates with the pixel noise they come from.

        The front end's covariance (N,3), where it gives one, is added to the noise that all observations
        share.
        """
        uu, uv, vv = covariance_uv.astype(np.float64).T
        # Cholesky factor [[a, 0], [b, c]] of the noise; L^{-1} J^{-1} written out, for there are many.
        a = np.sqrt(uu + self._pixel_sigma**2)
        b = uv / a
        c = np.sqrt(vv + self._pixel_sigma**2 - b * b)
        J = d_xy_d_uv
        det = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        out = np.empty_like(J)
        for k, (u, v) in enumerate(((J[:, 1, 1], -J[:, 1, 0]), (-J[:, 0, 1], J[:, 0, 0]))):
            out[:, 0, k] = u / (det * a)
            out[:, 1, k] = (v / det - b * out[:, 0, k]) / c
        return out

    def drop_until(self, t_ns: int) -> None:
        """Forget what the window has taken; a few earlier inertial samples stay for the next interval."""
        self._neighbourhood.forget(t_ns)
        self.gyroscope = _tail(self.gyroscope, t_ns)
        self.accelerometer = _tail(self.accelerometer, t_ns)
        n = int(np.searchsorted(self.observations.t_ns, t_ns, side="right"))
        self.observations = self.observations.chosen(slice(n, None))


def rate_hz(samples: RecordArray) -> float:
    """Median rate of a stream; 1 Hz where there are fewer than two samples."""
    if len(samples) < 2:
        return 1.0
    return 1e9 / float(max(np.median(np.diff(samples["t_ns"])), 1.0))


def around(samples: RecordArray, start_ns: int, end_ns: int) -> RecordArray:
    """Samples with start < t <= end, and a few earlier ones."""
    return _tail(until(samples, end_ns), start_ns)


def until(samples: RecordArray, end_ns: int) -> RecordArray:
    """Samples with t <= end."""
    return samples[: np.searchsorted(samples["t_ns"], end_ns, side="right")]


def _tail(samples: RecordArray, t_ns: int) -> RecordArray:
    n = int(np.searchsorted(samples["t_ns"], t_ns, side="right"))
    return samples[max(n - _EARLIER, 0) :]
