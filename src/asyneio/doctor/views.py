# SPDX-License-Identifier: Apache-2.0
"""A view of a recording without some of its files, so that a damaged file does not hide the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

_CALIBRATION_SUFFIXES = {".yaml", ".yml", ".json"}
#: This YAML file is part of a ROS 2 bag.
_OF_A_BAG = "metadata.yaml"
_TABLE_SUFFIXES = {".txt", ".csv", ".tum"}


def is_calibration(path: Path) -> bool:
    """Whether a file may contain a calibration (text tables excluded)."""
    return path.suffix.lower() in _CALIBRATION_SUFFIXES and path.name != _OF_A_BAG


def is_beside(path: Path) -> bool:
    """Whether a file may contain something other than events: calibration, samples, poses."""
    named_events = "events" in path.name.lower()
    return is_calibration(path) or (path.suffix.lower() in _TABLE_SUFFIXES and not named_events)


@contextmanager
def view_without(path: Path, dropped: Callable[[Path], bool]) -> Iterator[Path]:
    """The same recording under another path: links to its files without those for which `dropped` is true.

    The view of a single file contains no sidecar files. Files that cannot be linked are left out.
    """
    with TemporaryDirectory(prefix="asyneio-doctor-") as folder:
        view = Path(folder) / path.resolve().name
        try:
            if path.is_dir():
                view.mkdir()
                for entry in path.iterdir():
                    if not (entry.is_file() and dropped(entry)):
                        (view / entry.name).symlink_to(entry.resolve())
            else:
                view.symlink_to(path.resolve())
        except OSError:
            # The reader then reports what is missing.
            pass
        yield view
