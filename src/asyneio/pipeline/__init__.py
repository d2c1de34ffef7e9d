# SPDX-License-Identifier: Apache-2.0
"""From a recording to results: front end and estimator in parallel, summary, files and report.

The only package in which files, clocks and progress meet the estimator.
"""

from asyneio.pipeline.checkpoint import CheckpointSettings
from asyneio.pipeline.compilation import COMPILING
from asyneio.pipeline.outputs import (
    ATTITUDE_FILE,
    CONFIG_FILE,
    ESTIMATES_FILE,
    HEALTH_FILE,
    SUMMARY_FILE,
    TRAJECTORY,
    trajectory_file,
    write_outputs,
)
from asyneio.pipeline.run import Estimator, RunInterrupted, RunResult, run_recording

__all__ = [
    "ATTITUDE_FILE",
    "COMPILING",
    "CONFIG_FILE",
    "ESTIMATES_FILE",
    "HEALTH_FILE",
    "SUMMARY_FILE",
    "TRAJECTORY",
    "CheckpointSettings",
    "Estimator",
    "RunInterrupted",
    "RunResult",
    "run_recording",
    "trajectory_file",
    "write_outputs",
]
