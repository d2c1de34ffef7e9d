"""Is the sensor at rest? The inertial samples and the image are both asked.

Inertial samples alone cannot tell rest from smooth uniform motion, the image alone cannot tell a dark or
empty scene from a still one, so each covers for the other:

- *Tracks stay where they are*: rest, if the inertial samples are quiet.
- *Tracks move*: no rest begins. One that has begun goes on while the samples are quiet by a stricter measure:
  people walk through the view of a sensor at rest.
- *No tracks*: rest, if the samples are quiet and the velocity estimated so far may be zero. Before there is
  an estimate, only where no more events come than noise makes.

Quiet means: no mean over 50 ms or half a second strays from what the sensor read before, no vibration, the
turn rate is no more than the gyroscope's bias, and the specific force is as large as gravity.
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
from asyneio.state import B_G, NU
from asyneio.types import (
    INERTIAL_DTYPE,
    NS_PER_S,
    OBSERVATION_DTYPE,
    Calibration,
    Estimate,
    FloatArray,
    Packet,
    RecordArray,
)

#: Inertial samples are judged over so long [ns]; before there is an estimate the first rest may begin after
#: the shorter time, for a start asks the tracks again before it builds on so short a rest.
_SPAN_NS, _SHORT_NS = 500_000_000, 200_000_000
#: Standard deviations of the means: some sixty are compared, so that one in three hundred spans at rest is
#: refused; a rest ends at six, which noise alone never reaches, or, where tracks move as well, at what it
#: reaches once in some minutes.
_ENTER, _LEAVE, _LEAVE_WITH_TRACKS = 4.0, 6.0, 4.5
#: The reading at rest is averaged over so long [s]: biases wander little in it.
_MEMORY_S = 10.0
#: Zero offset of a gyroscope before it is estimated [rad/s]: data sheets of consumer sensors allow 3 to 20
#: deg/s, most units have less than 7. Where tracks stand still, it is no turn.
_MAX_OFFSET, _MAX_OFFSET_WITH_TRACKS = 0.12, 0.35
#: Error of a gyroscope's bias that is left to an estimate, however sure it is of itself [rad/s].
_BIAS_SLACK = 3e-3
#: What bias and scale of an accelerometer may do to the magnitude of gravity [m/s^2]; one of two sensors
#: lying still was off by 0.77.
_MAX_EXCESS = 1.0
#: A velocity this small may be zero, however sure the estimate is of it [m/s]; and standard deviations of it.
_SLOW, _SPEED_SIGMAS = 0.05, 5.0
#: Tracks that must be seen before they tell anything; for so long [s].
_MIN_TRACKS, _MIN_EXTENT_S = 5, 0.2
#: Median of the squared displacement in units of its variance per axis: noise alone gives 1.39 (two degrees
#: of freedom); four times as much is a displacement of twice the noise.
_MOVED = 4.0 * 1.386
#: Their mean over many tracks, two by noise alone, tells much less; no track counts for more than this.
_CAP = 12.0
#: Events per second and pixel that noise makes in room light: two sensors lying still gave 0.44 and 0.62.
_NOISE_EVENTS_HZ = 1.0


class _Image(Enum):
    """What the image says."""

    STILL = 0
    MOVING = 1
    QUIET = 2
    BUSY = 3


@dataclass(frozen=True)
class Rest:
    """A rest, from `since_ns` to `until_ns`; `over`: motion has begun since."""

    since_ns: int
    until_ns: int
    over: bool = False


class StationaryDetector:
    """Takes all packets; says of one stretch of time after the other whether the sensor was at rest.

    `still`: the last answer. `rest`: the newest rest, None before the first.
    """

    def __init__(self, inertial: InertialConfig, calibration: Calibration, pixel_sigma: float) -> None:
        camera = calibration.camera
        self._walks = calibration.noise.gyroscope_walk, calibration.noise.accelerometer_walk
        self._declared = calibration.noise.gyroscope_density, calibration.noise.accelerometer_density
        self._gravity = inertial.gravity
        self._pixel_sigma = pixel_sigma
        self._pixels = camera.width * camera.height
        self._streams = [np.empty(0, dtype=INERTIAL_DTYPE) for _ in range(2)]
        self._observations = np.empty(0, dtype=OBSERVATION_DTYPE)
        #: Ends of packets and events in them, -1 where they are not counted.
        self._events = np.empty((0, 2), dtype=np.int64)
        self._reading: list[FloatArray] = []
        self._noise: tuple[SensorNoise, SensorNoise]
        self.rest: Rest | None = None

    @property
    def still(self) -> bool:
        """Whether the sensor was at rest in the stretch judged last."""
        return self.rest is not None and not self.rest.over

    def append(self, packet: Packet) -> None:
        """Take over what a packet holds."""
        new = (packet.gyroscope, packet.accelerometer)
        self._streams = [np.concatenate(pair) for pair in zip(self._streams, new, strict=True)]
        self._observations = np.concatenate([self._observations, packet.observations])
        count = -1 if packet.events is None else packet.events
        self._events = np.vstack([self._events, [packet.t_end_ns, count]])

    def judge(self, start_ns: int, end_ns: int, known: Estimate | None, noise: InertialNoise) -> bool:
        """Whether the sensor was at rest from `start_ns` to `end_ns`, by what was measured until then.

        `known`: the newest estimate before, None where there is none; `noise`: of sensors that do not move.
        Stretches must come in order.
        """
        self._noise = noise.gyroscope, noise.accelerometer
        since_ns = self.rest.since_ns if self.rest is not None and self.still else None
        begin_ns = self._begin_of_span(start_ns, end_ns, since_ns, known)
        found = [measure_stationarity(s["t_ns"], s["xyz"], begin_ns, end_ns) for s in self._streams]
        quiet = [f for f in found if f is not None]
        # As long as the whole rest is judged, its reading is only being learned.
        learning = since_ns is None or begin_ns == since_ns
        if learning:
            self._reading = [f.mean for f in quiet]
        goes_on = len(quiet) == 2 and self._goes_on(quiet, learning, (begin_ns, end_ns), known)
        if goes_on and not learning:
            share = min((end_ns - start_ns) * 1e-9 / _MEMORY_S, 1.0)
            self._reading = [r + share * (f.mean - r) for r, f in zip(self._reading, quiet, strict=True)]
        if goes_on:
            self.rest = Rest(begin_ns if since_ns is None else since_ns, end_ns)
        elif self.rest is not None:
            self.rest = replace(self.rest, over=True)
        self._forget(end_ns - _SPAN_NS)
        return self.still

    def _goes_on(
        self, quiet: list[Stationarity], learning: bool, span_ns: tuple[int, int], known: Estimate | None
    ) -> bool:
        """Whether a rest goes on, or, while its reading is being learned, whether it may have begun."""
        strays = self._strays(quiet)
        if strays > (_ENTER if learning else _LEAVE):
            # Most of the time; nobody need look at the image then.
            return False
        image = self._image(*span_ns, strict=known is None)
        if self._any_shakes(quiet, image):
            return False
        if learning:
            return self._begins(quiet, image, known)
        return image is not _Image.MOVING or strays <= _LEAVE_WITH_TRACKS

    def _begin_of_span(self, start_ns: int, end_ns: int, since_ns: int | None, known: Estimate | None) -> int:
        """Begin of the span to judge, which is not before that of a rest that goes on."""
        if since_ns is not None:
            return max(min(start_ns, end_ns - _SPAN_NS), since_ns)
        # Just after a rest an even push may read like another one.
        short = known is None and self.rest is None
        return min(start_ns, end_ns - (_SHORT_NS if short else _SPAN_NS))

    def _any_shakes(self, found: list[Stationarity], image: _Image) -> bool:
        """Whether there is vibration; where the tracks stand still, more than has been learned to be usual:
        an engine may run on a vehicle that does not move."""
        densities = list(self._declared)
        if image is _Image.STILL:
            densities = [n.sample_sigma / np.sqrt(n.rate_hz) for n in self._noise]
        sensors = zip(found, densities, LEAST_DENSITY, LEAST_SCATTER, strict=True)
        return any(shakes(f, max(density, least), scatter) for f, density, least, scatter in sensors)

    def _strays(self, found: list[Stationarity]) -> float:
        """How far the means are from the reading, in standard deviations; the larger of both sensors."""
        densities = [n.density_of_mean(BIN_NS / NS_PER_S) for n in self._noise]
        sensors = zip(found, self._reading, densities, LEAST_DENSITY, self._walks, strict=True)
        return max(
            deviation(f, r, max(density, least), walk * np.sqrt(_MEMORY_S))
            for f, r, density, least, walk in sensors
        )

    def _begins(self, found: list[Stationarity], image: _Image, known: Estimate | None) -> bool:
        """Whether a rest has begun."""
        if image is _Image.MOVING or (image is _Image.BUSY and known is None):
            return False
        turn, force = found[0].mean, found[1].mean
        if known is None:
            offset = _MAX_OFFSET_WITH_TRACKS if image is _Image.STILL else _MAX_OFFSET
            return bool(np.abs(turn).max() < offset) and self._is_gravity(force)
        sigma = np.sqrt(known.covariance.diagonal())
        turning = np.abs(turn - known.bias_gyroscope) > _BIAS_SLACK + _ENTER * sigma[B_G : B_G + 3]
        if turning.any() or not self._is_gravity(force - known.bias_accelerometer):
            return False
        speed = float(np.linalg.norm(known.velocity_w))
        slowest = _SLOW + _SPEED_SIGMAS * float(np.linalg.norm(sigma[NU : NU + 3]))
        return image is _Image.STILL or speed < slowest

    def _is_gravity(self, force: FloatArray) -> bool:
        return bool(abs(np.linalg.norm(force) - self._gravity) < _MAX_EXCESS)

    def _image(self, begin_ns: int, end_ns: int, strict: bool) -> _Image:
        """What tracks and events between two times say; `strict`: all tracks together may not move."""
        o = self._observations
        o = o[slice(*np.searchsorted(o["t_ns"], [begin_ns, end_ns], side="right"))]
        moved, extent_s = self._displacements(o)
        if len(moved) >= _MIN_TRACKS:
            together = strict and np.mean(np.minimum(moved, _CAP)) > 2.0 * (
                1.0 + _ENTER / np.sqrt(len(moved))
            )
            if together or np.median(moved) > _MOVED:
                return _Image.MOVING
            if np.median(extent_s) > _MIN_EXTENT_S:
                return _Image.STILL
        ends, counts = self._events[:, 0], self._events[:, 1]
        inside = (ends > begin_ns) & (ends <= end_ns) & (counts >= 0)
        rate_hz = counts[inside].sum() / ((end_ns - begin_ns) * 1e-9 * self._pixels)
        return _Image.BUSY if rate_hz > _NOISE_EVENTS_HZ else _Image.QUIET

    def _displacements(self, o: RecordArray) -> tuple[FloatArray, FloatArray]:
        """From the first to the last observation of each track: squared displacement (T,) in units of its
        variance per axis, and time (T,) [s]."""
        o = o[np.lexsort((o["t_ns"], o["id"]))]
        _, first, counts = np.unique(o["id"], return_index=True, return_counts=True)
        first, last = first[counts > 1], (first + counts - 1)[counts > 1]
        square = (o["u"][last] - o["u"][first]) ** 2 + (o["v"][last] - o["v"][first]) ** 2
        shared = o["covariance"].astype(np.float64)[:, [0, 2]].mean(axis=1) + self._pixel_sigma**2
        return square / (shared[first] + shared[last]), (o["t_ns"][last] - o["t_ns"][first]) * 1e-9

    def _forget(self, begin_ns: int) -> None:
        self._streams = [s[np.searchsorted(s["t_ns"], begin_ns) :] for s in self._streams]
        self._observations = self._observations[np.searchsorted(self._observations["t_ns"], begin_ns) :]
        self._events = self._events[self._events[:, 0] > begin_ns]
