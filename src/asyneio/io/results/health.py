# SPDX-License-Identifier: Apache-2.0
"""`health.csv`: health of the estimator at each step. `attitude.csv`: attitudes while there is no pose."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.io.parsing.atomic import write_text
from asyneio.io.parsing.decimal_seconds import format_seconds
from asyneio.types import Attitude, StepReport

HEALTH_COLUMNS = ("t[s]", "health", "segment", "reason")
ATTITUDE_COLUMNS = ("t[s]", "qx", "qy", "qz", "qw", "tilt_sigma[deg]")


def write_health(path: Path, reports: Iterable[StepReport]) -> None:
    """Write health, segment and reason of every step, complete or not at all.

    Raises:
        RecordingError: the file cannot be written.
    """
    rows = ((format_seconds(r.t_ns), str(r.health), str(r.segment), r.reason) for r in reports)
    _write(path, HEALTH_COLUMNS, rows)


def write_attitudes(path: Path, attitudes: Iterable[Attitude]) -> None:
    """Write gravity-aligned attitudes, body to world, as quaternions with the sigma of roll and pitch.

    Raises:
        RecordingError: the file cannot be written.
    """
    rows = (
        (
            format_seconds(attitude.t_ns),
            *map(repr, Rotation.from_matrix(attitude.C_w_b).as_quat(canonical=True).tolist()),
            repr(float(np.degrees(attitude.tilt_sigma_rad))),
        )
        for attitude in attitudes
    )
    _write(path, ATTITUDE_COLUMNS, rows)


def _write(path: Path, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    write_text(path, text.getvalue())
