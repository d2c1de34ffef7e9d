"""Real IMU and real feature tracks (`tumvi_calib`): causal accuracy, and ratio to a full-batch bound.

Evidence: real IMU and tracks with motion capture. Each track is cut into pieces of at most 1 s with new ids.

    python benchmarks/real.py [--sensitivity]

`--sensitivity` repeats the run with other settings, to show their effect.
"""

from __future__ import annotations

import argparse
from typing import Any

from asyneio.config import Config
from asyneio.io import read_tracks_folder
from batch_bound import batch_bound
from common import ACCURACY_HEADER, accuracy_cells, data_folder, parallel, table

_VARIANTS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "window 1 s": {"window": {"length_s": 1.0}},
    "window 2 s": {"window": {"length_s": 2.0}},
    "knots 0.05 s": {"window": {"knot_interval_s": 0.05}},
    "pixel sigma 0.3": {"visual": {"pixel_sigma": 0.3}},
    "pixel sigma 1.0": {"visual": {"pixel_sigma": 1.0}},
    "IMU noise x 2": {"inertial": {"noise_inflation": 2.0}},
    "IMU noise x 10": {"inertial": {"noise_inflation": 10.0}},
    "gravity 9.775": {"inertial": {"gravity": 9.775}},
    "paper's landmarks (1 dof)": {"visual": {"estimate_bearing": False}},
    "frozen linearisation": {"window": {"frozen_linearization": True}},
    "jerk, SO(3) x R^3": {"motion_prior": {"space": "so3xr3"}},
    "acceleration, SE(3)": {"motion_prior": {"kind": "wnoa"}},
    "acceleration, SO(3) x R^3": {"motion_prior": {"kind": "wnoa", "space": "so3xr3"}},
}


def _row(name: str) -> list[str]:
    recording = read_tracks_folder(data_folder() / "tumvi_calib", max_track_seconds=1.0)
    return [name, *accuracy_cells(recording, Config.model_validate(_VARIANTS[name]))]


def main() -> None:
    """Print the table and the ratio."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensitivity", action="store_true", help="also with other settings")
    sensitivity = parser.parse_args().sensitivity
    names = list(_VARIANTS) if sensitivity else ["defaults"]
    rows = parallel(_row, names, "tumvi_calib", jobs=2 if sensitivity else 1)
    print(table(["settings", *ACCURACY_HEADER], rows))
    for gravity in (9.81, 9.775):
        bound = batch_bound(data_folder() / "tumvi_calib", gravity)
        print(
            f"full batch (gtsam, same cut tracks, gravity {gravity}): ATE {bound.position_cm:.3f} cm, "
            f"{bound.orientation_deg:.3f} deg; ratio of the causal estimate: "
            f"{float(rows[0][1]) / bound.position_cm:.2f} and {float(rows[0][2]) / bound.orientation_deg:.2f}"
        )


if __name__ == "__main__":
    main()
