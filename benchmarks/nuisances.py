"""Effect of sensor errors on accuracy: sequences of the suite with one nuisance at a time, and with all of
them.

Evidence: simulation. Every sequence is first run without nuisances, with an IMU whose only errors are white
noise and a random-walk bias. Every nuisance (`nuisance_kinds.py`) is one change of that, with the default
configuration, and its factor is the ratio of mean position errors. Errors of the IMU and of the calibration
do not change the events, so the front end runs once for all of them (it uses the gyroscope only for the
camera's roll within some milliseconds); nuisances of the pixels need a new tracking run. Values are for the
longest segment, as in `accuracy.py`, with the same cached sequences.

Rows are kept in a folder, one file each, under the fingerprint of the package's code, and not run again.

    python benchmarks/nuisances.py [--scenes SCENE ...] [--only NAME ...] [--seconds S] [--cache DIR]
        [--results DIR] [--markdown FILE]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import asyneio
from accuracy import figures
from asyneio.config import Config
from asyneio.io.parsing.atomic import write_text
from asyneio.pipeline import run_recording
from asyneio.simulation import EVENT_SCENARIOS, EventSimulation, simulate_events, with_imu
from asyneio.types import RecordArray
from common import table
from nuisance_kinds import BASE_IMU, KINDS, UNDISTURBED, Nuisance
from sequences import DEFAULT_CACHE, code_of, sequence, tracked

#: One with much rotation, one with little, one with a high dynamic range.
_SCENES = ("suite_boxes_6dof", "suite_poster_translation", "suite_hdr_poster")
_RESULTS = Path(tempfile.gettempdir()) / "asyneio-nuisances"
COLUMNS = {
    "MPE %": ".3f",
    "factor": ".2f",
    "first s": ".2f",
    "segments": ".0f",
    "covered %": ".1f",
    "lost": ".0f",
    "NEES position": ".2f",
    "NEES orientation": ".2f",
}
#: Targets: no run is lost; maximum median of the factors, and maximum of each factor.
MEDIAN_FACTOR, LARGEST_FACTOR = 1.5, 3.0

Row = dict[str, float | str]


def disturbed(base: EventSimulation, nuisance: Nuisance) -> EventSimulation:
    """The sequence with a nuisance; its events are changed if the nuisance concerns the pixels."""
    scenario = with_imu(base.scenario, BASE_IMU)
    if nuisance.scenario:
        scenario = nuisance.scenario(scenario)
    events = base.recording.events
    if nuisance.events:
        events = nuisance.events(np.asarray(events), scenario)
    simulation = simulate_events(scenario, events)
    calibration = simulation.recording.calibration
    assert calibration is not None
    if nuisance.calibration:
        calibration = nuisance.calibration(calibration)
    return replace(simulation, recording=replace(simulation.recording, calibration=calibration))


def observations(
    base: EventSimulation, simulation: EventSimulation, nuisance: Nuisance, config: Config, cache: Path
) -> RecordArray:
    """Observations of the front end, in the IMU clock according to the calibration.

    Unless the events are changed, they are those of the reference run; an error of the time shift only shifts
    the timestamps.
    """
    if nuisance.events:
        # A separate cache, because the fingerprint of a sequence does not include the change of its events.
        return tracked(simulation, config, cache / "nuisances" / nuisance.name).observations
    undisturbed = disturbed(base, UNDISTURBED)
    found = tracked(undisturbed, config, cache).observations.copy()
    used, true = simulation.recording.calibration, undisturbed.recording.calibration
    assert used is not None
    assert true is not None
    found["t_ns"] += used.timeshift_ns - true.timeshift_ns
    return found


def row_of(base: EventSimulation, nuisance: Nuisance, cache: Path) -> Row:
    """Run a sequence with a nuisance; columns without a value are missing."""
    config = Config.model_validate({name: dict(values) for name, values in nuisance.config.items()})
    started = time.perf_counter()
    simulation = disturbed(base, nuisance)
    given = observations(base, simulation, nuisance, config, cache)
    result = run_recording(simulation.recording, config, observations=given)
    return {
        **figures(simulation, result),
        "failure": result.summary.failure or "",
        "seconds": time.perf_counter() - started,
    }


def kept(path: Path, base: EventSimulation, nuisance: Nuisance, cache: Path) -> Row:
    """A row from its file, or run and written there."""
    if path.is_file():
        found: Row = json.loads(path.read_text(encoding="utf-8"))
        return found
    row = row_of(base, nuisance, cache)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(row, indent=1) + "\n")
    return row


def with_factor(row: Row, undisturbed: Row) -> Row:
    """The row with its mean position error relative to the reference run; infinite without estimates."""
    own, other = row.get("MPE %"), undisturbed.get("MPE %")
    if not isinstance(other, float):
        return row
    return {**row, "factor": own / other if isinstance(own, float) else float("inf")}


def comparison(rows: dict[str, Row]) -> str:
    """Factors and losses compared with the targets."""
    factors = [float(row["factor"]) for row in rows.values() if "factor" in row]
    lost = [name for name, row in rows.items() if row.get("lost") or row["failure"]]
    if not factors:
        return "no factors: no nuisance was run, or the reference run has no estimates"
    wide = [name for name, row in rows.items() if float(row.get("factor", 0.0)) > LARGEST_FACTOR]
    return (
        f"median factor {np.median(factors):.2f} (at most {MEDIAN_FACTOR:g}), largest {max(factors):.2f} "
        f"(at most {LARGEST_FACTOR:g}; above: {', '.join(wide) or 'none'}); lost: {', '.join(lost) or 'none'}"
    )


def fingerprint() -> str:
    """Hash of the code of the package and of the nuisances."""
    digest = hashlib.sha256()
    for path in sorted(Path(asyneio.__path__[0]).rglob("*.py")):
        digest.update(code_of(path).encode())
    digest.update(code_of(Path(__file__).with_name("nuisance_kinds.py")).encode())
    return digest.hexdigest()[:10]


def _cells(row: Row) -> list[str]:
    return [f"{row[name]:{form}}" if name in row else "-" for name, form in COLUMNS.items()]


def _campaign(options: argparse.Namespace) -> tuple[list[list[str]], dict[str, Row], list[str]]:
    """Cells of the table, all rows except the reference by sequence and nuisance, and failures."""
    names = [UNDISTURBED.name, *(name for name in options.only or KINDS if name != UNDISTURBED.name)]
    folder = options.results / fingerprint()
    cells, rows, notes = [], {}, []
    for number, scene in enumerate(options.scenes):
        base = sequence(scene, 0, options.seconds, options.cache)
        undisturbed: Row = {}
        for index, name in enumerate(names):
            path = folder / f"{base.recording.name}-{base.scenario.duration_s:g}-{name}.json"
            row = kept(path, base, KINDS[name], options.cache)
            undisturbed = undisturbed or row
            row = with_factor(row, undisturbed)
            cells.append([scene, KINDS[name].title, *_cells(row)])
            if name != UNDISTURBED.name:
                rows[f"{scene} {name}"] = row
            if row["failure"]:
                notes.append(f"* {scene}, {KINDS[name].title}: {row['failure']}")
            done = number * len(names) + index + 1
            total = len(names) * len(options.scenes)
            print(f"[{done}/{total}] " + " | ".join(cells[-1]), flush=True)
    return cells, rows, notes


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the missing rows, and print the table and the comparison with the targets."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=_SCENES, choices=EVENT_SCENARIOS, metavar="SCENE")
    parser.add_argument("--only", nargs="+", choices=KINDS, metavar="NAME", help=", ".join(KINDS))
    parser.add_argument("--seconds", type=float, help="of each sequence; default: its own")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE, help="of events and observations")
    parser.add_argument("--results", type=Path, default=_RESULTS, help="of rows that were run")
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args(arguments)
    cells, rows, notes = _campaign(options)
    text = table(["sequence", "nuisance", *COLUMNS], cells)
    text = "\n".join([text, "", comparison(rows), *([""] if notes else []), *notes]) + "\n"
    print(f"\n{text}")
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
