"""A recording in, a trajectory out: files of the results, a report, and errors against ground truth.

    python examples/recording_to_trajectory.py RECORDING [OUTPUT]

Without arguments it runs a short simulation.
"""

import logging
import sys
from pathlib import Path

import asyneio


def main(path: str | None = None, output: str = "results/example") -> None:
    logging.basicConfig(level=logging.INFO)  # shows initialization, losses and notes of the library
    if path is None:
        recording = asyneio.simulate("moderate", seed=1, duration_s=5.0).recording
    else:
        recording = asyneio.open_recording(path)

    result = asyneio.run(recording, output=output)
    if result.summary.failure:
        print("incomplete:", result.summary.failure)
    print(f"{result.summary.knots} poses, {result.summary.real_time_factor:.1f} times real time")

    last = result.run.estimates[-1]
    print("last position [m]:", last.T_w_b[:3, 3].round(3))
    print("last velocity [m/s]:", last.velocity_w.round(3))

    asyneio.write_report(result, recording, Path(output) / "report.html")
    if recording.ground_truth is not None:
        errors = asyneio.evaluate(result, recording, protocol="posyaw", segment=0)
        print(f"position error (RMSE): {100 * errors.position_m.rmse:.2f} cm")


if __name__ == "__main__":
    main(*sys.argv[1:])
