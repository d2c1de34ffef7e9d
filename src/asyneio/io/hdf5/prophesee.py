# SPDX-License-Identifier: Apache-2.0
"""Prophesee's HDF5: `/CD/events`, a table with the fields x, y, p and t [us].

Metavision compresses it with its own codec (ECF), which HDF5 loads as a plugin if it is installed.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from asyneio.io.calibration import find_calibration
from asyneio.io.hdf5.columns import ColumnEvents, ColumnLayout, event_table
from asyneio.io.parsing.safe_hdf5 import group, holds, open_hdf5, text_attribute
from asyneio.io.prophesee.header import size_of
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.sidecar import find_ground_truth, find_samples

_LAYOUT = ColumnLayout("CD", unit_ns=1000, table="events")


def is_prophesee_hdf5(path: Path) -> bool:
    """True if an HDF5 file has events where Metavision writes them."""
    with open_hdf5(path) as file:
        return holds(file, "CD") and holds(group(file, "CD", path), "events")


def read_prophesee_hdf5(path: Path, options: ReadOptions) -> Contents:
    """An HDF5 file of Metavision.

    Raises:
        RecordingError: unreadable, hostile, or compressed with a codec that is not installed.
        CalibrationError: a calibration file is malformed or impossible.
    """
    with open_hdf5(path) as file:
        event_table(file, _LAYOUT, path)
        fields = {
            name: text_attribute(file, name, path)
            for name in ("geometry", "format", "plugin_name")
            if name in file.attrs
        }
    size, notes = size_of(fields)
    folder = path.parent
    truth, truth_notes = find_ground_truth(folder)
    return Contents(
        path.resolve().stem,
        partial(ColumnEvents, path, _LAYOUT),
        size,
        find_calibration(folder, options.calibration, options.imu),
        find_samples(folder, options),
        ground_truth=truth,
        notes=notes + truth_notes,
    )
