"""Random starts in motion: how often, how soon and how well the estimator starts, and why not.

Evidence: simulation. `tracks`, `bad_tracks`, `moving_object`, `clock`, `rotation` and `still` are simulated
tracks (start_cases.py says what is drawn); names of the suite's scenes are tracks that the front end made of
simulated events, switched on at random instants. Every case runs the odometry until it starts or 4 s are
over, and for 2 s more after a start: a wrong one should be reported within a second. Scale: least-squares
factor between the window's displacements and the true ones, in the first body frame. NEES of scale: its
squared error over the variance that the estimator computes at the start (one degree of freedom: mean 1, 5 %
beyond two sigma).

    python benchmarks/starts.py [--conditions tracks suite_boxes_6dof] [--cases 200] [--first 0] [--jobs 2]
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
from asyneio.estimation.solver.covariance import relative_scale_sigma
from asyneio.io.parsing.atomic import write_text
from asyneio.odometry import Odometry
from asyneio.pipeline.packets import packets
from asyneio.simulation.events.scenario import SUITE
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.types import NS_PER_S, Health
from common import table
from start_cases import CASE_S, Case, from_events, simulated

SIMULATED = ("tracks", "bad_tracks", "moving_object", "clock", "rotation", "still")
SCENES = tuple(scenario.name for scenario in SUITE)
#: Without translation every initialization is wrong; stationary it is right, but has no scale.
ROTATION, STILL = "rotation", "still"
UNOBSERVABLE = (ROTATION, STILL)
#: A start is wanted within [s]; a scale further off is a wrong start.
WITHIN_S = 3.0
#: A start later than this is none; a start is watched for so long; a wrong one must be reported by then [s].
LATEST_S, WATCHED_S, REPORTED_WITHIN_S = 4.0, 2.0, 1.0
WRONG_SCALE = 0.25


@dataclass(frozen=True)
class Outcome:
    """What became of one case; NaN where it did not start. Seconds are of this processor except `after_s` and
    `reported_s`: time from the start to the first step that was not TRACKING, NaN without one."""

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
    path_error: float
    reported_s: float
    reasons: tuple[str, ...]
    refusal_seconds: tuple[float, ...]
    success_seconds: float


def outcome(condition: str, number: int, case: Case, config: Config) -> Outcome:
    """The odometry over a case: until it has started, and `WATCHED_S` longer."""
    recording, interval_ns = case.recording, round(config.window.knot_interval_s * NS_PER_S)
    odometry = Odometry(config, recording.calibration)
    drawn = (case.observable, case.speed, case.depth, case.acceleration, case.parallax_px)
    reasons: list[str] = []
    refusals: list[float] = []
    started: tuple[float, float, float, float, float] | None = None
    nan = float("nan")
    success_s, reported_s = nan, nan
    for packet in packets(
        recording, case.start_ns, interval_ns, int((CASE_S - 0.15) * NS_PER_S) // interval_ns
    ):
        after_s = (packet.t_end_ns - case.start_ns) / NS_PER_S
        began = time.process_time()
        estimates, report = odometry.process(packet)
        seconds = time.process_time() - began
        if started is not None:
            if report.health in (Health.DEGRADED, Health.LOST) and not reported_s >= 0.0:
                reported_s = after_s - started[0]
            if after_s > started[0] + WATCHED_S or report.health is Health.LOST:
                break
        elif estimates:
            started, success_s = (after_s, *errors(odometry, case)), seconds
        elif after_s > LATEST_S:
            break
        else:
            reasons.append(report.reason)
            refusals.append(seconds)
    figures = started or (nan, nan, nan, nan, nan)
    rest = (reported_s, tuple(reasons), tuple(refusals), success_s)
    return Outcome(condition, number, *drawn, started is not None, *figures, *rest)


def errors(odometry: Odometry, case: Case) -> tuple[float, float, float, float]:
    """Relative error of scale over the window just started and its sigma, gravity's error [deg], relative
    error of the path."""
    tracking = odometry._segment.tracking
    assert tracking is not None
    sigma = relative_scale_sigma(tracking.solution)
    trajectory = odometry.trajectory()
    assert isinstance(trajectory, GPTrajectory)
    first_ns, last_ns = int(trajectory.t_ns[0]), int(trajectory.t_ns[-1])
    t_ns = np.linspace(0, last_ns - first_ns, 50).astype(np.int64) + first_ns
    found, true = trajectory.pose(t_ns), case.truth.at(t_ns).T_w_b
    gravity = float(np.degrees(np.arccos(np.clip(found[-1, 2, :3] @ true[-1, 2, :3], -1.0, 1.0))))
    if case.speed == 0.0:
        return float("nan"), sigma, gravity, float("nan")
    displacement = [(T[:, :3, 3] - T[0, :3, 3]) @ T[0, :3, :3] for T in (true, found)]
    scale = float(np.sum(displacement[0] * displacement[1]) / np.sum(displacement[0] ** 2))
    miss = np.linalg.norm(displacement[1] - displacement[0]) / np.linalg.norm(displacement[0])
    return scale - 1.0, sigma, gravity, float(miss)


def run_case(condition: str, number: int, cache: str) -> Outcome:
    """One case by its name."""
    if condition in SIMULATED:
        case = simulated(number, condition)
    else:
        case = from_events(condition, number, Path(cache), Path(cache) / "tracks")
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
HEADER += ["scale NEES: mean, median", "beyond 2 sigma", "gravity deg: median, 90 %", "wrong"]
HEADER += ["wrong, not reported in 1 s", "rejection s: median, most", "success s"]


def row(name: str, outcomes: Sequence[Outcome]) -> list[str]:
    """The figures of some cases."""
    started = [o for o in outcomes if o.started]
    soon = sum(o.after_s <= WITHIN_S for o in started)
    low, high = wilson(soon, len(outcomes))
    scale = np.abs([o.scale_error for o in started])
    ratio = np.array([(o.scale_error / o.scale_sigma) ** 2 for o in started if np.isfinite(o.scale_error)])
    wrong = [o for o in started if o.condition == ROTATION or abs(o.scale_error) > WRONG_SCALE]
    refusals = [s for o in outcomes for s in o.refusal_seconds if s > 1e-3]
    return [
        name,
        str(len(outcomes)),
        f"{100 * soon / max(len(outcomes), 1):.0f} %",
        f"{100 * low:.0f}-{100 * high:.0f}",
        _percentiles([o.after_s for o in started], (50, 90), 1),
        _percentiles(100 * scale, (50, 90, 100), 1),
        f"{np.mean(ratio):.2f}, {np.median(ratio):.2f}" if len(ratio) else "-",
        f"{100 * np.mean(ratio > 4.0):.0f} %" if len(ratio) else "-",
        _percentiles([o.gravity_deg for o in started], (50, 90), 2),
        str(len(wrong)),
        str(sum(not o.reported_s <= REPORTED_WITHIN_S + 1e-6 for o in wrong)),
        _percentiles(refusals, (50, 100), 2),
        _percentiles([o.success_seconds for o in started], (50, 100), 2),
    ]


def _percentiles(values: Iterable[float], which: tuple[int, ...], digits: int) -> str:
    known = [v for v in values if np.isfinite(v)]
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
