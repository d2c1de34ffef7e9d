# SPDX-License-Identifier: Apache-2.0
"""Is the sensor stationary? Inertial samples and the image decide together.

Inertial samples alone cannot distinguish a stationary sensor from smooth uniform motion. The image alone
cannot distinguish a static scene from a dark or empty one. Each source covers the limits of the other:

- *The tracks do not move*: stationary, if the inertial samples are quiet. - *The tracks move*: no stationary
phase begins. One that has begun continues while the samples pass a stricter
  test, because people walk through the view of a stationary sensor.
- *There are no tracks*: stationary, if the samples are quiet and zero velocity agrees with the estimate.
Before
  there is an estimate, only if the event rate is not above the rate of noise.

Quiet means: no mean over 50 ms or half a second deviates from what the sensor read before, there is no
vibration, the angular rate is within the gyroscope's bias, and the specific force has the magnitude of
gravity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from asyneio.config import InertialConfig
from asyneio.inertial.noise import InertialNoise, SensorNoise
from asyneio.inertial.stationarity import (
    BIN_NS,
    LEAST_DENSITY,
    LEAST_SCATTER,
    Stationarity,
    deviation,
    measure_stationarity,
    shakes,
)
from asyneio.odometry.raw_measurements import MEMORY_NS, RawMeasurements
from asyneio.state import B_G, NU
from asyneio.types import NS_PER_S, Calibration, Estimate, FloatArray, RecordArray

#: Duration of the inertial samples that are tested [ns]. Before there is an estimate, the first stationary
#: phase may begin after the shorter one: the initialization tests the tracks again before it relies on it.
_SPAN_NS, _SHORT_NS = MEMORY_NS, 200_000_000
#: Limits in standard deviations of the means. To begin a phase: about sixty means are compared, so that one
#: in three hundred stationary spans is rejected. To end it: a limit that noise alone never reaches, or, where
#: the tracks move as well, a limit that noise reaches once in some minutes.
_ENTER, _LEAVE, _LEAVE_WITH_TRACKS = 4.0, 6.0, 4.5
#: Duration over which the reading of a stationary sensor is averaged [s]: biases drift little in it.
_MEMORY_S = 10.0
#: Bias of a gyroscope before it is estimated [rad/s]: data sheets of consumer sensors allow 3 to 20 deg/s,
#: most units have less than 7. Where the tracks do not move, a larger bias is accepted.
_MAX_OFFSET, _MAX_OFFSET_WITH_TRACKS = 0.12, 0.35
#: Error of the gyroscope's estimated bias that is accepted whatever its covariance [rad/s].
_BIAS_SLACK = 3e-3
#: Error of the magnitude of gravity by bias and scale of an accelerometer [m/s^2]; one of two stationary
#: sensors was off by 0.77.
_MAX_EXCESS = 1.0
#: Estimated velocity that is accepted as zero whatever its covariance [m/s]; and standard deviations of it.
_SLOW, _SPEED_SIGMAS = 0.05, 5.0
#: Least number of tracks, and their least median duration [s], that show whether the image moves.
_MIN_TRACKS, _MIN_EXTENT_S = 5, 0.2
#: Limit of the median squared displacement in units of its variance per axis. The median by noise alone is
#: 1.39 (two degrees of freedom); four times this is a displacement of twice the noise.
_MOVED = 4.0 * 1.386
#: The mean over many tracks, two by noise alone, detects much less motion; no track counts for more than
#: this.
_CAP = 12.0
#: Events per second and pixel by noise in room light: two stationary sensors showed 0.44 and 0.62.
_NOISE_EVENTS_HZ = 1.0


class _Image(Enum):
    """What the image shows: tracks that do not move, tracks that move, few events, many events."""

    STATIC = 0
    MOVING = 1
    QUIET = 2
    BUSY = 3


@dataclass(frozen=True)
class StationaryPhase:
    """The sensor was stationary from `start_ns` to `end_ns`; `ended`: motion has begun since."""

    start_ns: int
    end_ns: int
    ended: bool = False


class StationaryDetector:
    """Decides for one interval after the other whether the sensor was stationary, by raw measurements.

    Attributes:
        phase: the newest stationary phase, None before the first.
    """

    def __init__(self, inertial: InertialConfig, calibration: Calibration, pixel_sigma: float) -> None:
        """`pixel_sigma` [px]: standard deviation of an observation, besides its own covariance."""
        camera = calibration.camera
        self._walks = calibration.noise.gyroscope_walk, calibration.noise.accelerometer_walk
        self._declared = calibration.noise.gyroscope_density, calibration.noise.accelerometer_density
        self._gravity = inertial.gravity
        self._pixel_sigma = pixel_sigma
        self._pixels = camera.width * camera.height
        #: Mean reading of both sensors in the present phase.
        self._reading: list[FloatArray] = []
        self._noise: tuple[SensorNoise, SensorNoise]
        self.phase: StationaryPhase | None = None

    @property
    def stationary(self) -> bool:
        """Whether the sensor was stationary in the newest interval."""
        return self.phase is not None and not self.phase.ended

    def update(
        self, raw: RawMeasurements, start_ns: int, end_ns: int, known: Estimate | None, noise: InertialNoise
    ) -> bool:
        """Whether the sensor was stationary from `start_ns` to `end_ns`; nothing later is used.

        Args:
            raw: measurements of at least the half second before `end_ns`.
            start_ns: start of the interval, not before the end of the previous one.
            end_ns: end of the interval.
            known: the newest estimate before, None before there is one.
            noise: of stationary sensors.
        """
        self._noise = noise.gyroscope, noise.accelerometer
        phase = self.phase if self.stationary else None
        begin_ns = self._begin_of_span(start_ns, end_ns, known)
        found = [measure_stationarity(s["t_ns"], s["xyz"], begin_ns, end_ns) for s in raw.inertial]
        quiet = [f for f in found if f is not None]
        # As long as the span covers the whole phase, the reading is that of the span.
        learning = phase is None or begin_ns == phase.start_ns
        if learning:
            self._reading = [f.mean for f in quiet]
        if len(quiet) == 2 and self._passes(quiet, learning, raw, (begin_ns, end_ns), known):
            if not learning:
                self._average(quiet, (end_ns - start_ns) * 1e-9)
            self.phase = StationaryPhase(begin_ns if phase is None else phase.start_ns, end_ns)
        elif self.phase is not None:
            self.phase = replace(self.phase, ended=True)
        return self.stationary

    def _average(self, quiet: list[Stationarity], seconds: float) -> None:
        """Move the reading towards the means of the newest span."""
        share = min(seconds / _MEMORY_S, 1.0)
        self._reading = [r + share * (f.mean - r) for r, f in zip(self._reading, quiet, strict=True)]

    def _passes(
        self,
        quiet: list[Stationarity],
        learning: bool,
        raw: RawMeasurements,
        span_ns: tuple[int, int],
        known: Estimate | None,
    ) -> bool:
        """Whether a phase continues or, while its reading is being learned, whether it may have begun."""
        deviates = self._deviation(quiet)
        if deviates > (_ENTER if learning else _LEAVE):
            # True most of the time; the image need not be tested.
            return False
        image = self._image(raw, *span_ns, strict=known is None)
        if self._any_vibration(quiet, image):
            return False
        if learning:
            return self._begins(quiet, image, known)
        return image is not _Image.MOVING or deviates <= _LEAVE_WITH_TRACKS

    def _begin_of_span(self, start_ns: int, end_ns: int, known: Estimate | None) -> int:
        """Begin of the span to test, not before that of a phase that continues."""
        if self.phase is not None and not self.phase.ended:
            return max(min(start_ns, end_ns - _SPAN_NS), self.phase.start_ns)
        # Shortly after a stationary phase, constant acceleration may read like another one.
        short = known is None and self.phase is None
        return min(start_ns, end_ns - (_SHORT_NS if short else _SPAN_NS))

    def _any_vibration(self, found: list[Stationarity], image: _Image) -> bool:
        """Whether there is vibration. Where the tracks do not move, vibration that has been learned is
        accepted: an engine may run in a vehicle that does not move."""
        densities = list(self._declared)
        if image is _Image.STATIC:
            densities = [n.sample_sigma / np.sqrt(n.rate_hz) for n in self._noise]
        sensors = zip(found, densities, LEAST_DENSITY, LEAST_SCATTER, strict=True)
        return any(shakes(f, max(density, least), scatter) for f, density, least, scatter in sensors)

    def _deviation(self, found: list[Stationarity]) -> float:
        """Deviation of the means from the reading, in standard deviations; the larger of both sensors."""
        densities = [n.density_of_mean(BIN_NS / NS_PER_S) for n in self._noise]
        sensors = zip(found, self._reading, densities, LEAST_DENSITY, self._walks, strict=True)
        return max(
            deviation(f, r, max(density, least), walk * np.sqrt(_MEMORY_S))
            for f, r, density, least, walk in sensors
        )

    def _begins(self, found: list[Stationarity], image: _Image, known: Estimate | None) -> bool:
        """Whether a stationary phase has begun."""
        if image is _Image.MOVING or (image is _Image.BUSY and known is None):
            return False
        omega, force = found[0].mean, found[1].mean
        if known is None:
            offset = _MAX_OFFSET_WITH_TRACKS if image is _Image.STATIC else _MAX_OFFSET
            return bool(np.abs(omega).max() < offset) and self._is_gravity(force)
        sigma = np.sqrt(known.covariance.diagonal())
        turning = np.abs(omega - known.bias_gyroscope) > _BIAS_SLACK + _ENTER * sigma[B_G : B_G + 3]
        if turning.any() or not self._is_gravity(force - known.bias_accelerometer):
            return False
        speed = float(np.linalg.norm(known.velocity_w))
        slowest = _SLOW + _SPEED_SIGMAS * float(np.linalg.norm(sigma[NU : NU + 3]))
        return image is _Image.STATIC or speed < slowest

    def _is_gravity(self, force: FloatArray) -> bool:
        return bool(abs(np.linalg.norm(force) - self._gravity) < _MAX_EXCESS)

    def _image(self, raw: RawMeasurements, start_ns: int, end_ns: int, strict: bool) -> _Image:
        """What tracks and events between two times show; `strict`: also test all tracks together."""
        moved, extent_s = self._displacements(raw.observations(start_ns, end_ns))
        if len(moved) >= _MIN_TRACKS:
            limit = 2.0 * (1.0 + _ENTER / np.sqrt(len(moved)))
            together = strict and np.mean(np.minimum(moved, _CAP)) > limit
            if together or np.median(moved) > _MOVED:
                return _Image.MOVING
            if np.median(extent_s) > _MIN_EXTENT_S:
                return _Image.STATIC
        rate_hz = raw.event_count(start_ns, end_ns) / ((end_ns - start_ns) * 1e-9 * self._pixels)
        return _Image.BUSY if rate_hz > _NOISE_EVENTS_HZ else _Image.QUIET

    def _displacements(self, o: RecordArray) -> tuple[FloatArray, FloatArray]:
        """From the first to the last observation of each track: squared displacement (T,) in units of its
        variance per axis, and duration (T,) [s]."""
        o = o[np.lexsort((o["t_ns"], o["id"]))]
        _, first, counts = np.unique(o["id"], return_index=True, return_counts=True)
        first, last = first[counts > 1], (first + counts - 1)[counts > 1]
        square = (o["u"][last] - o["u"][first]) ** 2 + (o["v"][last] - o["v"][first]) ** 2
        shared = o["covariance"].astype(np.float64)[:, [0, 2]].mean(axis=1) + self._pixel_sigma**2
        return square / (shared[first] + shared[last]), (o["t_ns"][last] - o["t_ns"][first]) * 1e-9
