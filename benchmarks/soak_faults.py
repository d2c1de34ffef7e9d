"""What happens to the sensors in a soak run: faults of a moment and errors of a whole piece, at random.

A `Piece` is one simulated sequence as its sensors deliver it: records in order of arrival. `MOMENTS` strike
in an interval of it, `LASTING_*` for the whole of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from asyneio.simulation import EventSimulation, faults
from asyneio.types import NS_PER_S, RecordArray
from nuisance_kinds import KINDS, Nuisance

MS = 1_000_000

#: Errors of the IMU and of the pixels that a piece may have from its begin to its end.
LASTING_IMU = ("held", "jitter", "lost", "vibration_low", "vibration", "mpu6150")
LASTING_PIXELS = ("dropped", "noise", "hot_pixels", "flicker")


@dataclass(frozen=True)
class Piece:
    """Events (camera clock) and inertial samples of a simulation, in order of arrival."""

    simulation: EventSimulation
    events: RecordArray
    gyroscope: RecordArray
    accelerometer: RecordArray

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sensor [px]."""
        return self.simulation.recording.width, self.simulation.recording.height

    @property
    def timeshift_ns(self) -> int:
        """From the camera's clock to that of the IMU."""
        calibration = self.simulation.recording.calibration
        assert calibration is not None
        return calibration.timeshift_ns


@dataclass(frozen=True)
class Fault:
    """A fault of an interval, in the IMU clock of the piece; `kind` is a key of `MOMENTS`."""

    kind: str
    start_ns: int
    end_ns: int

    def after(self, t_ns: int) -> Fault:
        """The fault later by a time."""
        return replace(self, start_ns=self.start_ns + t_ns, end_ns=self.end_ns + t_ns)


Change = Callable[[Piece, int, int, np.random.Generator], Piece]


@dataclass(frozen=True)
class Moment:
    """A kind of fault.

    Attributes:
        change: injects it, with its interval.
        length_s: shortest and longest.
        counted: names of the counters of which one must rise while it lasts or within a second after it
            (`soak.Counters`); `health`: the state is not TRACKING; empty if the fault is none to report.
    """

    change: Change
    length_s: tuple[float, float]
    counted: tuple[str, ...]


def _events(change: Callable[..., RecordArray], *arguments: object, random: bool = False) -> Change:
    """A function of `faults` on the events, whose clock is the camera's."""

    def changed(piece: Piece, start_ns: int, end_ns: int, rng: np.random.Generator) -> Piece:
        a, b = start_ns - piece.timeshift_ns, end_ns - piece.timeshift_ns
        rest = (*arguments, rng) if random else arguments
        return replace(piece, events=change(piece.events, a, b, *rest))

    return changed


def _sized(change: Callable[..., RecordArray], *arguments: object) -> Change:
    """The same, of a function that needs the size of the sensor."""

    def changed(piece: Piece, start_ns: int, end_ns: int, rng: np.random.Generator) -> Piece:
        return _events(change, *arguments, piece.size, random=True)(piece, start_ns, end_ns, rng)

    return changed


def _both(change: Callable[[RecordArray, int, int], RecordArray]) -> Change:
    """A function of `faults` on both inertial streams."""
    return lambda piece, start_ns, end_ns, rng: replace(
        piece,
        gyroscope=change(piece.gyroscope, start_ns, end_ns),
        accelerometer=change(piece.accelerometer, start_ns, end_ns),
    )


def _within(
    records: RecordArray, start_ns: int, end_ns: int, change: Callable[[RecordArray], RecordArray]
) -> RecordArray:
    """Records of which only those of an interval are changed."""
    a, b = np.searchsorted(records["t_ns"], [start_ns, end_ns])
    return np.concatenate([records[:a], change(records[a:b]), records[b:]])


def _repeated(piece: Piece, start_ns: int, end_ns: int, rng: np.random.Generator) -> Piece:
    def change(records: RecordArray) -> RecordArray:
        return _within(records, start_ns, end_ns, partial(faults.repeated, share=0.3, rng=rng))

    return replace(piece, gyroscope=change(piece.gyroscope), accelerometer=change(piece.accelerometer))


def _spikes(piece: Piece, start_ns: int, end_ns: int, rng: np.random.Generator) -> Piece:
    def change(records: RecordArray, magnitude: float) -> RecordArray:
        struck = partial(faults.spikes, share=0.02, magnitude=magnitude, rng=rng)
        return _within(records, start_ns, end_ns, struck)

    return replace(
        piece, gyroscope=change(piece.gyroscope, 10.0), accelerometer=change(piece.accelerometer, 80.0)
    )


