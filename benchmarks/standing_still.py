"""Standing still for a minute: how far does the estimate wander, and does it go on afterwards?

Evidence: simulation (feature tracks and IMU with exact truth; biases walk). As with an event camera there are
no tracks while nothing moves; `--frames` keeps them, as of a camera with frames. What wanders is measured from
the knot at which rest is noticed first: net and largest displacement, net and largest turn about the vertical.
What follows the start of a rest is not drift alone: a gyroscope at rest tells its bias, and what is known of
the bias corrects the pose that was reached with it.

    python benchmarks/standing_still.py [--seeds 2] [--before 15] [--seconds 60] [--scheme gpif] [--frames]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

from asyneio.config import Config
from asyneio.simulation import SCENARIOS, Simulation, simulate
from asyneio.types import NS_PER_S, FloatArray, Recording
from common import parallel, run, table

_AFTER_S = 8.0
#: An event camera sees features move again after about a pixel of motion.
_UNSEEN_S = 0.15


def simulated(seed: int, before_s: float, rest_s: float) -> Simulation:
    """A run with a pause, with as many observations as consistency needs."""
    base = SCENARIOS["moderate"]
    return simulate(
        replace(
            base,
            duration_s=before_s + rest_s + _AFTER_S,
            pause_s=(before_s, before_s + rest_s),
            seed=seed,
            tracks=replace(base.tracks, features_alive=40, spacing_px=1.5, min_spacing_s=0.015),
            gyroscope_rate_hz=200.0,
        )
    )


def without_tracks_at_rest(recording: Recording, begin_ns: int, end_ns: int) -> Recording:
    """The recording as an event camera would have made it."""
    t_ns = recording.observations["t_ns"]
    seen = (t_ns < begin_ns) | (t_ns > end_ns + round(_UNSEEN_S * NS_PER_S))
    return replace(recording, observations=recording.observations[seen])


def one_run(seed: int, before_s: float, rest_s: float, scheme: str, frames: bool) -> list[str]:
    """A row of the table."""
    simulation = simulated(seed, before_s, rest_s)
    begin_ns, end_ns = (
        simulation.truth.start_ns + round(t * NS_PER_S) for t in (before_s, before_s + rest_s)
    )
    recording = simulation.recording
    if not frames:
        recording = without_tracks_at_rest(recording, begin_ns, end_ns)
    result = run(recording, Config.model_validate({"inertial": {"scheme": scheme}}))
    still = np.array([r.t_ns for r in result.run.reports if r.still])
    still = still[(still >= begin_ns) & (still <= end_ns)]
    moving = np.array([r.t_ns for r in result.run.reports if r.still])
    wrong = int(((moving < begin_ns) | (moving > end_ns + 2 * NS_PER_S // 10)).sum())
    T = np.array([e.T_w_b for e in result.run.estimates if still[0] <= e.t_ns <= end_ns])
    away_mm = 1e3 * np.linalg.norm(T[:, :3, 3] - T[0, :3, 3], axis=1)
    turn_deg = np.degrees(np.unwrap(np.arctan2(T[:, 1, 0], T[:, 0, 0])))
    turn_deg = np.abs(turn_deg - turn_deg[0])
    # The last fifth: what was learned at rest about the biases has had its effect.
    late = slice(len(T) * 4 // 5, None)
    late_mm = 1e3 * np.linalg.norm(T[late, :3, 3] - T[late][0, :3, 3], axis=1).max()
    return [
        str(seed),
        f"{(still[0] - begin_ns) / NS_PER_S:.2f}",
        f"{len(still)}, {wrong}",
        f"{away_mm[-1]:.2f} / {away_mm.max():.2f}",
        f"{late_mm:.2f}",
        f"{turn_deg[-1]:.3f} / {turn_deg.max():.3f}",
        f"{100 * _error_after(simulation, result.run.estimates, end_ns):.2f}",
        str(len({e.segment for e in result.run.estimates})),
    ]


def _error_after(simulation: Simulation, estimates: list, end_ns: int) -> float:  # type: ignore[type-arg]
    """Largest difference [m] between the ways gone since the rest, estimated and true, both in the body's axes
    at its end."""
    after = [e for e in estimates if e.t_ns >= end_ns]
    truth = simulation.truth.at([e.t_ns for e in after]).T_w_b
    found = np.array([e.T_w_b for e in after])
    return float(np.linalg.norm(_way(found) - _way(truth), axis=1).max())


def _way(T: FloatArray) -> FloatArray:
    return np.asarray((T[:, :3, 3] - T[0, :3, 3]) @ T[0, :3, :3])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--before", type=float, default=15.0, help="seconds of motion before")
    parser.add_argument("--seconds", type=float, default=60.0, help="of standing still")
    parser.add_argument("--scheme", default="gpif")
    parser.add_argument("--frames", action="store_true", help="tracks at rest too")
    o = parser.parse_args()
    task = partial(one_run, before_s=o.before, rest_s=o.seconds, scheme=o.scheme, frames=o.frames)
    header = [
        "seed",
        "noticed after s",
        "knots at rest, wrongly",
        "moved mm (end / largest)",
        "last fifth mm",
        "turned deg (end / largest)",
        f"error cm in {_AFTER_S:g} s after",
        "segments",
    ]
    print(table(header, parallel(task, range(o.seeds), f"rest of {o.seconds:g} s", jobs=1)))


if __name__ == "__main__":
    main()
