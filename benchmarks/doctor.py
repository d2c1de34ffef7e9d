"""Detection of wrong calibrations by `asyneio doctor` from events, and acceptance of correct ones.

Evidence: simulation, events and IMU of a few seconds each, written as HDF5 and checked as a user would. The
camera looks along the IMU's y axis, so that all mistakes are large rotations. Seeds 5 and 6 were not used to
set thresholds. Columns: result of `extrinsics` with the true calibration, and error of the rotation found;
results with the inverse, with the camera upside down, and with x and y exchanged; result of `time offset`
with a clock that is off by 40 ms, and error of the offset found with the true one. "named": the text names
the mistake.

    python benchmarks/doctor.py [--seeds 5 6] [--seconds 3] [--scenes event_fast ...] [--jobs 2]
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from asyneio.doctor import CheckResult, Report, Severity, examine
from asyneio.io import write_events_hdf5
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import Calibration, EventRecording, FloatArray
from common import parallel, table

_C_B_C = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
_OFF_NS = 40_000_000
_SCENES = (
    "event_rotation", "event_fast", "event_room", "event_slow", "event_low_light",
    "suite_boxes_6dof", "suite_poster_6dof", "suite_boxes_translation",
)  # fmt: skip


def _turned(C: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """A function that rotates the camera by C in its own axes."""

    def change(T: FloatArray) -> FloatArray:
        out = T.copy()
        out[:3, :3] = T[:3, :3] @ C
        return out

    return change


#: Changes of `T_b_c`, and words of the name of the mistake.
_MISTAKES: dict[str, tuple[Callable[[FloatArray], FloatArray], str]] = {
    "inverse": (lambda T: np.asarray(np.linalg.inv(T)), "inverse"),
    "upside down": (_turned(np.diag([-1.0, -1.0, 1.0])), "upside down"),
    "x, y exchanged": (
        _turned(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])),
        "x and y of the image exchanged",
    ),
}


def _row(task: tuple[str, int], seconds: float) -> list[str]:
    scene, seed = task
    T_b_c = np.eye(4)
    T_b_c[:3, :3], T_b_c[:3, 3] = _C_B_C, [0.02, -0.01, 0.03]
    scenario = replace(EVENT_SCENARIOS[scene], seed=seed, duration_s=seconds, T_b_c=T_b_c)
    recording = simulate_events(scenario).recording
    calibration = recording.calibration
    assert calibration is not None
    clean = _examined(recording, calibration)
    extrinsics, offset = _result(clean, "extrinsics"), _result(clean, "time offset")
    found_s = offset.values.get("found_s") if offset else None
    error_ms = math.nan if found_s is None else 1e3 * found_s - 1e-6 * calibration.timeshift_ns
    cells = [scene, str(seed), _named(extrinsics), _figure(extrinsics, "error_deg")]
    for change, word in _MISTAKES.values():
        faulty = _examined(recording, replace(calibration, T_b_c=change(T_b_c)))
        cells.append(_named(_result(faulty, "extrinsics"), word))
    late = _examined(recording, replace(calibration, timeshift_ns=calibration.timeshift_ns + _OFF_NS))
    cells += [_named(_result(late, "time offset")), "-" if math.isnan(error_ms) else f"{error_ms:+.1f}"]
    return cells


def _examined(recording: EventRecording, calibration: Calibration) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.h5"
        write_events_hdf5(replace(recording, calibration=calibration), path)
        return examine(path)


def _result(report: Report, check: str) -> CheckResult | None:
    return next((result for result in report.results if result.check == check), None)


def _named(result: CheckResult | None, word: str = "") -> str:
    """The severity, and whether the text names the mistake `word`."""
    if result is None:
        return "-"
    named = bool(word) and result.severity > Severity.NOTE and word in result.fix
    return f"{result.severity.name}{', named' if named else ''}"


def _figure(result: CheckResult | None, name: str) -> str:
    value = result.values.get(name) if result else None
    return "-" if value is None else f"{value:.1f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[5, 6])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--scenes", nargs="+", default=list(_SCENES), choices=sorted(EVENT_SCENARIOS))
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    tasks = [(scene, seed) for scene in options.scenes for seed in options.seeds]
    rows = parallel(partial(_row, seconds=options.seconds), tasks, "checking", options.jobs)
    header = ["scene", "seed", "true calibration", "deg", *_MISTAKES, "40 ms late", "ms"]
    print(table(header, rows))


if __name__ == "__main__":
    main()