def _saturated(piece: Piece, start_ns: int, end_ns: int, rng: np.random.Generator) -> Piece:
    """A gyroscope that a knock of 12 rad/s drives to the end of a range of 8 rad/s: every third sample reads
    the end."""

    def change(records: RecordArray) -> RecordArray:
        struck = records.copy()
        struck["xyz"][:, int(rng.integers(3))] += 12.0
        return faults.saturated(struck, 8.0)

    return replace(piece, gyroscope=_within(piece.gyroscope, start_ns, end_ns, change))


#: A gap of events of a tenth of a second is tolerated; one of the IMU counts from 50 ms on, 200 ms end the
#: segment.
MOMENTS: Mapping[str, Moment] = {
    "event gap": Moment(_events(faults.without), (0.25, 0.8), ("health",)),
    "lights out": Moment(_sized(faults.darkened), (0.4, 1.5), ("health",)),
    # Nothing needs to be reported of events that are processed.
    "burst": Moment(_sized(faults.with_burst, 20e6), (0.03, 0.1), ()),
    "disorder": Moment(_events(faults.disordered, 8 * MS, random=True), (0.2, 1.0), ("sorted",)),
    "late events": Moment(_events(faults.set_back, 60 * MS), (2e-4, 5e-4), ("late",)),
    "short IMU gap": Moment(_both(faults.without), (0.06, 0.15), ("health",)),
    "long IMU gap": Moment(_both(faults.without), (0.3, 0.7), ("health",)),
    "repeated stamps": Moment(_repeated, (0.2, 1.0), ("rejected",)),
    "backward stamps": Moment(_both(partial(faults.set_back, by_ns=20 * MS)), (0.004, 0.01), ("rejected",)),
    "spikes": Moment(_spikes, (0.3, 1.0), ("rejected",)),
    "saturation": Moment(_saturated, (0.02, 0.08), ("rejected", "health")),
}


def disturbed(
    base: EventSimulation, from_ns: int, pixels: Nuisance | None, moments: list[Fault], seed: int
) -> tuple[Piece, list[Fault]]:
    """A simulation, whose IMU has its lasting errors already, from a time on (IMU clock), with the rest.

    Also returns those of the `moments` that changed a record: a slow scene may have no event within the
    fraction of a millisecond of a fault.
    """
    recording = base.recording
    events = np.asarray(recording.events)
    if pixels is not None and pixels.events is not None:
        events = pixels.events(events, base.scenario)
    piece = Piece(base, events, recording.gyroscope, recording.accelerometer)
    piece = replace(
        piece,
        events=events[events["t_ns"] >= from_ns - piece.timeshift_ns],
        gyroscope=piece.gyroscope[piece.gyroscope["t_ns"] >= from_ns],
        accelerometer=piece.accelerometer[piece.accelerometer["t_ns"] >= from_ns],
    )
    # Those that change the order of arrival come last: the others search in ascending stamps.
    last = ("disorder", "late events", "backward stamps")
    struck = []
    for number, fault in enumerate(sorted(moments, key=lambda f: f.kind in last)):
        rng = np.random.default_rng([seed, number])
        changed = MOMENTS[fault.kind].change(piece, fault.start_ns, fault.end_ns, rng)
        if _differ(piece, changed):
            struck.append(fault)
        piece = changed
    return piece, sorted(struck, key=lambda fault: fault.start_ns)


def _differ(one: Piece, other: Piece) -> bool:
    pairs = (
        (one.events, other.events),
        (one.gyroscope, other.gyroscope),
        (one.accelerometer, other.accelerometer),
    )
    return not all(np.array_equal(a, b) for a, b in pairs)


def draw_moments(rng: np.random.Generator, slots_s: tuple[float, ...], kinds: list[str]) -> list[Fault]:
    """One fault of the given kinds at each of the times `slots_s` after the start (zero), jittered."""
    drawn = []
    for slot_s, kind in zip(slots_s, kinds, strict=True):
        begin_ns = round((slot_s + rng.uniform(0.0, 0.5)) * NS_PER_S)
        length_ns = round(rng.uniform(*MOMENTS[kind].length_s) * NS_PER_S)
        drawn.append(Fault(kind, begin_ns, begin_ns + length_ns))
    return drawn


def draw_lasting(rng: np.random.Generator) -> tuple[Nuisance | None, Nuisance | None]:
    """Errors of the IMU and of the pixels for a piece; each is absent in a third of the draws."""
    imu = str(rng.choice(LASTING_IMU)) if rng.random() < 2 / 3 else None
    pixels = str(rng.choice(LASTING_PIXELS)) if rng.random() < 2 / 3 else None
    return (KINDS[imu] if imu else None), (KINDS[pixels] if pixels else None)
