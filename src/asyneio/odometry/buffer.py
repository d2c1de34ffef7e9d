# SPDX-License-Identifier: Apache-2.0
"""Measurements of a segment on their way into the window: gated, undistorted once, and cut by time."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.geometry.camera import CameraModel
from asyneio.inertial.gating import SampleGate, SensorLimits
from asyneio.odometry.intervals import Interval, around, rate_hz, sample_gap_s, tail
from asyneio.odometry.neighbourhood import MEMORY_NS, rejected_by_neighbours
from asyneio.odometry.raw_measurements import MEMORY_NS as RAW_MEMORY_NS
from asyneio.odometry.raw_measurements import RawMeasurements
from asyneio.types import (
    INERTIAL_DTYPE,
    NS_PER_S,
    BoolArray,
    CameraIntrinsics,
    FloatArray,
    ImuNoise,
    IntArray,
    Packet,
    RecordArray,
)

#: No sensor for this use has a smaller full-scale range: rad/s (half the smallest on the market), m/s^2
#: (gravity and the motion of a gentle hand).
_LEAST_RANGES = (1.0, 12.0)
#: Tracks of which a share is meaningful.
_ENOUGH_TRACKS = 10
#: Ids of rejected tracks that are remembered: many more than a tracker follows at a time.
_MAX_REJECTED = 10_000


class MeasurementBuffer:
    """Measurements of one segment, of all its users, with views by time.

    Which user sees which inertial samples is deliberate. The window, the initializer and the learned noise
    get gated samples (`gyroscope`, `accelerometer`, INERTIAL_DTYPE). The stationary detector, the detection
    of jumps and the attitude filter get raw samples (`raw`): a rejected spike ends a stationary phase, is a
    jump, and turns the body. The attitude filter and the learned noise outlive a segment and keep their own
    samples.

    Attributes:
        gyroscope: gated samples that the window has not taken yet, and a few before them.
        accelerometer: the same of the accelerometer.
        raw: the newest measurements as delivered.
        end_ns: end of the newest packet; None before the first.
        invalid: number of observations outside the valid area of the camera model so far.
        rejected_samples: number of inertial samples of the newest packet that the gates rejected.
        rejected_sample_share: the same as a share of all samples of the packet.
        saturated: whether some of those were at the end of the sensor's range.
    """

    def __init__(self, camera: CameraIntrinsics, pixel_sigma: float, noise: ImuNoise | None = None) -> None:
        """`pixel_sigma` [px] of every observation; `noise` of the IMU, without it no sample is rejected."""
        self._camera = CameraModel(camera)
        self._pixel_sigma = pixel_sigma
        self.gyroscope: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self.accelerometer: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self.raw = RawMeasurements()
        self.end_ns: int | None = None
        self.invalid = 0
        self.rejected_samples = 0
        self.rejected_sample_share = 0.0
        self.saturated = False
        self._noise = noise
        self._gates = (SampleGate(), SampleGate())
        #: Observations of all tracks, also of rejected ones: neighbours are looked for among them.
        self._seen = TrackObservations.none()
        self._inlier: BoolArray = np.empty(0, dtype=np.bool_)
        self._taken_ns: int | None = None
        #: Tracks rejected for any reason, and those whose own residuals or rays contradict the motion.
        self._rejected: IntArray = np.empty(0, dtype=np.int64)
        self._outliers: IntArray = np.empty(0, dtype=np.int64)

    def append(
        self, packet: Packet, rates_hz: tuple[float, float] | None = None
    ) -> tuple[RecordArray, RecordArray]:
        """Add a packet; observations outside the valid area of the camera model are counted and dropped.

        Args:
            packet: the measurements.
            rates_hz: of the gyroscope and the accelerometer; None takes those of the packet's samples.

        Returns:
            The samples of the packet that pass the gates: gyroscope, accelerometer.
        """
        self.raw.append(packet)
        gyroscope, accelerometer = self._gate(packet, rates_hz)
        self.gyroscope = np.concatenate([self.gyroscope, gyroscope])
        self.accelerometer = np.concatenate([self.accelerometer, accelerometer])
        self.end_ns = packet.t_end_ns
        self._append_observations(packet.observations)
        return gyroscope, accelerometer

    def _append_observations(self, raw: RecordArray) -> None:
        xy, d_xy_d_uv, valid = self._camera.undistort(np.column_stack([raw["u"], raw["v"]]))
        inlier = ~np.isin(raw["id"], self._rejected)
        self.invalid += int(np.count_nonzero(inlier & ~valid))
        root_information = self._root_information(d_xy_d_uv[valid], raw["covariance"][valid])
        new = TrackObservations(raw["t_ns"][valid], raw["id"][valid], xy[valid], root_information)
        self._seen = self._seen.joined(new)
        self._inlier = np.concatenate([self._inlier, inlier[valid]])

    def _gate(self, packet: Packet, rates_hz: tuple[float, float] | None) -> tuple[RecordArray, RecordArray]:
        """The inertial samples of a packet without spikes, saturated and corrupt ones, which are counted."""
        streams = packet.gyroscope, packet.accelerometer
        if self._noise is None:
            return streams
        if rates_hz is None:
            rates_hz = rate_hz(streams[0]), rate_hz(streams[1])
        before = [(gate.rejected, gate.saturated) for gate in self._gates]
        densities = self._noise.gyroscope_density, self._noise.accelerometer_density
        first, second = (
            gate.passed(samples, SensorLimits(density * np.sqrt(rate), least))
            for gate, samples, density, rate, least in zip(
                self._gates, streams, densities, rates_hz, _LEAST_RANGES, strict=True
            )
        )
        self.rejected_samples = sum(g.rejected - b[0] for g, b in zip(self._gates, before, strict=True))
        self.rejected_sample_share = self.rejected_samples / max(len(streams[0]) + len(streams[1]), 1)
        self.saturated = any(g.saturated > b[1] for g, b in zip(self._gates, before, strict=True))
        return first, second

    @property
    def observations(self) -> TrackObservations:
        """Undistorted observations that the window has not taken yet, without those of rejected tracks."""
        taken = self._taken_count()
        return self._seen.chosen(taken + np.flatnonzero(self._inlier[taken:]))

    def _taken_count(self) -> int:
        if self._taken_ns is None:
            return 0
        return int(np.searchsorted(self._seen.t_ns, self._taken_ns, side="right"))

    def gap_s(self, start_ns: int, end_ns: int) -> float:
        """Longest time without a gated sample of one of the sensors [s], see `sample_gap_s`."""
        return sample_gap_s((self.gyroscope, self.accelerometer), start_ns, end_ns)

    def interval(self, start_ns: int, end_ns: int) -> Interval:
        """What was measured between the knots at `start_ns` and `end_ns`, nothing later."""
        return Interval(
            start_ns,
            end_ns,
            around(self.gyroscope, start_ns, end_ns),
            around(self.accelerometer, start_ns, end_ns),
            self.observations.between(start_ns, end_ns),
            self.gap_s(start_ns, end_ns),
            self.rejected_sample_share,
            self.saturated,
        )

    def reject(self, ids: IntArray) -> None:
        """Drop the observations of tracks that contradict the motion, now and in later packets."""
        if len(ids):
            self._outliers = np.union1d(self._outliers, ids)
        self._drop_tracks(ids)

    def reject_by_neighbours(self, among: IntArray, t_ns: int) -> IntArray:
        """Reject those of the tracks `among` (N,) that `rejected_by_neighbours` finds at `t_ns`; their
        ids."""
        ids = rejected_by_neighbours(self._seen, self._outliers, among, t_ns)
        self._drop_tracks(ids)
        return ids

    def rejected_share(self, start_ns: int, end_ns: int) -> float:
        """Share of the tracks observed after `start_ns`, up to `end_ns`, that are rejected."""
        return self.outlier_share(self._seen.between(start_ns, end_ns).track)

    def contradicting_share_of_new(self, start_ns: int, end_ns: int) -> float:
        """Share of the tracks observed then, which began within a second before `end_ns`, that contradict the
        motion by themselves, whatever their neighbours; 0 if there are few."""
        recent = self._seen.between(end_ns - MEMORY_NS, end_ns)
        ids, first = np.unique(recent.track, return_index=True)
        new = ids[recent.t_ns[first] > end_ns - NS_PER_S]
        seen = np.intersect1d(new, recent.between(start_ns, end_ns).track)
        return float(np.mean(np.isin(seen, self._outliers))) if len(seen) >= _ENOUGH_TRACKS else 0.0

    def outlier_share(self, ids: IntArray) -> float:
        """Share of the tracks with these ids (N,), which may repeat, that are rejected."""
        different = np.unique(ids)
        return float(np.mean(np.isin(different, self._rejected))) if len(different) else 0.0

    def _drop_tracks(self, ids: IntArray) -> None:
        if len(ids) == 0:
            return
        self._rejected = np.concatenate([self._rejected, ids])[-_MAX_REJECTED:]
        self._inlier = self._inlier & ~np.isin(self._seen.track, ids)

    def _root_information(self, d_xy_d_uv: FloatArray, covariance_uv: FloatArray) -> FloatArray:
        """(N,2,2): whitens errors of normalised coordinates that come from noise in pixels.

        The covariance of the front end (N,3), where it gives one, is added to `pixel_sigma` squared.
        """
        uu, uv, vv = covariance_uv.astype(np.float64).T
        # Cholesky factor [[a, 0], [b, c]] of the noise; L^{-1} J^{-1} is written out, for it is called often.
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
        """Drop what the window has taken; a few earlier inertial samples stay for the next interval."""
        self._taken_ns = t_ns
        self.gyroscope = tail(self.gyroscope, t_ns)
        self.accelerometer = tail(self.accelerometer, t_ns)
        self.raw.drop_before(t_ns - RAW_MEMORY_NS)
        old = slice(int(np.searchsorted(self._seen.t_ns, t_ns - MEMORY_NS)), None)
        self._seen, self._inlier = self._seen.chosen(old), self._inlier[old]
        if len(self._outliers):
            self._outliers = self._outliers[np.isin(self._outliers, self._seen.track)]
