"""The four motion models on the same simulated recordings: accuracy, consistency and cost.

    python benchmarks/motion_models.py [--seeds 3] [--seconds 8] [--densities 3 10 30]

Evidence: simulated tracks and IMU, true noise in the settings. `--densities` repeats white noise on
acceleration with other densities (the same value for both, rad/s^2/sqrt(Hz) and m/s^2/sqrt(Hz)).
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

from asyneio.config import Config, MotionPriorConfig
from asyneio.evaluation import NeesBlock, anees, nees
from asyneio.simulation import simulate
from common import parallel, run, score, table
from consistency import configuration, scenario

_PRIORS, _SPACES = ("wnoj", "wnoa"), ("se3", "so3xr3")
_MOTIONS = ("moderate", "aggressive")
_BLOCKS = (NeesBlock.ORIENTATION, NeesBlock.POSITION, NeesBlock.VELOCITY)


def one_run(seed: int, motion: str, seconds: float, prior: dict[str, Any]) -> tuple[list[float], Any]:
    """ATE [cm], orientation error [deg], real-time factor, and NEES of a seed."""
    scene = scenario(motion, "sensor", seconds, seed)
    simulation = simulate(scene)
    plain = configuration("not_frozen", scene).model_dump()
    plain["motion_prior"].update(prior)
    result = run(simulation.recording, Config.model_validate(plain))
    scored = score(simulation.recording, result)
    figures = [100 * scored.position_m.rmse, scored.orientation_deg.rmse, result.summary.real_time_factor]
    estimates = [*result.origins, *result.run.estimates]
    return figures, nees(estimates, simulation.truth.at)


def row(motion: str, prior: dict[str, Any], seeds: int, seconds: float) -> list[str]:
    """Means over the seeds."""
    label = ", ".join([motion, *map(str, prior.values())])
    task = partial(one_run, motion=motion, seconds=seconds, prior=prior)
    results = parallel(task, range(seeds), label)
    means = [sum(column) / seeds for column in zip(*(figures for figures, _ in results), strict=True)]
    consistency = [anees([r for _, r in results], block).overall for block in _BLOCKS]
    shown = MotionPriorConfig.model_validate(prior)
    density = shown.linear_jerk_density if shown.kind == "wnoj" else shown.linear_acceleration_density
    return [
        motion,
        shown.kind,
        shown.space,
        f"{density:g}",
        f"{means[0]:.2f}",
        f"{means[1]:.3f}",
        *(f"{value:.1f}" for value in consistency),
        f"{means[2]:.2f}",
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--densities", type=float, nargs="*", default=[])
    options = parser.parse_args()
    priors: list[dict[str, Any]] = [{"kind": kind, "space": space} for kind in _PRIORS for space in _SPACES]
    for density in options.densities:
        both = {"angular_acceleration_density": density, "linear_acceleration_density": density}
        priors.append({"kind": "wnoa", **both})
    rows = [row(motion, prior, options.seeds, options.seconds) for motion in _MOTIONS for prior in priors]
    header = ["motion", "prior", "space", "density", "ATE cm", "orientation deg"]
    print(table([*header, *(f"NEES {block.value} (3)" for block in _BLOCKS), "x real time"], rows))


if __name__ == "__main__":
    main()
