"""Inertial samples from text, whoever wrote it: columns by their names, else by gravity.

| known as | line |
|---|---|
| EuRoC `imu0/data.csv` | `timestamp [ns],w_RS_S_x ...,a_RS_S_x ...`: gyroscope first |
| UZH `imu.txt` | `t ax ay az gx gy gz`, seconds, no header: accelerometer first |
| TUM-VIE `imu_data.txt` | `t gx gy gz ax ay az temperature`, microseconds with decimals |
| VECtor `*.imu.txt` | seconds, gyroscope first; more columns follow |
| ours | `t_ns,gx,gy,gz,ax,ay,az` |

A header names the columns, or the halves are told apart by gravity, which only an accelerometer reads; where
neither does, the file is refused.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.contents import Samples, split_samples
from asyneio.io.csv_table import bad_lines_note
from asyneio.io.event_source import SAMPLE_DTYPE
from asyneio.io.inertial_files import STANDARD_GRAVITY
from asyneio.io.text_rows import read_text_rows
from asyneio.types import FloatArray

#: Rates of inertial units, for the unit of time where no header tells it.
_RATES_HZ = (20.0, 16_000.0)
#: Bounds on a median norm that gravity explains, in m/s^2 and in g.
_GRAVITY = ((8.8, 10.8), (0.9, 1.1))
_EXPECTED = "samples of an IMU: time, three axes of the gyroscope and three of the accelerometer"

_GYROSCOPE = re.compile(r"(g|w|gyro?|gyroscope|omega|ang(ular)?_?vel(ocity)?|w_rs_s)[_.]?([xyz])")
_ACCELEROMETER = re.compile(r"(a|acc|accel|accelerometer|lin(ear)?_?acc(eleration)?|a_rs_s)[_.]?([xyz])")

_Sensors = tuple[tuple[int, ...], tuple[int, ...]]


def read_inertial_file(path: Path) -> Samples:
    """Samples as they stand in the file; its notes say which columns and which unit of time were read.

    Raises:
        RecordingError: unreadable, no samples, or columns or a unit of time that nothing tells.
    """
    rows = read_text_rows(path, 7, _EXPECTED)
    named = _by_name(rows.names)
    gyroscope, accelerometer = named or _by_gravity(path, rows.values)
    t_ns, unit = rows.stamps(_RATES_HZ)
    samples = np.empty(t_ns.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = t_ns
    samples["gyroscope"] = rows.values[:, gyroscope]
    samples["accelerometer"] = rows.values[:, accelerometer]
    order = "gyroscope" if gyroscope < accelerometer else "accelerometer"
    said = f"{path.name}: {order} first, as {'the header' if named else 'gravity'} says; time in {unit}"
    if rows.values.shape[1] > 7:
        said += f"; {rows.values.shape[1] - 7} further column(s) left out"
    return split_samples(samples, path.name, (said, *bad_lines_note(path, rows.bad)))


def _by_name(names: tuple[str, ...]) -> _Sensors | None:
    """Columns of both sensors from a header; None where it does not name all."""
    found = []
    for pattern in (_GYROSCOPE, _ACCELEROMETER):
        axes = {name[-1]: index for index, name in enumerate(names) if pattern.fullmatch(name)}
        if len(axes) != 3:
            return None
        found.append(tuple(axes[axis] for axis in "xyz"))
    return found[0], found[1]


def _by_gravity(path: Path, values: FloatArray) -> _Sensors:
    """Time first, then two halves, of which one reads gravity. Raises RecordingError where not one does."""
    halves = ((1, 2, 3), (4, 5, 6))
    norms = [float(np.nanmedian(np.linalg.norm(values[:, half], axis=1))) for half in halves]
    for low, high in _GRAVITY:
        reads = [low <= norm <= high for norm in norms]
        if sum(reads) == 1:
            return (halves[1], halves[0]) if reads[0] else halves
    raise RecordingError(
        f"{path}: nothing tells which columns are the accelerometer's: the medians of both halves are "
        f"{norms[0]:.3g} and {norms[1]:.3g}, expected {STANDARD_GRAVITY:.2f} m/s^2 (or 1 g) in one. Give it "
        "a header line: t_ns,gx,gy,gz,ax,ay,az"
    )
