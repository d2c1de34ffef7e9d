"""Soak: a long stream of events and inertial samples with faults drawn at random, through one front end and
one odometry.

Kind of figures: simulation. The stream is made of pieces, each a simulated sequence (`--scenes`, `--piece`
seconds) with errors of the IMU and of the pixels that last for the whole piece, and with faults of a moment
(`soak_faults.py`), everything drawn from the seed. Between two pieces the clock jumps, forward or back, and
the sensors are somewhere else. A front end rejects a clock that was set back, as documented; a new one is
made there. The odometry is one over the whole.

Checked:

* no exception;
* every fault is reported: a counter of what was sorted, dropped or rejected rises, or the state is not
  TRACKING, within a second after it; every event of a burst is processed, or dropped and counted;
* no segment continues over a jump of the clock;
* never wrong but confident: in no second of TRACKING is position, orientation or velocity off by more than
  five standard deviations (Mahalanobis distance of the three components). Position and yaw are relative to
  the first knot of the segment.

    python benchmarks/soak.py [--seed 0] [--minutes 10] [--scenes event_slow event_slow+rest ...]
        [--piece 12] [--cache DIR] [--results FILE] [--only NUMBER ...] [--leave-out NAME ...]
        [--no-imu-scale]

A scene with `+rest` is stationary for some seconds. To find a cause: `--only` plays single pieces, and
`--leave-out` plays them without some of the errors; all else is drawn as before.
"""

from __future__ import annotations

import argparse
import json
import re
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from asyneio.config import Config
from asyneio.errors import RecordingError
from asyneio.evaluation import Nees, NeesBlock, nees
from asyneio.frontend import Frontend, gyroscope_in_camera
from asyneio.io.parsing.atomic import write_text
from asyneio.io.recording.event_checks import MAX_LATE_RUN, EventChecker
from asyneio.odometry import Odometry
from asyneio.simulation import EVENT_SCENARIOS, simulate_events, with_imu
from asyneio.simulation.truth import StateTruth
from asyneio.types import (
    NS_PER_S,
    OBSERVATION_DTYPE,
    Calibration,
    Estimate,
    Health,
    IntArray,
    Packet,
    RecordArray,
    StepReport,
)
from common import table
from nuisance_kinds import BASE_IMU, Nuisance
from sequences import DEFAULT_CACHE, sequence
from soak_faults import MOMENTS, Fault, Piece, disturbed, draw_lasting, draw_moments

#: Faults of a moment begin this long after the start of a piece, and then this far apart [s].
_FIRST_FAULT_S, _FAULT_EVERY_S = 4.0, 3.0
#: A piece begins up to this late in its sequence [s]: no two starts are alike.
_LATEST_START_S = 1.5
#: Scenes with this suffix are stationary in this interval [s].
RESTING, REST_S = "+rest", (5.0, 8.0)
#: A fault must be reported by then [s].
_REPORTED_S = 1.0
#: Packets by which the events that are checked are ahead of those whose observations are given.
_AHEAD = 3
#: Squared Mahalanobis distance of five standard deviations.
WRONG = 25.0
#: Slow enough for two cores; a stationary phase, a person in the way, bright light and dark.
SCENES = (
    "event_slow",
    "suite_poster_translation",
    "event_slow+rest",
    "suite_hdr_poster",
    "suite_dynamic_translation",
)
BLOCKS = (NeesBlock.POSITION, NeesBlock.ORIENTATION, NeesBlock.VELOCITY)
#: Held events may be out of order by so much.
_HELD_NS = 10_000_000


@dataclass(frozen=True)
class Counters:
    """Running totals of what was reported; `events` that the front end processed or dropped with a count."""

    events: int
    sorted: int
    late: int
    shed: int
    rejected: int


@dataclass(frozen=True)
class Step:
    """One packet: the piece, the time in the piece's clock, and what came out."""

    piece: int
    t_ns: int
    report: StepReport
    counters: Counters


@dataclass
class Played:
    """A piece as it was played: its shift from the piece's clock to that of the stream, and what happened."""

    scene: str
    lasting: tuple[str, ...]
    faults: list[Fault]
    shift_ns: int
    steps: list[Step] = field(default_factory=list)


