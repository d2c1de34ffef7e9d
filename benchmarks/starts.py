"""Random starts in motion: how often, how soon and how well the estimator starts, and why not.

Evidence: simulation. `tracks`, `bad_tracks`, `moving_object`, `clock`, `rotation` and `still` are simulated
tracks (start_cases.py says what is drawn); names of event scenes are tracks that the front end made of
simulated events, switched on at random instants. Every case runs the attempts of the odometry until it starts
or 4 s are over. Scale: least-squares factor between the window's displacements and the true ones, in the
first body frame.

    python benchmarks/starts.py [--conditions tracks event_fast] [--cases 200] [--first 0] [--jobs 2]
        [--results FILE] [--cache DIR] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from asyneio.config import Config
from asyneio.estimation.covariance import relative_scale_sigma
from asyneio.io.atomic import write_text
from asyneio.odometry.intake import Intake
from asyneio.odometry.settings import resolve
from asyneio.odometry.start import RETRY_NS, Start, try_start
from asyneio.packets import packets
from asyneio.types import NS_PER_S
from common import table
from start_cases import CASE_S, Case, from_events, simulated

SIMULATED = ("tracks", "bad_tracks", "moving_object", "clock", "rotation", "still")
SCENES = ("event_slow", "event_fast", "event_rotation", "event_low_light", "event_near", "event_far")
#: Conditions in which a start is a failure of judgement.
UNOBSERVABLE = ("rotation", "still")
SEQUENCE_S = 16.0
#: A start is wanted within [s]; a scale further off is a wrong start.
WITHIN_S = 3.0
WRONG_SCALE = 0.25


@dataclass(frozen=True)
class Outcome:
    """What became of one case; NaN where it did not start. Seconds are of this processor except `after_s`."""

    condition: str
    number: int
    observable: bool
    speed: float
    depth: float
    acceleration: float
    parallax_px: float
    started: bool
    after_s: float
    scale_error: float
    scale_sigma: float
    gravity_deg: float
    velocity_error: float
    reasons: tuple[str, ...]
    refusal_seconds: tuple[float, ...]
    success_seconds: float


def outcome(condition: str, number: int, case: Case, config: Config) -> Outcome:
    """Attempt after attempt, as the odometry makes them."""
    recording, interval_ns = case.recording, round(config.window.knot_interval_s * NS_PER_S)
    intake = Intake(recording.calibration.camera, config.visual.pixel_sigma)
    rates = [
        1e9 / float(np.median(np.diff(s["t_ns"]))) for s in (recording.gyroscope, recording.accelerometer)
    ]
    settings = resolve(config, recording.calibration, *rates)
    count = int((CASE_S - 0.15) * NS_PER_S) // interval_ns
    next_ns, reasons, refusals = 0, [], []
    start: Start | None = None
    seconds = float("nan")
    for packet in packets(recording, case.start_ns, interval_ns, count):
        intake.append(packet)
        if packet.t_end_ns < next_ns:
            continue
        next_ns = packet.t_end_ns + RETRY_NS
        intake.drop_until(packet.t_end_ns - round(config.initialization.max_seconds * NS_PER_S))
        began = time.process_time()
        found = try_start(intake, settings)
        seconds = time.process_time() - began
        if isinstance(found, Start):
            start = found
            break
        reasons.append(found)
        refusals.append(seconds)
    drawn = (case.observable, case.speed, case.depth, case.acceleration, case.parallax_px)
    if start is None:
        nan = float("nan")
        return Outcome(
            condition, number, *drawn, False, nan, nan, nan, nan, nan, tuple(reasons), tuple(refusals), nan
        )
    after_s = (int(start.window.t_ns[-1]) - case.start_ns) / NS_PER_S
    figures = (after_s, *errors(start, case))
    return Outcome(condition, number, *drawn, True, *figures, tuple(reasons), tuple(refusals), seconds)


def errors(start: Start, case: Case) -> tuple[float, float, float, float]:
    """Relative error of scale and its standard deviation, gravity's error [deg], relative error of
    velocity."""
    states, truth = start.window.states, case.truth.at(start.window.t_ns)
    C, r = truth.T_w_b[:, :3, :3], truth.T_w_b[:, :3, 3]
    true, found = (r - r[0]) @ C[0], (states.r - states.r[0]) @ states.C[0]
    scale = float(np.sum(true * found) / np.sum(true * true))
    down = float(np.clip(states.C[-1, 2] @ C[-1, 2], -1.0, 1.0))
    nu = np.einsum("nji,nj->ni", C, truth.velocity_w)
    miss = np.linalg.norm(states.varpi[:, 0, 3:] - nu) / np.linalg.norm(nu)
    return scale - 1.0, relative_scale_sigma(start.solution), float(np.degrees(np.arccos(down))), float(miss)


def run_case(condition: str, number: int, cache: str) -> Outcome:
    """One case by its name."""
    if condition in SIMULATED:
        case = simulated(number, condition)
    else:
        case = from_events(condition, number % 3, number, SEQUENCE_S, Path(cache))
    return outcome(condition, number, case, Config())


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Bounds of a share with 95 % confidence (Wilson's score interval)."""
    if count == 0:
        return 0.0, 1.0
    z, p = 1.96, hits / count
    middle = p + z * z / (2 * count)
    half = z * np.sqrt(p * (1 - p) / count + z * z / (4 * count * count))
    return float((middle - half) / (1 + z * z / count)), float((middle + half) / (1 + z * z / count))


