# SPDX-License-Identifier: Apache-2.0
"""A raw stream in a file of our HDF5 layout, which grows with each packet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from asyneio.io.hdf5.asyneio_writer import start_hdf5
from asyneio.io.parsing.hdf5_output import new_hdf5
from asyneio.live.chunks import Sensor, no_events, no_samples
from asyneio.live.packetizer import Rows
from asyneio.types import EventRecording, RecordArray

_CHUNK = 2**16


class RawFile:
    """Events and samples of one stretch. After a failed write, the rows written before remain readable.

    Args:
        path: created; an existing file is replaced.
        sensor: whose stream it is.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path, sensor: Sensor) -> None:
        self._path, self._closed = path, False
        self._context = new_hdf5(path)
        file = self._context.__enter__()
        self._file = file
        recording = EventRecording(
            sensor.name,
            no_events(),
            sensor.width,
            sensor.height,
            no_samples(),
            no_samples(),
            sensor.calibration.camera,
            sensor.calibration,
        )
        start_hdf5(file, recording)
        self._columns: dict[str, list[tuple[str, Any]]] = {
            "events": [(field, self._column("events", name, kind)) for name, field, kind in _EVENT_COLUMNS],
        }
        self._columns["events"][0][1].attrs["unit"] = "ns"
        for sensor_name in ("gyroscope", "accelerometer"):
            self._columns[sensor_name] = [
                ("t_ns", self._column(sensor_name, "t", "<i8")),
                ("xyz", self._column(sensor_name, "xyz", "<f8", (3,))),
            ]

    def add(self, rows: Rows) -> None:
        """Append rows and hand them to the operating system. Raises OSError: a row could not be written."""
        for name, columns in self._columns.items():
            _append(columns, getattr(rows, name))
        self._file.flush()
        if self._path.stat().st_size < self._file.id.get_filesize():
            # A write failed, which HDF5 does not notice; the error comes when the file is closed.
            self.close()

    def close(self) -> None:
        """End the file, once. Raises OSError: it could not be written completely."""
        if not self._closed:
            self._closed = True
            self._context.__exit__(None, None, None)

    def _column(self, group: str, name: str, kind: str, shape: tuple[int, ...] = ()) -> Any:
        section = self._file.require_group(group)
        return section.create_dataset(
            name,
            shape=(0, *shape),
            maxshape=(None, *shape),
            chunks=(_CHUNK if not shape else 4096, *shape),
            dtype=kind,
        )


_EVENT_COLUMNS = (("t", "t_ns", "<i8"), ("x", "x", "<u2"), ("y", "y", "<u2"), ("p", "p", "u1"))


def _append(columns: list[tuple[str, Any]], rows: RecordArray) -> None:
    if not rows.size:
        return
    for field, column in columns:
        count = column.shape[0]
        column.resize(count + rows.size, axis=0)
        column[count:] = np.ascontiguousarray(rows[field])
