"""Shared functions of the benchmarks: data folder, parallel runs over seeds, tables."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

# Before NumPy: the processes use all cores, and small matrices do not profit from BLAS threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from rich.progress import track

from asyneio.config import Config
from asyneio.evaluation import Evaluation, evaluate, pose_trajectory, protocol_named
from asyneio.pipeline import RunResult, run_recording
from asyneio.types import EventRecording, Recording

Item = TypeVar("Item")
Result = TypeVar("Result")


def data_folder() -> Path:
    """Folder of the real recordings: `ASYNEIO_DATA`, or `shared/data` beside the checkout."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("ASYNEIO_DATA", default))


def parallel(
    task: Callable[[Item], Result], items: Sequence[Item], label: str, jobs: int = 2
) -> list[Result]:
    """`task` over `items` in processes, with a progress bar; results in the order of the items."""
    with ProcessPoolExecutor(jobs) as pool:
        return list(track(pool.map(task, items), description=label, total=len(items)))


def run(recording: Recording | EventRecording, config: Config) -> RunResult:
    """A run that must be complete.

    Raises:
        RuntimeError: the run failed; a benchmark must not average over the remaining ones.
    """
    result = run_recording(recording, config)
    if result.summary.failure:
        raise RuntimeError(f"{recording.name}: {result.summary.failure}")
    return result


def score(recording: Recording, result: RunResult, protocol: str = "posyaw") -> Evaluation:
    """Causal estimates of a run against the recording's ground truth."""
    if recording.ground_truth is None:
        raise RuntimeError(f"{recording.name} has no ground truth")
    return evaluate(pose_trajectory(result.run.estimates), recording.ground_truth, protocol_named(protocol))


#: Header of the cells of `accuracy_cells`.
ACCURACY_HEADER = ["ATE cm", "orientation deg", "MPE %", "scale %", "start s", "x real time"]


def accuracy_cells(recording: Recording, config: Config) -> list[str]:
    """Accuracy under `posyaw` and speed of one complete run.

    Raises:
        RuntimeError: the run is incomplete.
    """
    result = run(recording, config)
    e, s = score(recording, result), result.summary
    return [
        f"{100 * e.position_m.rmse:.3f}",
        f"{e.orientation_deg.rmse:.3f}",
        f"{e.mpe_percent:.3f}",
        f"{e.scale_error_percent:+.2f}",
        f"{s.first_estimate_s:.2f}",
        f"{s.real_time_factor:.2f}",
    ]


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])
