"""Cost of the back end, as medians and as ratios to gtsam in the same run.

    python benchmarks/run.py [--repeats 30]

One 20-knot window with 100 landmarks, 3 000 observations at individual times and a 200 Hz IMU, and the
equivalent discrete problem in gtsam (see gtsam_window.py). The samples of an interval are projected to six
values per sensor in advance, as in the estimator; in gtsam they are preintegrated. For complete runs beside
gtsam's incremental smoother, see gtsam_fixed_lag.py.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from asyneio.estimation.linearization.interval import accelerometer_terms, gyroscope_terms, interval_locals
from asyneio.estimation.linearization.linear_system import linearize
from asyneio.estimation.problem.problem import Problem
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.estimation.solver.marginalization import marginalize_oldest
from asyneio.estimation.solver.optimizer import OptimizerSettings, optimize
from common import table
from gtsam_window import time_gtsam_iteration
from window_problem import make_problem


def median_seconds(
    work: Callable[[Any], object], repeats: int, prepare: Callable[[], Any] = lambda: None
) -> float:
    """Median of `work(prepare())` over `repeats`, without `prepare`, after one call that compiles."""
    work(prepare())
    seconds = []
    for _ in range(repeats):
        prepared = prepare()
        start = time.perf_counter()
        work(prepared)
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def without_observations(problem: Problem) -> Problem:
    """The same window without observations."""
    return problem._replace(visual=problem.visual._replace(start=np.zeros_like(problem.visual.start)))


def inertial_seconds(problem: Problem, repeats: int) -> float:
    """Linearisation of the inertial values of one interval, mean over the window."""
    intervals = len(problem.model.dt)
    local = np.empty((intervals, 5, 6))
    space = problem.model.motion_model.space
    interval_locals(problem.states, space, local)
    H, b = np.zeros((intervals, 48, 48)), np.zeros((intervals, 48))
    states = problem.states

    def work(_: None) -> None:
        gyroscope_terms(problem.gyroscope, states.bias, local, local, True, H, b)
        accelerometer_terms(
            problem.accelerometer, states, states, problem.model.gravity_w, space, local, local, True, H, b
        )

    return median_seconds(work, repeats) / intervals


def window_rows(dof: int, repeats: int, reference: dict[str, float]) -> list[list[str]]:
    """Rows for landmarks with `dof` degrees of freedom."""
    problem, prior = make_problem(dof)
    blind = without_observations(problem)
    one_step = OptimizerSettings(max_iterations=1, relative_decrease=1e-12, damping=1e-6)
    full = median_seconds(lambda _: linearize(problem), repeats)
    rest = median_seconds(lambda _: linearize(blind), repeats)
    schur = median_seconds(
        lambda system: eliminate_landmarks(system, problem.landmarks, problem.model),
        repeats,
        lambda: linearize(problem),
    )
    iteration = median_seconds(lambda _: optimize(problem, prior, one_step), repeats)
    marginalization = median_seconds(lambda _: marginalize_oldest(problem, prior), repeats)
    reprojection = (full - rest) / len(problem.visual.landmark)
    return [
        _row(f"reprojection, linearised ({dof} dof)", reprojection, reference["linearize_projection"]),
        _row(f"linearise window ({dof} dof)", full, None),
        _row(f"Schur complement of the landmarks ({dof} dof)", schur, None),
        _row(f"optimiser iteration ({dof} dof)", iteration, reference["lm_iteration"]),
        _row(f"marginalise oldest knot, all landmarks ({dof} dof)", marginalization, None),
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=30)
    repeats = parser.parse_args().repeats
    reference = time_gtsam_iteration(repeats)
    rows = [row for dof in (3, 1) for row in window_rows(dof, repeats, reference)]
    imu = inertial_seconds(make_problem(3)[0], repeats)
    rows.append(_row("IMU of one 50 ms interval, linearised", imu, reference["linearize_imu"]))
    print(table(["median of one", "asyneio us", "gtsam us", "ratio"], rows))
    print(
        f"gtsam fixed-lag update: batch {1e3 * reference['batch_fixed_lag_update']:.1f} ms, "
        f"incremental {1e3 * reference['incremental_fixed_lag_update']:.1f} ms"
    )


def _row(name: str, ours: float, theirs: float | None) -> list[str]:
    if theirs is None:
        return [name, f"{1e6 * ours:.2f}", "", ""]
    return [name, f"{1e6 * ours:.2f}", f"{1e6 * theirs:.2f}", f"{ours / theirs:.2f}"]


if __name__ == "__main__":
    main()