class Stream:
    """The front end and the odometry, driven packet by packet."""

    def __init__(self, config: Config, calibration: Calibration) -> None:
        self._config = config
        self._size = calibration.camera.width, calibration.camera.height
        self._interval_ns = round(config.window.knot_interval_s * NS_PER_S)
        self._delay_ns = round(config.frontend.max_delay_s * NS_PER_S)
        self.odometry = Odometry(config, calibration)
        self.estimates: list[Estimate] = []
        self.origins: dict[int, Estimate] = {}
        #: Pieces in whose time the estimates of a segment lie, and how many lie in a jump between two.
        self.pieces_of: dict[int, set[int]] = {}
        self.within_jumps = 0
        self.clock_resets = 0
        self.sensor_restarts = 0
        self._rejected = 0
        self._earlier = np.zeros(4, dtype=np.int64)
        self.delivered = 0
        self._new_sensor()

    def _new_sensor(self) -> None:
        """A new front end, as after a clock that was set back."""
        self._frontend = Frontend(self._config.frontend, *self._size)
        self._checker = EventChecker("soak", *self._size)

    def _counters(self) -> Counters:
        events, sorted_, late, shed = (int(n) for n in self._earlier + self._of_sensor())
        return Counters(events, sorted_, late, shed, self._rejected)

    def _of_sensor(self) -> IntArray:
        """Events processed or dropped, sorted, dropped for being late, and shed, of the present front end."""
        counts = self._frontend.statistics()
        sorted_, late = sorted_and_late(" ".join(self._checker.notes()))
        shed = counts.shed_events + counts.shed_feature_events
        return np.array([counts.events + late, sorted_, late, shed])

    def play(self, number: int, piece: Piece, played: Played) -> None:
        """Play a piece; its stamps plus `shift_ns` are those of the stream."""
        shift_ns = played.shift_ns
        ends_ns = _ends(piece, self._interval_ns)
        streams = [_arrivals(stream, ends_ns) for stream in (piece.gyroscope, piece.accelerometer)]
        batches = self._observations(piece, shift_ns, ends_ns)
        for k, observations in enumerate(batches):
            gyroscope, accelerometer = (_shifted(stream[k], shift_ns) for stream in streams)
            packet = Packet(int(ends_ns[k + 1]) + shift_ns, observations, gyroscope, accelerometer)
            estimates, report = self.odometry.process(packet)
            self._frontend.set_outlier_share(report.outlier_share)
            self._rejected += report.inertial_rejected
            if report.origin is not None:
                self.origins[report.origin.segment] = report.origin
            for estimate in estimates:
                self._place(estimate, number, shift_ns, ends_ns)
            played.steps.append(Step(number, int(ends_ns[k + 1]), report, self._counters()))

    def _place(self, estimate: Estimate, number: int, shift_ns: int, ends_ns: IntArray) -> None:
        """Note the piece of an estimate; before it learns of a jump the odometry predicts a little way into
        it, of which there is no truth."""
        t_ns = estimate.t_ns - shift_ns
        if int(ends_ns[0]) <= t_ns <= int(ends_ns[-1]):
            self.pieces_of.setdefault(estimate.segment, set()).add(number)
            self.estimates.append(estimate)
        else:
            self.within_jumps += 1

    def _observations(self, piece: Piece, shift_ns: int, ends_ns: IntArray) -> Iterator[RecordArray]:
        """Observations of each packet, in the clock of the stream (IMU)."""
        camera_ns = piece.timeshift_ns
        gyroscope = _shifted(gyroscope_in_camera(piece.simulation.recording), shift_ns)
        until_ns = ends_ns[1:] + self._delay_ns + _HELD_NS - camera_ns
        arrivals = np.searchsorted(np.maximum.accumulate(piece.events["t_ns"]), until_ns, side="right")
        waiting, begin, from_ns = np.empty(0, dtype=OBSERVATION_DTYPE), 0, int(ends_ns[0]) + shift_ns
        for k, end in enumerate(arrivals.tolist()):
            chunk = _shifted(piece.events[begin:end], shift_ns)
            begin = end
            a, b = np.searchsorted(
                gyroscope["t_ns"], shift_ns + until_ns[k] - np.array([2 * self._interval_ns, 0])
            )
            new = self._track(chunk, gyroscope[a:b])
            new["t_ns"] += camera_ns
            waiting = np.concatenate([waiting, new])
            waiting = waiting[np.argsort(waiting["t_ns"], kind="stable")]
            end_ns = int(ends_ns[k + 1]) + shift_ns
            late, due = np.searchsorted(waiting["t_ns"], [from_ns, end_ns], side="right")
            yield waiting[late:due]
            waiting, from_ns = waiting[due:], end_ns

    def _track(self, chunk: RecordArray, gyroscope: RecordArray) -> RecordArray:
        self.delivered += chunk.size
        try:
            checked = self._checker.feed(chunk)
        except RecordingError:
            # The clock was set back: documented to need a new front end.
            self.clock_resets += 1
            # Those that waited are gone; those that showed the jump were counted as late and come again.
            self.delivered += MAX_LATE_RUN + 1 - self._checker.waiting
            self._earlier += self._of_sensor()
            self._new_sensor()
            checked = self._checker.feed(chunk)
        found = [self._frontend.process(part, gyroscope) for part in checked]
        return np.concatenate([np.empty(0, dtype=OBSERVATION_DTYPE), *found])