HEADER = ["starts", "cases", "within 3 s", "95 %", "after s: median, 90 %", "scale %: median, 90 %, worst"]
HEADER += ["gravity deg: median, 90 %", "error / sigma", "wrong", "refusal s: median, most", "success s"]


def row(name: str, outcomes: Sequence[Outcome]) -> list[str]:
    """The figures of some cases."""
    started = [o for o in outcomes if o.started]
    soon = sum(o.after_s <= WITHIN_S for o in started)
    low, high = wilson(soon, len(outcomes))
    scale = np.abs([o.scale_error for o in started])
    wrong = sum(o.condition in UNOBSERVABLE or abs(o.scale_error) > WRONG_SCALE for o in started)
    refusals = [s for o in outcomes for s in o.refusal_seconds if s > 1e-3]
    ratio = [o.scale_error / o.scale_sigma for o in started]
    return [
        name,
        str(len(outcomes)),
        f"{100 * soon / max(len(outcomes), 1):.0f} %",
        f"{100 * low:.0f}-{100 * high:.0f}",
        _percentiles([o.after_s for o in started], (50, 90), 1),
        _percentiles(100 * scale, (50, 90, 100), 1),
        _percentiles([o.gravity_deg for o in started], (50, 90), 2),
        f"{np.sqrt(np.mean(np.square(ratio))):.1f}" if ratio else "-",
        str(wrong),
        _percentiles(refusals, (50, 100), 2),
        _percentiles([o.success_seconds for o in started], (50, 100), 2),
    ]


def _percentiles(values: Iterable[float], which: tuple[int, ...], digits: int) -> str:
    known = list(values)
    return ", ".join(f"{v:.{digits}f}" for v in np.percentile(known, which)) if known else "-"


def summary(outcomes: Sequence[Outcome]) -> str:
    """Tables by condition, by what shows scale, and of the last reason of those that did not start in
    time."""
    rows = []
    for name in dict.fromkeys(o.condition for o in outcomes):
        mine = [o for o in outcomes if o.condition == name]
        rows.append(row(name, mine))
        if name not in UNOBSERVABLE:
            rows.append(row(f"{name}, scale observable", [o for o in mine if o.observable]))
    judged = [o for o in outcomes if o.observable and o.condition not in UNOBSERVABLE]
    rows.append(row("all observable", judged))
    reasons: Counter[str] = Counter()
    for o in judged:
        if not (o.started and o.after_s <= WITHIN_S):
            reasons["".join(c for c in (o.reasons or ("",))[-1] if not c.isdigit())[:70]] += 1
    lines = [f"{count} x {reason}" for reason, count in reasons.most_common()]
    return (
        f"{table(HEADER, rows)}\n\nLast reason of observable cases that did not start in time:\n\n"
        + "\n".join(lines)
    )


def main() -> None:
    """Run what is not in the results yet, print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--conditions", nargs="+", default=SIMULATED + SCENES, choices=SIMULATED + SCENES, metavar="NAME"
    )
    parser.add_argument("--cases", type=int, default=200, help="of each condition")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--results", type=Path, help="JSON lines; cases found there are not run again")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "asyneio-sequences")
    parser.add_argument("--markdown", type=Path, help="also write the tables here")
    options = parser.parse_args()
    known: dict[tuple[str, int], Outcome] = {}
    if options.results and options.results.is_file():
        for line in options.results.read_text().splitlines():
            found = Outcome(**json.loads(line))
            known[found.condition, found.number] = found
    wanted = [(c, n) for c in options.conditions for n in range(options.first, options.first + options.cases)]
    todo = [key for key in wanted if key not in known]
    with ProcessPoolExecutor(options.jobs) as pool:
        jobs = [pool.submit(run_case, condition, number, str(options.cache)) for condition, number in todo]
        for key, job in zip(todo, jobs, strict=True):
            known[key] = job.result()
            if options.results:
                with options.results.open("a") as stream:
                    stream.write(json.dumps(asdict(known[key])) + "\n")
    text = summary([known[key] for key in wanted])
    print(text)
    if options.markdown:
        write_text(options.markdown, text + "\n")


if __name__ == "__main__":
    main()
