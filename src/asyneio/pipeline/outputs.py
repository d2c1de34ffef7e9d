# SPDX-License-Identifier: Apache-2.0
"""Writes the files of a results folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from asyneio.config import dump_config
from asyneio.io import to_trajectory, write_estimates, write_tum
from asyneio.io.parsing.atomic import write_text
from asyneio.io.results.health import write_attitudes, write_health
from asyneio.pipeline.run import RunResult

#: File names in a results folder.
TRAJECTORY = "trajectory"
ESTIMATES_FILE = "estimates.npz"
HEALTH_FILE = "health.csv"
ATTITUDE_FILE = "attitude.csv"
CONFIG_FILE = "config.yaml"
SUMMARY_FILE = "summary.json"

#: `failure` in the summary until all files are written.
_UNFINISHED = "the results were not written completely"


def write_outputs(result: RunResult, folder: Path) -> list[Path]:
    """Write a trajectory for each segment, estimates, health, attitudes, settings and summary.

    Files of an earlier run in `folder` are removed first. Without estimates there is no trajectory file.

    Each file is written completely or not at all. Until all are written, the `status` in the summary is
    `incomplete`: a run that is killed here, or a full disk, leaves a summary that says so.

    Returns:
        The files, in the order they were written.

    Raises:
        RecordingError: a file cannot be written.
    """
    trajectories = folder.glob(f"{TRAJECTORY}*.tum")
    named = (folder / name for name in (SUMMARY_FILE, ESTIMATES_FILE, HEALTH_FILE, ATTITUDE_FILE))
    for path in (*named, *trajectories):
        path.unlink(missing_ok=True)
    written: list[Path] = []
    unfinished = replace(result.summary, failure=_UNFINISHED)
    write_text(folder / SUMMARY_FILE, unfinished.to_json())
    for segment in result.run.segments():
        written.append(folder / trajectory_file(segment[0].segment))
        write_tum(written[-1], to_trajectory(segment))
    if result.run.estimates:
        written.append(folder / ESTIMATES_FILE)
        write_estimates(written[-1], result.run.estimates)
    written.append(folder / HEALTH_FILE)
    write_health(written[-1], result.run.reports)
    attitudes = [report.attitude for report in result.run.reports if report.attitude]
    if attitudes:
        written.append(folder / ATTITUDE_FILE)
        write_attitudes(written[-1], attitudes)
    write_text(folder / CONFIG_FILE, dump_config(result.config))
    write_text(folder / SUMMARY_FILE, result.summary.to_json())
    return [*written, folder / CONFIG_FILE, folder / SUMMARY_FILE]


def trajectory_file(segment: int) -> str:
    """File name of the trajectory of a segment: `trajectory.tum`, `trajectory_1.tum`, ..."""
    return f"{TRAJECTORY}_{segment}.tum" if segment else f"{TRAJECTORY}.tum"