def sorted_and_late(notes: str) -> tuple[int, int]:
    """Events that notes of an `EventChecker` count as sorted, and as dropped for being late."""
    patterns = r"sorted (\d+) late event", r"dropped (\d+) event\(s\) that were more"
    sorted_, late = (sum(map(int, re.findall(pattern, notes))) for pattern in patterns)
    return sorted_, late


def _ends(piece: Piece, interval_ns: int) -> IntArray:
    """Start of the first packet and the end of every packet, in the clock of the piece."""
    first = max(int(s["t_ns"].min()) for s in (piece.gyroscope, piece.accelerometer))
    first = max(first, int(piece.events["t_ns"].min()) + piece.timeshift_ns)
    last = min(int(s["t_ns"].max()) for s in (piece.gyroscope, piece.accelerometer))
    return first + interval_ns * np.arange((last - first) // interval_ns + 1, dtype=np.int64)


def _arrivals(stream: RecordArray, ends_ns: IntArray) -> list[RecordArray]:
    """The samples of each packet in order of arrival, whatever their stamps say."""
    cut = np.searchsorted(np.maximum.accumulate(stream["t_ns"]), ends_ns, side="right")
    return [stream[a:b] for a, b in pairwise(cut)]


def _shifted(records: RecordArray, shift_ns: int) -> RecordArray:
    moved = records.copy()
    moved["t_ns"] += shift_ns
    return moved


def _names(*lasting: Nuisance | None) -> tuple[str, ...]:
    return tuple(kind.name for kind in lasting if kind is not None)


def pieces(options: argparse.Namespace) -> Iterator[tuple[Piece, Played]]:
    """The pieces of a soak run, drawn from the seed."""
    rng = np.random.default_rng([options.seed, 18])
    count = max(1, round(60.0 * options.minutes / options.piece))
    length_s = options.piece - _LATEST_START_S
    slots_s = tuple(np.arange(_FIRST_FAULT_S, length_s - 1.5, _FAULT_EVERY_S))
    bag: list[str] = []
    clock_ns = 0
    for number in range(count):
        scene = options.scenes[number % len(options.scenes)]
        imu, pixels = draw_lasting(rng)
        kinds = []
        for _ in slots_s:
            # Every kind once before any comes again.
            bag = bag or list(rng.permutation(list(MOMENTS)))
            kinds.append(str(bag.pop()))
        start_s = float(rng.uniform(0.0, _LATEST_START_S))
        drawn = draw_moments(rng, slots_s, kinds)
        # A jump of half a minute either way, from where the piece before ended.
        jump_s = float(rng.uniform(0.3, 30.0)) * (1 if rng.random() < 0.6 else -1)
        if options.only and number not in options.only:
            continue
        imu, pixels = (
            kind if kind and kind.name not in options.leave_out else None for kind in (imu, pixels)
        )
        rest_s = REST_S if scene.endswith(RESTING) else None
        base = sequence(scene.removesuffix(RESTING), options.scene_seed, options.piece, options.cache, rest_s)
        scenario = with_imu(base.scenario, BASE_IMU)
        if imu is not None and imu.scenario is not None:
            scenario = imu.scenario(scenario)
        simulation = simulate_events(scenario, base.recording.events)
        start_ns = simulation.scenario.start_ns + round(start_s * NS_PER_S)
        moments = [fault.after(start_ns) for fault in drawn if fault.kind not in options.leave_out]
        piece, struck = disturbed(simulation, start_ns, pixels, moments, options.seed * 1000 + number)
        begin_ns = clock_ns + round(jump_s * NS_PER_S) if clock_ns else start_ns
        clock_ns = begin_ns + round(options.piece * NS_PER_S)
        yield piece, Played(scene, _names(imu, pixels), struck, begin_ns - start_ns)


@dataclass(frozen=True)
class Unreported:
    """A fault of which nothing was reported."""

    piece: int
    kind: str
    at_s: float


def unreported(number: int, played: Played) -> list[Unreported]:
    """Faults of a piece that no counter and no state reported."""
    found = []
    for fault in played.faults:
        inside = [
            k
            for k, step in enumerate(played.steps)
            if fault.start_ns < step.t_ns <= fault.end_ns + (_REPORTED_S + 0.1) * NS_PER_S
        ]
        if not inside:
            continue
        before = played.steps[max(inside[0] - _AHEAD, 0)].counters
        after = played.steps[inside[-1]].counters
        risen = {name for name, value in asdict(after).items() if value > getattr(before, name)}
        if any(played.steps[k].report.health is not Health.TRACKING for k in inside):
            risen.add("health")
        counted = set(MOMENTS[fault.kind].counted)
        if counted and not risen & counted:
            at_s = (fault.start_ns - played.steps[0].t_ns) / NS_PER_S
            found.append(Unreported(number, fault.kind, at_s))
    return found


@dataclass(frozen=True)
class Wrong:
    """A second of TRACKING in which the estimate was off by more than five standard deviations."""

    piece: int
    segment: int
    at_s: float
    block: str
    nees: float
    lasting: tuple[str, ...]
    latest_fault: str


@dataclass
class Consistency:
    """NEES of all estimates while TRACKING, and the seconds that were wrong."""

    values: dict[NeesBlock, list[float]] = field(default_factory=lambda: {block: [] for block in BLOCKS})
    seconds: int = 0
    wrong: list[Wrong] = field(default_factory=list)
    wrong_seconds: int = 0


def judge(stream: Stream, played: list[Played], simulations: list[Piece]) -> Consistency:
    """NEES of every segment that stays within a piece."""
    out = Consistency()
    health = {
        step.t_ns + one.shift_ns + (number << 62): step.report.health
        for number, one in enumerate(played)
        for step in one.steps
    }
    for segment, numbers in stream.pieces_of.items():
        if len(numbers) != 1:
            continue
        (number,) = numbers
        one = played[number]
        estimates = [e for e in stream.estimates if e.segment == segment]
        origin = stream.origins[segment]
        truth = simulations[number].simulation.truth

        def at(t_ns: IntArray, one: Played = one, truth: object = truth) -> StateTruth:
            return truth.at(t_ns - one.shift_ns)  # type: ignore[attr-defined]

        found = nees([origin, *estimates], at)
        tracking = [health.get(int(t) + (number << 62)) is Health.TRACKING for t in found.t_ns[1:].tolist()]
        _add(out, found, np.array(tracking), segment, number, one)
    return out


def _add(out: Consistency, found: Nees, tracking: np.ndarray, segment: int, number: int, one: Played) -> None:
    t_ns = found.t_ns[1:]
    piece_s = (t_ns - one.shift_ns - one.steps[0].t_ns) / NS_PER_S
    seconds = np.floor(piece_s).astype(int)
    for second in np.unique(seconds[tracking]).tolist():
        chosen = tracking & (seconds == second)
        out.seconds += 1
        bad = False
        for block in BLOCKS:
            values = found.values[block][1:][chosen]
            out.values[block].extend(values.tolist())
            if values.max() > WRONG:
                bad = True
                at = one.steps[0].t_ns + round((second + 1) * NS_PER_S)
                earlier = [f for f in one.faults if f.start_ns <= at]
                latest = earlier[-1] if earlier else None
                name = f"{latest.kind} {(at - latest.start_ns) / NS_PER_S:.1f} s before" if latest else "none"
                out.wrong.append(
                    Wrong(number, segment, float(second), block.value, float(values.max()), one.lasting, name)
                )
        out.wrong_seconds += bad


def report(options: argparse.Namespace, stream: Stream, played: list[Played], found: Consistency) -> str:
    """The tables of a run."""
    steps = [step for one in played for step in one.steps]
    states = Counter(str(step.report.health) for step in steps)
    silent = [fault for number, one in enumerate(played) for fault in unreported(number, one)]
    spanning = [segment for segment, numbers in stream.pieces_of.items() if len(numbers) > 1]
    total = steps[-1].counters
    faults = Counter(fault.kind for one in played for fault in one.faults)
    rows = [
        ["seed", str(options.seed)],
        ["stream", f"{len(steps) * 0.1:.0f} s in {len(played)} pieces"],
        ["segments", str(len(stream.pieces_of))],
        ["states", ", ".join(f"{name} {0.1 * n:.1f} s" for name, n in states.items())],
        ["faults of a moment", ", ".join(f"{name} {n}" for name, n in sorted(faults.items()))],
        ["counted", ", ".join(f"{name} {value}" for name, value in asdict(total).items())],
        ["events delivered, not accounted for", f"{stream.delivered}, {stream.delivered - total.events}"],
        ["clock set back", f"{stream.clock_resets} new front ends"],
        ["faults not reported", ", ".join(f"{f.kind} (piece {f.piece})" for f in silent) or "none"],
        ["estimates within a jump", str(stream.within_jumps)],
        ["segments over a jump", ", ".join(map(str, spanning)) or "none"],
        ["seconds of TRACKING", str(found.seconds)],
        ["of these beyond five sigma", str(found.wrong_seconds)],
    ]
    for block in BLOCKS:
        values = np.array(found.values[block])
        cells = f"{values.mean():.2f}, {np.median(values):.2f}, {values.max():.1f}" if values.size else "-"
        rows.append([f"NEES of {block.value}: mean, median, most", cells])
    text = table(["", ""], rows)
    for wrong in found.wrong:
        text += f"\n* {json.dumps(asdict(wrong))}"
    return text


def main() -> None:
    """Play the stream, print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=10.0)
    scenes = [*EVENT_SCENARIOS, *(f"{name}{RESTING}" for name in EVENT_SCENARIOS)]
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=scenes, metavar="SCENE")
    parser.add_argument("--scene-seed", type=int, default=0, help="added to the scenes' own")
    parser.add_argument("--piece", type=float, default=12.0, help="length of a piece [s]")
    parser.add_argument("--only", nargs="+", type=int, help="play these pieces alone")
    parser.add_argument("--leave-out", nargs="+", default=(), help="faults and errors to leave out, by name")
    parser.add_argument("--no-imu-scale", action="store_true", help="without calibration.estimate_imu_scale")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    parser.add_argument("--results", type=Path, help="also write the tables here")
    options = parser.parse_args()
    config = Config.model_validate({"calibration": {"estimate_imu_scale": not options.no_imu_scale}})
    stream: Stream | None = None
    played: list[Played] = []
    kept: list[Piece] = []
    text = ""
    started = time.process_time()
    for number, (piece, one) in enumerate(pieces(options)):
        calibration = piece.simulation.recording.calibration
        assert calibration is not None
        stream = stream or Stream(config, calibration)
        stream.play(number, piece, one)
        played.append(one)
        # Only the truth is needed later.
        empty = piece.events[:0]
        kept.append(replace(piece, events=empty))
        used_s = time.process_time() - started
        states = Counter(str(step.report.health) for step in one.steps)
        what = ", ".join((one.scene, *one.lasting, *(fault.kind for fault in one.faults)))
        print(f"piece {number} ({what}): {dict(states)}, {used_s:.0f} CPU s", flush=True)
        text = report(options, stream, played, judge(stream, played, kept))
        if options.results:
            # After every piece: what an interrupted run has found so far is kept.
            write_text(options.results, text + "\n")
    print(text)


if __name__ == "__main__":
    main()
