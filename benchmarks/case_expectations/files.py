"""Truth, trajectories, exports of the IMU, bags and calibrations: kinds F, G, H, I, J and K."""

from __future__ import annotations

from case_expectations.step import Expectations, Step

CASES: Expectations = {
    "Z06": (
        Step("asyneio track data -o out", files=("out/*",)),
        Step("asyneio doctor data", status=(0,), says=(r"groundtruth\.txt",)),
    ),
}
