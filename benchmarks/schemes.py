"""The four inertial schemes at several knot intervals, on a real IMU and real feature tracks (`tumvi_calib`).

Evidence: real IMU and tracks with motion capture; each track is cut into pieces of at most 1 s with new ids.
One parameter set; only scheme and knot interval change. Speeds are for runs in parallel with
`--jobs` - 1 others.

    python benchmarks/schemes.py [--knots 0.025 0.05 0.1 0.2] [--jobs 1] [--markdown FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from asyneio.config import Config
from asyneio.estimation.problem.schemes import SCHEMES
from asyneio.io import read_tracks_folder
from asyneio.io.parsing.atomic import write_text
from common import ACCURACY_HEADER, accuracy_cells, data_folder, parallel, table

_TARGET_CM = 0.4
_HEADER = ["scheme", "knots s", *ACCURACY_HEADER]


def _row(case: tuple[str, float]) -> list[str]:
    scheme, knots_s = case
    recording = read_tracks_folder(data_folder() / "tumvi_calib", max_track_seconds=1.0)
    config = Config.model_validate({"inertial": {"scheme": scheme}, "window": {"knot_interval_s": knots_s}})
    try:
        cells = accuracy_cells(recording, config)
    except RuntimeError as error:
        cells = [str(error), *[""] * 5]
    return [scheme, f"{knots_s:g}", *cells]


def main() -> None:
    """Print the table, and the best row against the target."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--knots", type=float, nargs="+", default=[0.025, 0.05, 0.1, 0.2])
    parser.add_argument("--schemes", nargs="+", default=list(SCHEMES), choices=list(SCHEMES))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    cases = [(scheme, knots_s) for scheme in options.schemes for knots_s in options.knots]
    rows = parallel(_row, cases, "tumvi_calib", jobs=options.jobs)
    whole = [row for row in rows if row[3]]
    best = min(whole, key=lambda row: float(row[2]))
    met = "met" if float(best[2]) <= _TARGET_CM else "MISSED"
    summary = f"{met}: best ATE {best[2]} cm ({best[0]}, knots {best[1]} s), target {_TARGET_CM} cm"
    text = f"{table(_HEADER, rows)}\n\n* {summary}\n* {len(whole)} of {len(rows)} runs complete\n"
    print(text)
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
